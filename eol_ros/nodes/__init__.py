# SPDX-License-Identifier: Apache-2.0
"""One thin file per node, started with `python -m eol_ros.nodes NAME`."""

import sys

if sys.argv[0] == '-m':  # what -m says while it looks for the module, whose imports would fail
    from eol_ros.errors import DeviceMissing, UsageError
    from eol_ros.ros import installed

    try:
        installed.require()
        if any(word.startswith('eol_ros.nodes.') for word in sys.orig_argv):
            raise UsageError('a node is started with `python -m eol_ros.nodes NAME`')
    except (DeviceMissing, UsageError) as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
