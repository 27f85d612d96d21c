"""What the sessions have in common: frames in, packets out."""

from collections.abc import Iterable
from typing import Protocol

from encoder.calls.session_callbacks import Progress
from encoder.calls.two_pass_session import EncodedCall
from encoder.coding.model_packet import ModelBudget
from shared_model.arrays import Picture


class FramePass(Protocol):
    """Takes the frames of a source, in order."""

    @property
    def started(self) -> bool:
        """Whether a face has been found yet."""

    def frame(self, index: int, picture: Picture, next_frame: Picture | None = None) -> None:
        """Take source frame `index`, (height, width, 3) uint8 BGR.

        next_frame: the frame after it, where that has been read already: its landmarks are found
            in the background.  The result is the same without it.
        """


class CallSession(FramePass, Protocol):
    """Encodes a call frame by frame: sends what is due after each frame."""

    def end(self, frames: int) -> None:
        """Send what is left of a call of `frames` source frames, and its end."""


class RecordedPass(FramePass, Protocol):
    """The first pass over a source that can be read twice, and what follows it.

    Call `frame` with every frame, `build_models`, `fit_frames` with every frame again, then
    `encode` at one bitrate or several.
    """

    @property
    def faces_fitted(self) -> int:
        """Number of faces that `fit_frames` has fitted."""

    def build_models(self, budget: ModelBudget) -> None:
        """Between the passes: identity and appearance of each person."""

    def fit_frames(self, frames: Iterable[tuple[int, Picture]]) -> None:
        """Second pass over source frames (index, picture): fit the faces in those to be coded."""

    def encode(self, bitrate: float, progressive: bool = False) -> list[EncodedCall]:
        """The parts of the call at `bitrate` bits per second, all frame packets counted.

        progressive: the model of the first one is split into layers, if it can be.
        """

    def may_have_residual(self, bitrate: float) -> bool:
        """Whether the call has bits, and pictures, for a picture residual."""


def run_pass(
    session: FramePass,
    frames: Iterable[tuple[int, Picture, Picture | None]],
    total: int | None,
    progress: Progress,
) -> None:
    """Give all frames (index, picture, next picture) to a session.

    total: their number; None: not known.
    """
    for index, picture, next_frame in frames:
        session.frame(index, picture, next_frame)
        progress(index + 1, total)
