# SPDX-License-Identifier: Apache-2.0
"""`python -m eol_ros.bringup [SCENE]` is `eol run`."""

import sys

from eol_ros import interrupts


def main() -> int:
    """Run the command line."""
    interrupts.install()  # before anything takes time
    from eol_ros import cli
    from eol_ros.bringup import run

    return cli.run_verb(run, 'eol run', sys.argv[1:])


if __name__ == '__main__':
    sys.exit(main())
