"""The error whose message is shown to the user."""

from pathlib import Path

# Exit codes: no face in the source; a link that cannot be made, or breaks.
NO_FACE, LINK_FAILED = 3, 4


class UserError(Exception):
    """A mistake that the user can correct; the message is one line: what is wrong, what to do.

    exit_code: the process's exit status: 2 bad usage or input, 3 no face found, 4 link failed.
    """

    def __init__(self, message: str, exit_code: int = 2) -> None:
        super().__init__(message)
        self.exit_code = exit_code


def cannot_read(path: object, error: OSError) -> UserError:
    """What to raise for a file that the system does not let us read; path: its name."""
    reasons = {
        FileNotFoundError: "no such file",
        IsADirectoryError: "it is a folder",
        PermissionError: "no permission",
    }
    return UserError(f"cannot read {path}: {reasons.get(type(error), error.strerror)}")


def cannot_write(path: Path, error: OSError) -> UserError:
    """What to raise for a file that the system does not let us write."""
    has_folder = path.parent.is_dir()
    reasons = {
        FileNotFoundError: "no file can be made there"
        if has_folder
        else f"there is no folder {path.parent}",
        IsADirectoryError: "it is a folder",
        PermissionError: "no permission",
    }
    return UserError(f"cannot write {path}: {reasons.get(type(error), error.strerror)}")
