"""The HTML file of a letter: the player, its data, the call and its sound, all in the page."""

import base64
import zlib
from html import escape

from risorius.page.player_parts import player_part

# Of the player: what it is built into, what it reads, and the page around it.
BUILT, DATA = "built/letter.js", "data/player.bin"
PAGE, STYLE, LOADER = "letter/letter.html", "page/page.css", "letter/loader.js"
# What is left out of the loader: it is for whoever reads the source.
COMMENT = "//"


def letter_page(call: bytes, title: str, sound: bytes | None) -> str:
    """The page of a call.

    call: the bytes of a call file.  title: of the page.
    sound: of the call from its first picture on, a WebM file; None: it is silent.
    Raises `UserError` if the player has not been built.
    """
    page = player_part(PAGE).decode()
    parts = {
        "title": escape(title),
        "style": player_part(STYLE).decode(),
        "sound": "" if sound is None else _base85(sound),
        "player": _base85(zlib.compress(player_part(BUILT), 9)),
        "data": _base85(zlib.compress(player_part(DATA), 9)),
        "call": _base85(call),
        "loader": _without_comments(player_part(LOADER).decode()),
    }
    # All at once: what has been put in is not searched.
    pieces = page.split("{{")
    filled = [pieces[0]]
    for piece in pieces[1:]:
        name, rest = piece.split("}}", 1)
        filled += [parts[name], rest]
    return "".join(filled)


def _base85(data: bytes) -> str:
    """Bytes as text that HTML takes as it is: RFC 1924's digits, other ones for < and &."""
    return base64.b85encode(data).translate(bytes.maketrans(b"<&", b"/,")).decode("ascii")


def _without_comments(script: str) -> str:
    lines = script.splitlines()
    return "\n".join(line for line in lines if not line.lstrip().startswith(COMMENT))
