#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Renews tools/requirements: each wheel that the set-up installs, with its version and the hashes
# with which it may come, for every Python that is supported. Needs the network.
#   tools/lock_requirements.sh [--upgrade]      --upgrade: the newest that setup.py allows
set -eu
cd "$(dirname "$0")/.."
uv() {
    .venv/bin/python -m uv pip compile --universal --python-version 3.10 --generate-hashes \
        --no-header --no-annotate --quiet "$@"
}
.venv/bin/python -m pip install --quiet --disable-pip-version-check uv
printf 'setuptools<80\nwheel\n' >.venv/build.in
sed -n '/^requires = \[/,/^\]/p' msg_defs/eol_msgs/pyproject.toml |
    grep -o '"[^"]*"' | tr -d '"' >.venv/messages.in
locks=tools/requirements
uv "$@" setup.py .venv/build.in --extra ros --extra test --output-file $locks/test.txt
uv "$@" setup.py .venv/build.in --extra ros --extra science --constraint $locks/test.txt \
    --output-file $locks/run.txt
uv "$@" .venv/messages.in --constraint $locks/test.txt --output-file $locks/messages.txt
