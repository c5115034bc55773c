# SPDX-License-Identifier: Apache-2.0
"""`python -m eol_ros VERB` is `eol VERB`."""

import sys

from eol_ros import interrupts


def main() -> int:
    """Run the command line."""
    interrupts.install()  # before anything takes time
    from eol_ros import cli

    return cli.main()


if __name__ == '__main__':  # not in the processes of a sweep, which import this again
    sys.exit(main())
