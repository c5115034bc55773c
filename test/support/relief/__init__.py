# SPDX-License-Identifier: Apache-2.0
"""Images of printed covers, path-traced: what stands on the table, the light, and the films."""
