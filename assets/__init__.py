# SPDX-License-Identifier: Apache-2.0
"""Makes the drawings, the film and the sheets of screens; what is made ships, these do not."""

import benchmarks  # noqa: F401, whose path has `support`
