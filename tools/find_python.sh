#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Prints the path of a Python 3.10 to 3.13 that can make environments; nothing where there is none.
# PYTHON=3.12: of that version only, from the PATH, uv or pyenv. PYTHON=COMMAND: that one first.
usable='import sys, venv, ensurepip
version = sys.version_info[:2]
sys.exit(not (3, 10) <= version <= (3, 13) or sys.argv[1] not in ("", "%d.%d" % version))'
version=''
case ${PYTHON:-} in
    3.*)
        version=$PYTHON
        of_uv=$(uv python find --system --no-python-downloads "$version" 2>/dev/null) || true
        of_pyenv=$(ls -d "${PYENV_ROOT:-$HOME/.pyenv}/versions/$version".*/bin/python 2>/dev/null) || true
        names="python$version $of_uv $of_pyenv"
        ;;
    *) names="${PYTHON:-} python3.12 python3.11 python3.13 python3.10 python3" ;;
esac
for name in $names; do
    if command -v "$name" >/dev/null 2>&1 && "$name" -c "$usable" "$version" >/dev/null 2>&1; then
        printf '%s' "$name"
        exit 0
    fi
done
