"""What a command may write to, checked before the work begins."""

import errno
import os
from collections.abc import Iterable
from pathlib import Path

from shared_model.errors import UserError

# Stands for standard input or output.
STANDARD = Path("-")
# Suffixes of videos and pictures.
PICTURES = {".mkv", ".mp4", ".mov", ".avi", ".webm", ".png", ".jpg", ".jpeg"}
# Suffixes of letters.
PAGES = {".html", ".htm"}


def check_outputs(inputs: Iterable[str | Path | None], outputs: Iterable[Path | None]) -> None:
    """Raise `UserError` where an output would replace an input, or could not be written.

    inputs, outputs: names of files and patterns of images; `STANDARD` and None are passed over.
    A slip of the hand must not cost the only recording, nor put a file in a device's place.
    """
    read = [Path(given) for given in inputs if given is not None]
    written = [path for path in outputs if path is not None and path != STANDARD]
    for number, path in enumerate(written):
        if any(_same_file(path, given) for given in read):
            raise UserError(f"{path} is what is to be read; give the output another name")
        if any(path.absolute() == other.absolute() for other in written[:number]):
            raise UserError(f"{path} is named for two outputs; give one of them another name")
        if path.exists() and not path.is_file():
            kind = "a folder" if path.is_dir() else "no regular file"
            raise UserError(f"{path} is {kind}; give the name of a file")
        if not path.parent.is_dir():
            raise UserError(f"cannot write {path}: there is no folder {path.parent}")
        if not (os.access(path.parent, os.W_OK) or os.access(path, os.W_OK)):
            raise UserError(f"cannot write {path}: {_refusal(path.parent)}")


def check_output_folder(folder: Path | None) -> None:
    """Raise `UserError` where a folder could not be made; its parents may be missing, too."""
    if folder is None:
        return
    places = (folder.absolute(), *folder.absolute().parents)
    existing = next(path for path in places if path.exists())
    if not existing.is_dir():
        raise UserError(f"cannot write into {folder}: {existing} is no folder")
    if not os.access(existing, os.W_OK):
        raise UserError(f"cannot write into {folder}: {_refusal(existing)}")


def check_call_file(path: Path | None) -> None:
    """Raise `UserError` where a call would be written under a video's or a picture's name."""
    if path is not None and path.suffix.lower() in PICTURES:
        better = path.with_suffix(".rzo")
        raise UserError(f"{path}: a call is no video; write {better} and decode that")


def is_letter(path: Path | None) -> bool:
    """Whether a letter is asked for by the name of an output."""
    return path is not None and path.suffix.lower() in PAGES


def check_letter_name(path: Path) -> None:
    """Raise `UserError` unless a letter can have this name."""
    if not is_letter(path):
        raise UserError(f"{path}: a letter is a page; write {path.with_suffix('.html')}")


def _refusal(folder: Path) -> str:
    """Why a folder takes no files, in the system's words where it has some."""
    is_read_only = os.statvfs(folder).f_flag & os.ST_RDONLY
    return os.strerror(errno.EROFS) if is_read_only else "no permission"


def _same_file(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except OSError:
        # A pattern of images stands for files of other names.
        return one.resolve() == other.resolve()
