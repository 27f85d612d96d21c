"""What is in a call file, whole or cut off."""

from pathlib import Path

from protocol.errors import ProtocolError
from protocol.summary import CallSummary, summarise
from shared_model.errors import UserError


def call_info(path: Path) -> CallSummary:
    """The summary of a call file; of one that is cut off, of the frames that can be drawn.

    Raises `UserError` if it is no call or cannot be read.
    """
    try:
        summary = summarise(path)
        if summary.complete:
            return summary
        # Only now: a whole call says how many frames it has.
        from decoder.playout.duration import count_frames

        return summarise(path, count_frames(path))
    except ProtocolError as error:
        raise UserError(f"{path}: {error}") from error
