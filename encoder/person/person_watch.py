"""Tells when somebody else sits where the person sat: after a gap, a cut, or a jump."""

from enum import Enum, auto

import numpy as np

from encoder.person.face_signature import FaceSignature, SignatureMaker, are_others, is_frontal
from shared_model.arrays import Array, Picture

# Frames without a face after which it may be somebody else's.
GAP_FRAMES = 10
# A face that moves by so many times its width from one frame to the next may be somebody else's.
JUMP_WIDTHS = 0.7
# Frontal faces by which it is told, and frames within which.
ENOUGH_FACES, MOST_FRAMES = 3, 12
# Signatures of the person that are kept, and frames from one to the next.
KEPT_FACES, KEEP_INTERVAL = 24, 8


class Verdict(Enum):
    """Whose face a frame has."""

    SAME = auto()
    UNDECIDED = auto()
    OTHER = auto()


class PersonWatch:
    """Compares the faces after each gap, cut or jump with those before."""

    def __init__(self) -> None:
        self._maker: SignatureMaker | None = None
        self._known: list[FaceSignature] = []
        self._seen: list[FaceSignature] = []
        self._missing = self._count = 0
        self._place: Array | None = None
        self._judged: int | None = None  # frames with a face since the gap; None: no question

    def begin(self) -> None:
        """From the next frame on it is another person."""
        self._maker, self._judged = None, None
        self._known, self._seen, self._count = [], [], 0

    def miss(self) -> None:
        """A frame without a face."""
        self._missing += 1

    def judge(self, picture: Picture, points: Array, is_cut: bool = False) -> Verdict:
        """Take a frame (h, w, 3) uint8 BGR with a face, landmarks (468, 3), pixels.

        is_cut: there is a cut before it.
        Frames are undecided until one is not: then all of them have that verdict.
        """
        is_jump = self._has_jumped(points)
        if (is_cut or is_jump or self._missing >= GAP_FRAMES) and self._known:
            self._judged, self._seen = 0, []
        self._missing = 0
        if self._judged is None:
            self._keep(picture, points)
            return Verdict.SAME
        self._judged += 1
        if is_frontal(points):
            assert self._maker is not None
            self._seen.append(self._maker.make(picture, points))
        if len(self._seen) < ENOUGH_FACES and self._judged < MOST_FRAMES:
            return Verdict.UNDECIDED
        self._judged = None
        if are_others(self._known, self._seen):
            self.begin()
            return Verdict.OTHER
        self._known = (self._known + self._seen)[-KEPT_FACES:]
        return Verdict.SAME

    def _has_jumped(self, points: Array) -> bool:
        before, self._place = self._place, points[:, :2].mean(0)
        width = float(np.ptp(points[:, 0]))
        return before is not None and bool(
            np.linalg.norm(self._place - before) > JUMP_WIDTHS * width
        )

    def _keep(self, picture: Picture, points: Array) -> None:
        self._count += 1
        if self._count % KEEP_INTERVAL != 1 or not is_frontal(points):
            return
        self._maker = self._maker or SignatureMaker(points)
        self._known = [*self._known, self._maker.make(picture, points)][-KEPT_FACES:]
