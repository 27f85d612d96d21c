#!/bin/sh
# Types and style of the pages' scripts (asc checks those of player/wasm as it builds them), and whether what is built of the player is up to date.
# A page's scripts share their globals; no two pages do.
set -eu
bin=node_modules/.bin
"$bin/biome" check --error-on-warnings .
for scripts in \
    "risorius/page/element.js risorius/call_page/player.js risorius/call_page/voice.js risorius/call_page/tape.js risorius/call_page/devices.js risorius/call_page/call.js" \
    "risorius/page/element.js risorius/view/blink.js risorius/view/muscle_rows.js risorius/view/view.js" \
    "risorius/page/element.js risorius/view/annotation.js"; do
    # shellcheck disable=SC2086  # one word for each script
    "$bin/tsc" --noEmit --allowJs --checkJs --strict --noImplicitAny false --target es2022 \
        --lib es2022,dom,dom.iterable --types "" $scripts
done
"$bin/tsc" --project player/jsconfig.json
"$bin/tsc" --project tests/test_player/jsconfig.json
built=$(mktemp -d)
trap 'rm -rf "$built"' EXIT
sh scripts/build_player.sh "$built"
for script in letter.js face_drawer.js pictures.wasm filters.wasm texture.wasm; do
    cmp "$built/$script" "player/built/$script" || {
        echo "player/built/$script is not what the sources make: run make player" >&2
        exit 1
    }
done
