"""Appearance modes learned while a live call goes on, one by one.

What a caller's model cannot show of the last few seconds is left over; its strongest direction is
the next mode.  It is coded as the modes of the model packet are, and goes out at once.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.appearance.masks import weighting
from encoder.capture.face_crop import Crop
from encoder.learning.orthogonal_residual import Remainder
from encoder.learning.person_model import Caller, shape_free_views, sharpened_stack
from encoder.picture_coding.picture_encoder import draft_mode, held_share
from protocol.frames.frame_transform import SPARE_HARM_GREY
from protocol.pictures.picture_codec import (
    MAX_STEP,
    STEPS_PER_OCTAVE,
    ModeSeries,
    to_luma,
    to_planes,
)
from shared_model.parameters import FaceParameters

Array = NDArray[np.float64]
Single = NDArray[np.float32]

# How long a look counts at all, after what time half as much, and how often to look at most: the
# times are those of a source that can be looked at so often.
WINDOW_S = 3.0
HALF_LIFE_S = 1.0
LOOKS_PER_S = 8.0
MOST_LOOKS = round(WINDOW_S * LOOKS_PER_S)
# Modes may take this much, and save up for one second.
BYTES_PER_S = 1200.0
# A mode must explain this share of what is left over; one that is expected to explain less than
# this part of that is not coded to find out.
LEAST_GAIN, HOPELESS = 0.04, 0.5
# The quantiser's step for a mode as strong as frames show it, in steps of `pictures.step_size`.
FIRST_STEP = 28
# A mode of more bytes is coded by so many steps more coarsely, and the next one a turn finer than
# that: soon is better than fine.
MOST_BYTES = 500
COARSER = 4
# Fewer looks teach nothing that the next one would not undo.
LEAST_LOOKS = 2


@dataclass(frozen=True, slots=True)
class Grown:
    """A new mode: coded, and the luma (size, size) that it adds to the texture per coefficient."""

    data: bytes
    luma: Single


@dataclass(frozen=True, slots=True)
class Look:
    """A picture of the caller, and the landmarks (468, 3) in its frame, pixels.

    face: as it was found there; None: by another model, or not yet.
    """

    crop: Crop
    points: Array
    face: FaceParameters | None = None


class Grower:
    """Finds modes that one model of a caller lacks.

    find: how the face is in a look, by that model.
    """

    def __init__(self, caller: Caller, find: Callable[[Look], FaceParameters]) -> None:
        self._caller, self._find = caller, find
        appearance, shape = caller.appearance, caller.shape
        self._at = (shape.atlas.rows, shape.atlas.columns)
        self._mean = appearance.mean[self._at]
        self._root, self._support = weighting(caller.weight, caller.mask)
        self._series = appearance.series
        self._coarser = 0
        self._remainder = Remainder(np.zeros((0, 3 * len(shape)), np.float32))
        for image in appearance.mode_images:
            self._remainder.explain(self._weighted(image[self._at]))

    def grow(self, looks: Sequence[Look], room_bytes: float, most: int) -> list[Grown]:
        """New modes, after some more looks: until they take `room_bytes`, at most `most`."""
        for look in looks:
            self._remainder.add(self._left_over(look))
            if len(self._remainder) > MOST_LOOKS:
                self._remainder.forget()
        found: list[Grown] = []
        while len(self._remainder) >= LEAST_LOOKS and room_bytes > 0 and len(found) < most:
            mode = self._next()
            if mode is None:
                break
            found.append(mode)
            room_bytes -= len(mode.data)
        return found

    def _left_over(self, look: Look) -> Single:
        """(3 k,) weighted planes of what the mean leaves of a look; nothing where it is unseen."""
        crops, faces = [look.crop], [look.face or self._find(look)]
        shape, face = self._caller.shape, self._caller.face
        stack = shape_free_views(face.head, shape, face, crops, faces, 1)
        sharp = sharpened_stack(shape, stack, crops, faces, 1)
        colours = (sharp.colours[0] - self._mean) * sharp.seen[0][:, None]
        return self._weighted(np.asarray(colours, np.float32))

    def _weighted(self, colours: Single) -> Single:
        return np.asarray((to_planes(colours) * self._root).ravel(), np.float32)

    def _next(self) -> Grown | None:
        """The strongest mode, if it is worth its bytes."""
        age = np.arange(len(self._remainder))[::-1]
        recency = np.exp2(-age / (2 * HALF_LIFE_S * LOOKS_PER_S))
        strongest, share = self._remainder.strongest(recency)
        # No mode explains more than the strongest direction holds.
        if share < LEAST_GAIN:
            return None
        direction = strongest.reshape(-1, 3) / self._root * self._support
        size = len(self._caller.appearance.mean)
        # Scaled so that its component's unit is what spare components have.
        rms = np.sqrt(((direction * self._root) ** 2).sum() / (self._root**2).sum())
        scale = SPARE_HARM_GREY / max(float(rms), 1e-3)
        step = round(FIRST_STEP + STEPS_PER_OCTAVE * np.log2(scale))
        planes = np.zeros((size, size, 3), np.float32)
        planes[self._at] = direction * np.float32(scale)
        coarser = max(0, self._coarser - COARSER)
        held = held_share(self._series, planes, min(max(step + coarser, 0), MAX_STEP))
        if share * held < HOPELESS * LEAST_GAIN:
            return None
        self._coarser = coarser
        series, data, image = self._coded(planes, step)
        row = self._weighted(image[self._at])
        if not row.any():
            return None
        before = self._remainder.energy(recency)
        self._remainder.explain(row)
        if before - self._remainder.energy(recency) < LEAST_GAIN * before:
            self._remainder.withdraw()
            return None
        self._series = series
        return Grown(data, to_luma(image))

    def _coded(self, planes: Single, step: int) -> tuple[ModeSeries, bytes, Single]:
        """A mode as it is coded from `step` on, and the series that it then belongs to."""
        while True:
            series = self._series.copy()
            found = min(max(step + self._coarser, 0), MAX_STEP)
            draft = draft_mode(series, planes, found)
            if draft.size_bytes <= MOST_BYTES or found == MAX_STEP:
                return series, draft.write(), draft.colours
            self._coarser += COARSER
