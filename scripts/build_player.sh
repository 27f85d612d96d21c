#!/bin/sh
# Builds the player into one script.  usage: build_player.sh FOLDER
set -eu
node_modules/.bin/esbuild player/letter/letter.js --bundle --minify --format=iife --target=es2022 \
    --log-level=warning --outfile="$1/letter.js"
