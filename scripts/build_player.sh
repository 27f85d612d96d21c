#!/bin/sh
# Builds the player: of a letter, of the page of a call, and of watching from anywhere.
# usage: build_player.sh FOLDER
set -eu
node_modules/.bin/esbuild player/letter/letter.js player/page/face_drawer.js player/watch/watch.js \
    --bundle --minify --format=iife --target=es2022 --log-level=warning --entry-names='[name]' \
    --outdir="$1"
