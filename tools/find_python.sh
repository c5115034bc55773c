#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Prints the name of a Python 3.10 to 3.13 that can make environments; nothing where there is none.
usable='import sys, venv, ensurepip; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))'
for name in ${PYTHON:-} python3.12 python3.11 python3.13 python3.10 python3; do
    if command -v "$name" >/dev/null 2>&1 && "$name" -c "$usable" >/dev/null 2>&1; then
        printf '%s' "$name"
        exit 0
    fi
done
