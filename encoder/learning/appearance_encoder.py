"""A caller's appearance model (thesis eq. 2.17), coded.

The mean and each mode are coded as small pictures, one after the other: what a coded picture got
wrong is left in the residual that the next mode is found in (closed loop), so coding errors that
matter are corrected by later modes.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.appearance.inpaint import fill
from encoder.appearance.masks import weighting
from encoder.appearance.shape_free import ShapeFree
from encoder.appearance.texture_samples import Stack
from encoder.learning.orthogonal_residual import Remainder
from encoder.picture_coding.image_budget import finest_still
from encoder.picture_coding.picture_encoder import Draft, draft_mode, draft_still
from protocol.pictures.picture_codec import MAX_STEP, ModeSeries, to_planes
from protocol.pictures.probability_model import TEXTURE
from protocol.pictures.weight_map import SIDE, encode_relief
from shared_model.appearance import Atlas

Array = NDArray[np.float64]
Single = NDArray[np.float32]

# The quantiser: where the search for it starts and how far apart it tries, in steps of
# `pictures.step_size`.
FIRST_STEP = 22
STRIDE = 2
# The search usually ends where the mean takes about this share of the bytes; of fewer bytes than
# usual more, by this power, since modes are then coarse and early in a live call show little.
TEXTURE_SHARE, USUAL_BYTES, SHARE_POWER, SHARE_TRIES = 0.36, 7000, 0.8, 2
# Where less than this share of the bytes is used a finer step may fit.
LEAST_USED = 0.96
STEPS_PER_HALVING = 10
# A mode costs a length, a centre, a unit and a column of the basis beside its picture; and what it
# must spare, in mean log2 of the error, for its component takes bits from all others in every
# frame packet.  At 800 bit/s .01 gave carphone .1 dB less, turn the same.
MODE_OVERHEAD = 24
MODE_COST = 0.006
# What a mean costs that takes more than all bytes, beside those: more than any other.
TOO_LARGE = 1e3
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
    picture = whole_atlas(shape, mean)
    relief = encode_relief(fineness(shape.atlas, stack.weight))
    if not most_modes:
        texture, decoded = finest_still(picture, face_bytes, relief, TEXTURE)
        size = shape.atlas.size
        none = np.zeros((0, size, size, 3), np.float32)
        return Appearance(texture, (), decoded, none, ModeSeries(size, relief))
    root, support = weighting(stack.weight * mask, mask)
    frames = to_planes(stack.colours) * root * stack.seen[..., None]
    bench = _Bench(
        shape, stack.seen, frames, root, support, picture, relief, face_bytes, most_modes
    )
    return bench.written(_best(bench))


def _best(bench: "_Bench") -> "_Coded":
    """The least cost: downhill from the likely step, then one step between: the next finer if bytes
    are left over, else where a parabola has its vertex.
    """
    likely = min(max(bench.likely_step(), STRIDE), MAX_STEP - STRIDE)
    tried = [bench.code(likely), bench.code(likely - STRIDE)]
    best = min(tried, key=_cost)
    onwards = STRIDE if best.step == likely else -STRIDE
    while 0 <= best.step + onwards <= MAX_STEP:
        tried.append(bench.code(best.step + onwards))
        if tried[-1].cost >= best.cost:
            break
        best = tried[-1]
    more = {coded.step - best.step: coded.cost - best.cost for coded in tried}
    shift = _vertex(more.get(-STRIDE, TOO_LARGE), more.get(STRIDE, TOO_LARGE))
    if best.size_bytes < LEAST_USED * bench.face_bytes:
        shift = -1
    if not shift or best.step + shift < 0:
        return best
    return min(best, bench.code(best.step + shift), key=_cost)


def _vertex(before: float, after: float) -> int:
    """Steps from the least of three costs, `STRIDE` apart, to a parabola's vertex.

    before, after: by how much more the others cost; the vertex is between even if one is no use.
    """
    return round(STRIDE / 2 * (before - after) / max(before + after, 1e-9))


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
    """Drafts of a mean and its modes, what further ones are coded by, their step, and the mean log2
    of the error left in frames, with what the modes cost them.
    """

    texture: Draft
    modes: tuple[Draft, ...]
    series: ModeSeries
    step: int
    cost: float

    @property
    def size_bytes(self) -> int:
        """What it takes of the budget."""
        modes = sum(mode.size_bytes + MODE_OVERHEAD for mode in self.modes)
        return self.texture.size_bytes + modes


def _cost(coded: _Coded) -> float:
    return coded.cost


@dataclass(frozen=True, slots=True)
class _Bench:
    """The frames of a stack, and the whole atlas of its mean, to be coded in several ways.

    seen: (t, k).  frames: (t, k, 3) planes of what is seen, by the roots of what errors count.
    root, support: see `weighting`.
    """

    shape: ShapeFree
    seen: NDArray[np.bool_]
    frames: Single
    root: Single
    support: Single
    picture: Single
    relief: bytes
    face_bytes: int
    most_modes: int

    def likely_step(self) -> int:
        """About the step at which the mean takes its usual share."""
        step = FIRST_STEP
        scarcity = max(1.0, USUAL_BYTES / max(self.face_bytes, 1))
        most = min(TEXTURE_SHARE * scarcity**SHARE_POWER, 1.0) * self.face_bytes
        for _ in range(SHARE_TRIES):
            size = draft_still(self.picture, step, self.relief, TEXTURE).size_bytes
            octaves = np.log2(size / most)
            step = min(max(step + round(STEPS_PER_HALVING * octaves), 0), MAX_STEP)
        return step

    def code(self, step: int) -> _Coded:
        """The mean, and as many modes as fit, each found in what the coded ones leave over."""
        size, at = self.shape.atlas.size, (self.shape.atlas.rows, self.shape.atlas.columns)
        texture = draft_still(self.picture, step, self.relief, TEXTURE)
        root = self.root
        mean = to_planes(texture.colours[at]) * root
        frames = self.frames - mean * self.seen[..., None]
        remainder = Remainder(frames.reshape(len(frames), -1))
        series = ModeSeries(size, self.relief)
        left = self.face_bytes - texture.size_bytes
        modes: list[Draft] = []
        error = remainder.error if left >= 0 else TOO_LARGE - left
        while len(modes) < self.most_modes:
            direction = np.zeros((size, size, 3), np.float32)
            strongest, _ = remainder.strongest()
            direction[at] = strongest.reshape(-1, 3) / root * self.support
            found = _fitting(series, direction, step, left - MODE_OVERHEAD)
            if found is None:
                break
            taught, mode = found
            row = (to_planes(mode.colours[at]) * root).ravel()
            if float(row @ row) < LEAST_ENERGY:
                break
            remainder.explain(row)
            if error - remainder.error < MODE_COST:
                break
            error, series = remainder.error, taught
            left -= mode.size_bytes + MODE_OVERHEAD
            modes.append(mode)
        return _Coded(texture, tuple(modes), series, step, error + MODE_COST * len(modes))

    def written(self, coded: _Coded) -> Appearance:
        """Drafts as they are sent."""
        modes = tuple(mode.write() for mode in coded.modes)
        shown = np.array([mode.colours for mode in coded.modes], np.float32)
        shown = shown.reshape(-1, *coded.texture.colours.shape)
        texture = coded.texture
        return Appearance(texture.write(), modes, texture.colours, shown, coded.series)


def _fitting(
    series: ModeSeries, direction: Single, step: int, most_bytes: int
) -> tuple[ModeSeries, Draft] | None:
    """A mode within `most_bytes`, coded more coarsely if need be, and the series it belongs to."""
    for coarser in COARSER_LAST if most_bytes >= LEAST_MODE_BYTES else ():
        ours = series.copy()
        mode = draft_mode(ours, direction, min(step + coarser, MAX_STEP))
        if mode.size_bytes <= most_bytes:
            return ours, mode
    return None


def whole_atlas(shape: ShapeFree, colours: Single) -> Single:
    """The whole atlas (size, size, c) of texel colours (k, c), continued smoothly."""
    atlas = shape.atlas
    image = np.zeros((atlas.size, atlas.size, colours.shape[1]), np.float32)
    known = np.zeros((atlas.size, atlas.size), bool)
    image[atlas.rows, atlas.columns] = colours
    known[atlas.rows, atlas.columns] = True
    return fill(image, known)
