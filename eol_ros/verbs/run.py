# SPDX-License-Identifier: Apache-2.0
"""eol run: the same as `python -m eol_ros.bringup`."""

from eol_ros.bringup.run import EXAMPLES, HELP, add_arguments, run

__all__ = ['EXAMPLES', 'HELP', 'add_arguments', 'run']
