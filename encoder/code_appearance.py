"""A caller's appearance model (thesis eq. 2.17), coded.

The mean and each mode are coded as small pictures, one after the other: what a coded picture got
wrong is left in the residual that the next mode is found in (closed loop), so coding errors that
matter are corrected by later modes.
"""

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.learn import OUTSIDE, Stack
from encoder.shape_free import ShapeFree
from encoder.texture import fill, finest_still
from protocol.pictures import MAX_STEP, ModeSeries, encode_still, to_planes
from protocol.relief import SIDE, encode_relief
from shared_model.appearance import Atlas

Array = NDArray[np.float64]
Single = NDArray[np.float32]

# The quantiser: where the search for it starts and how far apart it tries, in steps of
# `pictures.step_size`.  Measured on six callers.
FIRST_STEP = 28
STEP_STRIDES = (4, 2)
MOST_TRIES = 3
# A mode costs a length, a centre, a unit and a column of the basis beside its picture.
MODE_OVERHEAD = 20
LEAST_ENERGY = 1e-3
# A last mode for which there is too little room is coded by so many steps more coarsely; in less
# than so many bytes none is worth having.
COARSER_LAST = (0, 4, 8, 12, 16)
LEAST_MODE_BYTES = 40


@dataclass(frozen=True, slots=True)
class Appearance:
    """What the decoder will have: coded pictures, and what they decode to.

    texture, modes: the coded pictures.
    mean: (size, size, 3) float32 BGR.
    mode_images: (m, size, size, 3) float32, per unit coefficient.
    series: what further modes are coded by.
    """

    texture: bytes
    modes: tuple[bytes, ...]
    mean: Single
    mode_images: Single
    series: ModeSeries


def code_appearance(
    shape: ShapeFree, stack: Stack, mean: Single, mask: Single, face_bytes: int, most_modes: int
) -> Appearance:
    """Code mean and modes within `face_bytes` together, by the quantiser that explains most."""
    picture = _picture(shape, mean)
    relief = encode_relief(fineness(shape.atlas, stack.weight))
    if not most_modes:
        texture, decoded = finest_still(picture, face_bytes, relief)
        size = shape.atlas.size
        none = np.zeros((0, size, size, 3), np.float32)
        return Appearance(texture, (), decoded, none, ModeSeries(size, relief))
    bench = _Bench(shape, stack, picture, mask, relief, face_bytes, most_modes)
    best = bench.code(FIRST_STEP)
    for stride in STEP_STRIDES:
        for turn in (stride, -stride):
            first = best.step
            for tries in range(1, MOST_TRIES + 1):
                found = bench.code(first + tries * turn)
                if found.error >= best.error:
                    break
                best = found
            if best.step != first:
                break
    return best.appearance


def weighting(weight: Single, mask: Single) -> tuple[Single, Single]:
    """(k, 1) roots of what errors count, and where modes paint how much.

    weight: (k,) pixels that each texel covers, less beside the face.  mask: see `face_mask`.
    """
    root = np.sqrt(np.maximum(weight, 1e-6))
    return root[:, None], np.where(mask > 2 * OUTSIDE, mask, 0)[:, None]


def fineness(atlas: Atlas, weight: Single) -> Array:
    """How finely each cell of the atlas' relief should be coded: errors count by `weight` (k,)."""
    cell = atlas.rows * SIDE // atlas.size * SIDE + atlas.columns * SIDE // atlas.size
    root = np.sqrt(np.maximum(weight, 0))
    usual = max(float(np.median(root)), 1e-3)
    count = np.bincount(cell, minlength=SIDE * SIDE)
    total = np.bincount(cell, root, SIDE * SIDE)
    mean = np.where(count > 0, total / np.maximum(count, 1), usual)
    return np.maximum(mean / usual, 1e-3).reshape(SIDE, SIDE)


@dataclass(frozen=True, slots=True)
class _Coded:
    """An appearance, its modes' step, and the mean log2 of the error left in the frames."""

    appearance: Appearance
    step: int
    error: float


@dataclass(frozen=True, slots=True)
class _Bench:
    """A stack, and the whole atlas of its mean, to be coded in several ways."""

    shape: ShapeFree
    stack: Stack
    picture: Single
    mask: Single
    relief: bytes
    face_bytes: int
    most_modes: int

    def code(self, step: int) -> _Coded:
        """The mean, and as many modes as fit, each found in what the coded ones leave over."""
        size, at = self.shape.atlas.size, (self.shape.atlas.rows, self.shape.atlas.columns)
        texture, mean = encode_still(self.picture, step, self.relief)
        root, support = weighting(self.stack.weight * self.mask, self.mask)
        planes = to_planes(self.stack.colours - mean[at]) * self.stack.seen[..., None]
        frames = (planes * root).reshape(len(planes), -1)
        remainder = Remainder(frames)
        series, left = ModeSeries(size, self.relief), self.face_bytes - len(texture)
        coded: list[bytes] = []
        images: list[Single] = []
        while len(coded) < self.most_modes:
            direction = np.zeros((size, size, 3), np.float32)
            direction[at] = remainder.strongest().reshape(-1, 3) / root * support
            found = _fitting(series, direction, step, left - MODE_OVERHEAD)
            if found is None:
                break
            taught, data, image = found
            row = (to_planes(image[at]) * root).ravel()
            if float(row @ row) < LEAST_ENERGY:
                break
            series = taught
            left -= len(data) + MODE_OVERHEAD
            coded.append(data)
            images.append(image)
            remainder.explain(row)
        shown = np.array(images, np.float32).reshape(-1, size, size, 3)
        error = remainder.error if len(texture) <= self.face_bytes else np.inf
        return _Coded(Appearance(texture, tuple(coded), mean, shown, series), step, error)


def _fitting(
    series: ModeSeries, direction: Single, step: int, most_bytes: int
) -> tuple[ModeSeries, bytes, Single] | None:
    """A mode within `most_bytes`, coded more coarsely if need be, and the series it belongs to."""
    for coarser in COARSER_LAST if most_bytes >= LEAST_MODE_BYTES else ():
        ours = deepcopy(series)
        data, image = ours.encode(direction, min(step + coarser, MAX_STEP))
        if len(data) <= most_bytes:
            return ours, data, image
    return None


class Remainder:
    """What coded modes (m, d) leave of frames (t, d), by least squares; kept as inner products."""

    def __init__(self, frames: Single, modes: Sequence[Single] = ()) -> None:
        self._frames = frames
        self._gram = (frames @ frames.T).astype(np.float64)
        self._rows = np.zeros((0, frames.shape[1]), np.float32)
        self._shares: Array = np.zeros((len(frames), 0))
        self._left: Array = self._gram
        if len(modes):
            self._explain(np.array(modes))

    @property
    def error(self) -> float:
        """Mean log2 of the frames' energy that is left."""
        return float(np.log2(np.maximum(np.diag(self._left), 1e-6)).mean())

    @property
    def energy(self) -> float:
        """What is left of the frames' energy."""
        return float(np.trace(self._left))

    @property
    def strongest_share(self) -> float:
        """What share of that one more mode could explain."""
        return float(np.linalg.eigvalsh(self._left)[-1] / max(self.energy, 1e-9))

    def strongest(self) -> Single:
        """(d,) the strongest direction left, as long as frames usually go along it."""
        _, vectors = np.linalg.eigh(self._left)
        vector = vectors[:, -1]
        known = (vector @ self._shares).astype(np.float32) @ self._rows
        found = vector.astype(np.float32) @ self._frames - known
        return np.asarray(found / np.sqrt(np.float32(len(self._frames))), np.float32)

    def explain(self, row: Single) -> None:
        """Take a coded mode (d,) out of the frames."""
        self._explain(row[None])

    def _explain(self, rows: Single) -> None:
        self._rows = np.concatenate([self._rows, rows])
        inner = (self._rows @ self._rows.T).astype(np.float64)
        inner[np.diag_indices(len(inner))] *= 1 + 1e-9
        along = (self._frames @ self._rows.T).astype(np.float64)
        self._shares = np.asarray(np.linalg.solve(inner, along.T).T)
        self._left = np.asarray(self._gram - self._shares @ along.T, np.float64)


def _picture(shape: ShapeFree, colours: Single) -> Single:
    """The whole atlas of texel colours (k, 3), continued smoothly."""
    atlas = shape.atlas
    image = np.zeros((atlas.size, atlas.size, 3), np.float32)
    known = np.zeros((atlas.size, atlas.size), bool)
    image[atlas.rows, atlas.columns] = colours
    known[atlas.rows, atlas.columns] = True
    return fill(image, known)
