#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Makes everything ready: system packages, Python, the wheels, the messages, compiled kernels.
# Does nothing, in a fraction of a second, when nothing changed.
#   tools/setup_env.sh [EXTRA]      EXTRA: test, bench
set -eu
cd "$(dirname "$0")/.."

# A wheel environment sets these for its own children; another environment must not inherit them.
unset _ROS_WHEELS_BOOTSTRAP_COMPLETE || true

case ${1:-} in
    test | bench) tools/system_packages.sh test ;;
    *) tools/system_packages.sh run ;;
esac
python=$(tools/find_python.sh)
if [ -z "$python" ]; then
    echo 'no Python 3.10 to 3.13 with venv found: sudo apt-get install python3-venv' >&2
    exit 1
fi
exec "$python" tools/setup_env.py "$@"
