#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# `ros2 run eol_ros NAME`: installed in lib/eol_ros under the name of each node, and as `bringup`.
# The Python is that of the environment it lies in; in a ROS workspace, the first on the PATH.
python=$(dirname -- "$0")/../../bin/python
[ -x "$python" ] || python=python3
name=$(basename -- "$0")
if [ "$name" = bringup ]; then
    exec "$python" -m eol_ros.bringup "$@"
fi
exec "$python" -m eol_ros.nodes "$name" "$@"
