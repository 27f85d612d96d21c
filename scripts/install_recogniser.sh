#!/bin/sh
# Adds the face recognition network to the judge's environment; where npm cannot, it goes without.
# usage: install_recogniser.sh FOLDER
set -eu
if ! command -v npm >/dev/null; then
    echo "judge: no npm: the identity of faces will not be measured" >&2
    exit 0
fi
tfjs=4.22.0
npm install --silent --no-fund --no-audit --ignore-scripts --prefix "$1" @vladmandic/human@3.3.6 \
    "@tensorflow/tfjs-core@$tfjs" "@tensorflow/tfjs-converter@$tfjs" "@tensorflow/tfjs-backend-wasm@$tfjs" \
    || echo "judge: npm failed: the identity of faces will not be measured" >&2
