"""Writes the letter of a call file: one page of HTML with the call, its sound and the player."""

import base64
import zlib
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory

from decoder.playout.received_frames import DecodeStats, received_frames
from decoder.playout.receiver import Receiver
from decoder.sinks.sound_file import SoundFile
from decoder.sound.sound_track import open_sound_track
from protocol.call_file import CallReader
from risorius.page.player_parts import player_part
from shared_model.errors import cannot_read
from shared_model.whole_file import whole_file

# Of the player: what it is built into, what it reads, and the page around it.
BUILT, DATA = "built/letter.js", "data/player.bin"
PAGE, STYLE, LOADER = "letter/letter.html", "page/page.css", "letter/loader.js"
# What is left out of the loader: it is for whoever reads the source.
COMMENT = "//"
# Speech that Codec2 has carried needs no more.
OPUS_BPS = 6000


def write_letter(
    call: Path, output: Path, title: str, warn: Callable[[Sequence[str]], None]
) -> int:
    """Write the letter of a call file; returns its bytes.

    title: of the page.  warn: called with what is left out.
    Raises `UserError` if the call cannot be read or the letter cannot be written.
    """
    sound, missing = letter_sound(call)
    warn([missing] if missing else [])
    try:
        data = call.read_bytes()
    except OSError as error:
        raise cannot_read(call, error) from error
    page = letter_page(data, title, sound).encode()
    with whole_file(output) as file:
        file.write(page)
    return len(page)


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


def letter_sound(call: Path) -> tuple[bytes | None, str]:
    """The sound of a call file from its first picture on, a WebM file; and a warning, or nothing.

    None: the call is silent, or its codec is not installed.
    """
    stats = DecodeStats()
    receiver = Receiver(on_damage=lambda error: None, kept_speech_s=1 << 30)
    with CallReader(call) as reader:
        shown = [
            frame
            for frames in received_frames(reader, receiver, stats, lambda: False)
            for frame in frames
        ]
    if not shown or receiver.model is None or receiver.model.call.voice == "off":
        return None, ""
    voice = receiver.model.call.voice
    track = open_sound_track(receiver.speech, receiver.model.call, shown[0].index)
    if track is None:
        return None, f"without the voice ({voice}): pip install '.[voice]' to put it in"
    with TemporaryDirectory() as folder:
        path = Path(folder) / "sound.webm"
        with SoundFile(path, track.rate_hz, OPUS_BPS) as file:
            file.write(track.take(len(shown), None))
        return path.read_bytes(), ""
