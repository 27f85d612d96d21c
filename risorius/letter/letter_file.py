"""Writes the letter of a call file."""

from collections.abc import Callable, Sequence
from pathlib import Path

from risorius.letter.letter_page import letter_page
from risorius.letter.letter_sound import letter_sound
from shared_model.errors import cannot_read
from shared_model.whole_file import whole_file


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
