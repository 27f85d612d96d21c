"""The browser of the user of this host."""

import os
import sys
import webbrowser


def open_browser(address: str) -> None:
    """Open a page in it, if this host has a screen."""
    if sys.platform == "darwin" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(address)
