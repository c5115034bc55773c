# SPDX-License-Identifier: Apache-2.0
"""Where things are kept between runs, by the XDG base directory rules."""

import os
from pathlib import Path

from eol_ros.errors import ConfigError, writing


def cache(name: str) -> Path:
    """Return the folder `name` for things made on first use: ice recording, images, analyses.

    It is made if absent. Raises ConfigError where it cannot be.
    """
    return _made(cache_path() / name, 'EOL_CACHE')


def cache_path() -> Path:
    """Return where these lie: $EOL_CACHE, else eol_ros in $XDG_CACHE_HOME or ~/.cache."""
    return _root('EOL_CACHE', 'XDG_CACHE_HOME', '~/.cache')


def state_path() -> Path:
    """Return where logs, the events and the day's counts lie; it may not be there yet.

    It is $EOL_STATE, else eol_ros in $XDG_STATE_HOME or ~/.local/state.
    """
    return _root('EOL_STATE', 'XDG_STATE_HOME', '~/.local/state')


def state() -> Path:
    """Return `state_path`, made if absent; raises ConfigError where it cannot be."""
    return _made(state_path(), 'EOL_STATE')


def config_path() -> Path:
    """Return where the keys of `network: secure` lie; it may not be there yet.

    It is $EOL_CONFIG, else eol_ros in $XDG_CONFIG_HOME or ~/.config.
    """
    return _root('EOL_CONFIG', 'XDG_CONFIG_HOME', '~/.config')


def nearest(path: Path) -> Path:
    """Return `path`, or of the folders above it the nearest that is there."""
    path = path.absolute()
    return next(there for there in (path, *path.parents) if there.exists())


def _root(own: str, common: str, usual: str) -> Path:
    root = os.environ.get(own) or os.path.join(os.environ.get(common) or usual, 'eol_ros')
    return Path(root).expanduser()


def _made(path: Path, variable: str) -> Path:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(
            f'{path}: {error.strerror}; set {variable} to a folder that can be written'
        ) from None
    return path


def made(path: str | Path, option: str) -> Path:
    """Return the folder `path`, made where it is not there; raise ConfigError where it cannot be.

    option: as for `check_writable`.
    """
    path = Path(path)
    with writing(path, option):
        path.mkdir(parents=True, exist_ok=True)
    return path


def check_writable(path: str | Path, option: str) -> None:
    """Raise ConfigError when a file cannot be written there: before the work, not after it.

    option: the command's word that named the file, for the message.
    """
    path = Path(path).expanduser()
    there = path.exists()
    with writing(path, option):
        path.open('ab').close()
        if not there:
            path.unlink()
