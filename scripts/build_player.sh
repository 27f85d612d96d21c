#!/bin/sh
# Builds the player: of a letter, of the page of a call, and of watching from anywhere; and what is
# compiled of it, decoder and filters of pictures.
# usage: build_player.sh FOLDER
set -eu
node_modules/.bin/esbuild player/letter/letter.js player/page/face_drawer.js player/watch/watch.js \
    player/watch/opus.js --bundle --minify --format=iife --target=es2022 --log-level=warning --entry-names='[name]' \
    --outdir="$1"
for module in pictures filters texture; do
    node_modules/.bin/asc "player/wasm/$module.ts" --outFile "$1/$module.wasm" --optimizeLevel 3 \
        --shrinkLevel 1 --noAssert --runtime stub --enable simd --use abort= --disableWarning 112
done
