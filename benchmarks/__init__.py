# SPDX-License-Identifier: Apache-2.0
"""What a maintainer runs before a release, in a checkout: `eol bench NAME`."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / 'test'))  # for `support`, which tests use, too
