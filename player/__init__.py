"""The decoder in JavaScript, for any browser; `built` is what `make player` builds of it."""
