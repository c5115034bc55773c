#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Installs the system packages of tools/system_packages.txt that are missing, where it may: as root,
# or with a sudo that asks for no password. Elsewhere it names them once, and the set-up goes on.
#   tools/system_packages.sh run|test|firmware    EOL_SYSTEM=no: leave the system as it is
set -eu
cd "$(dirname "$0")/.."
wanted=${1:-run}
venv=${EOL_VENV:-.venv}
[ "${EOL_SYSTEM:-yes}" = no ] && exit 0

say() { printf '%s\n' "$*" >&2; }

there() {  # a probe of the list
    case $1 in
        command:*) command -v "${1#*:}" >/dev/null 2>&1 ;;
        library:*) PATH="$PATH:/sbin:/usr/sbin" ldconfig -p 2>/dev/null | grep -q "${1#*:} " ;;
        path:*) [ -e "${1#*:}" ] ;;
        python:venv) [ -x "$venv/bin/python" ] || [ -n "$(tools/find_python.sh)" ] ;;
        python:headers)
            python=$venv/bin/python
            [ -x "$python" ] || python=$(tools/find_python.sh)
            [ -n "$python" ] && "$python" -S -c 'import os, sys, sysconfig
sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))' ;;
    esac
}

missing=''
while read -r package stage probe _; do
    case "$wanted $stage" in
        *' build' | *' run' | 'test test' | 'firmware firmware') there "$probe" || missing="$missing $package" ;;
    esac
done <<LIST
$(grep -v '^#' tools/system_packages.txt)
LIST
missing=${missing# }
[ -n "$missing" ] || exit 0

root=none
if [ "$(id -u)" = 0 ]; then
    root=''
elif command -v sudo >/dev/null 2>&1 && sudo -n true 2>/dev/null; then
    root='sudo -n'
fi
told=$venv/.system-packages-told
if [ "$root" = none ] || ! command -v apt-get >/dev/null 2>&1; then
    if [ "$(cat "$told" 2>/dev/null)" != "$missing" ]; then
        say "these system packages are missing: $missing"
        say "install them with: sudo apt-get install $missing"
        mkdir -p "$venv"
        printf '%s\n' "$missing" > "$told"
    fi
    exit 0
fi

log=$(mktemp)
say "installing system packages: $missing"
(
    set -e
    $root env DEBIAN_FRONTEND=noninteractive apt-get update -qq
    # shellcheck disable=SC2086
    $root env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends \
        -o DPkg::Lock::Timeout=120 $missing
) > "$log" 2>&1 &
job=$!
waited=0
while kill -0 "$job" 2>/dev/null; do
    sleep 1
    waited=$((waited + 1))
    [ $((waited % 4)) -ne 0 ] || say "system packages, $waited s: $(tail -n 1 "$log" | cut -c 1-80)"
done
if ! wait "$job"; then
    say "the system packages could not be installed ($(grep -m 1 '^E:' "$log" || tail -n 1 "$log"));"
    say "going on without; by hand: sudo apt-get install $missing"
fi
rm -f "$log"
