#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Makes everything ready: system packages, Python, the wheels, the messages, compiled kernels.
# Does nothing, in a fraction of a second, when nothing changed.
#   tools/setup_env.sh [EXTRA]      EXTRA: test, bench, core (the tests of the pure core, no ROS)
#   PYTHON=3.12: with this version; EOL_VENV: where, .venv unless said
set -eu
cd "$(dirname "$0")/.."

# A wheel environment sets these for its own children; another environment must not inherit them.
unset _ROS_WHEELS_BOOTSTRAP_COMPLETE || true

python=$(tools/find_python.sh)
case ${python:+found}${PYTHON:-} in
    3.*) # asked for and not found; the system packages bring only the default
        echo "no Python $PYTHON with venv on the PATH, by uv or pyenv (3.10 to 3.13 can be used);" \
            "one way to get it: uv python install $PYTHON" >&2
        exit 1
        ;;
esac
case ${1:-} in
    test | bench) tools/system_packages.sh test ;;
    *) tools/system_packages.sh run ;;
esac
[ -n "$python" ] || python=$(tools/find_python.sh)
if [ -z "$python" ]; then
    echo 'no Python 3.10 to 3.13 with venv found: sudo apt-get install python3-venv' >&2
    exit 1
fi
exec "$python" tools/setup_env.py "$@"
