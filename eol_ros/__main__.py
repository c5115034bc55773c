# SPDX-License-Identifier: Apache-2.0
"""`python -m eol_ros VERB` is `eol VERB`."""

import sys

from eol_ros.cli import main

if __name__ == '__main__':  # not in the processes of a sweep, which import this again
    sys.exit(main())
