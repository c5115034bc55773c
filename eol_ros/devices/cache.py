# SPDX-License-Identifier: Apache-2.0
"""Where things made on first use are kept: the ice recording, drawn pictures, analyses."""

import os
from pathlib import Path

from eol_ros.errors import ConfigError


def folder(name: str) -> Path:
    """Return the folder `name` of the cache, made if absent.

    It lies in $EOL_CACHE, else in $XDG_CACHE_HOME/eol_ros, else in ~/.cache/eol_ros. Raises
    ConfigError where it cannot be made.
    """
    root = os.environ.get('EOL_CACHE')
    if not root:
        root = os.path.join(os.environ.get('XDG_CACHE_HOME') or '~/.cache', 'eol_ros')
    path = Path(root).expanduser() / name
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(
            f'{path}: {error.strerror}; set EOL_CACHE to a folder that can be written'
        ) from None
    return path
