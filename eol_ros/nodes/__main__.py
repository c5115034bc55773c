# SPDX-License-Identifier: Apache-2.0
"""Several nodes in one process: `python -m eol_ros.nodes camera tracker --scene SCENE`."""

import sys

from eol_ros.errors import UsageError, nearest
from eol_ros.ros.run import run
from eol_ros.streams.graph import NODES


def main() -> int:
    """Run the nodes named before the first option."""
    words = sys.argv[1:]
    count = next((i for i, word in enumerate(words) if word.startswith('-')), len(words))
    names = words[:count]
    wrong = [name for name in names if name not in NODES]
    if wrong or not names:
        what = f'{wrong[0]}: no such node' if wrong else 'no node named'
        print(f'{what}. {nearest(wrong[0] if wrong else "", NODES)}', file=sys.stderr)
        return UsageError.exit_code
    return run(names, words[count:])


if __name__ == '__main__':
    sys.exit(main())
