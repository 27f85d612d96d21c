#!/bin/sh
# Makes sure of what pip cannot install: a Python that makes environments, and EGL in software; with
# "browser" also Chromium, which only the tests of the pages need, with "node" npm, which only checks their scripts.
# usage: system_libraries.sh [PYTHON [browser|node]]
set -eu
python=${1:-python3}
purpose=${2:-run}

if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
    echo "risorius needs Python 3.11 or later; name one: make PYTHON=python3.12" >&2
    exit 1
fi

# Prints the Debian packages that are missing, none on another system that has the libraries.
missing() {
    "$python" -c 'import ensurepip, venv' 2>/dev/null || echo python3-venv
    if command -v dpkg-query >/dev/null; then
        for package in libegl1 libgl1 libegl-mesa0 libgl1-mesa-dri; do
            dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || echo "$package"
        done
    else
        "$python" -c 'import ctypes; ctypes.CDLL("libEGL.so.1"); ctypes.CDLL("libGL.so.1")' \
            2>/dev/null || echo "libEGL.so.1 libGL.so.1"
    fi
    if [ "$purpose" = browser ]; then
        command -v chromium >/dev/null || command -v chromium-browser >/dev/null \
            || command -v google-chrome >/dev/null || echo chromium
    fi
    if [ "$purpose" = node ]; then
        command -v npm >/dev/null || echo npm
    fi
}

wanted=$(missing | tr '\n' ' ' | sed 's, $,,')
[ -n "$wanted" ] || exit 0
if [ "$(id -u)" -eq 0 ] && command -v apt-get >/dev/null; then
    apt-get update -qq
    # shellcheck disable=SC2086  # one word for each package
    DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends $wanted
else
    echo "risorius needs these system packages first: $wanted (Debian: apt-get install $wanted)" >&2
    exit 1
fi
