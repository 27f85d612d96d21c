#!/bin/sh
# Builds the player: of a letter, and of the page of a call.  usage: build_player.sh FOLDER
set -eu
node_modules/.bin/esbuild player/letter/letter.js player/page/face_drawer.js --bundle --minify \
    --format=iife --target=es2022 --log-level=warning --entry-names='[name]' --outdir="$1"
