# SPDX-License-Identifier: Apache-2.0
"""`python -m eol_ros VERB` is `eol VERB`."""

import sys

from eol_ros.cli import main

sys.exit(main())
