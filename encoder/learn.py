"""A caller's appearance model (thesis eq. 2.17), learned from pictures of the caller and coded.

The mean and each mode are coded as small pictures, one after the other: what a coded picture got
wrong is left in the residual that the next mode is found in (closed loop), so coding errors that
matter are corrected by later modes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.crop import Crop
from encoder.fit import OUTLINE
from encoder.parallel import on_cores
from encoder.refine import Template
from encoder.shape_free import ShapeFree
from encoder.texture import DEPTH_CELL_MM, fill, finest_still, sample, visible_texels
from protocol.pictures import ModeSeries, encode_still, to_luma, to_planes
from protocol.relief import SIDE, encode_relief
from shared_model.appearance import Atlas
from shared_model.mesh import PARTS, Head
from shared_model.parameters import FaceParameters

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
# What hair and neck count beside the face, and how soft the border is, in atlas sides.
OUTSIDE = 0.03
SOFT_EDGE = 0.015


@dataclass(frozen=True, slots=True)
class Appearance:
    """What the decoder will have: coded pictures, and what they decode to.

    texture, modes: the coded pictures.
    mean: (size, size, 3) float32 BGR.
    mode_images: (m, size, size, 3) float32, per unit coefficient.
    """

    texture: bytes
    modes: tuple[bytes, ...]
    mean: Single
    mode_images: Single


@dataclass(frozen=True, slots=True)
class Stack:
    """Shape-free pictures of some frames.

    colours: (t, k, 3) float32 BGR.  seen: (t, k).  weight: (k,) float32.
    """

    colours: Single
    seen: NDArray[np.bool_]
    weight: Single


def face_mask(head: Head, atlas: Atlas) -> Single:
    """(k,) 1 within the face's outline, smoothly `OUTSIDE` in the hair and beyond the jaw.

    The inside of the mouth counts as face.
    """
    points = list(OUTLINE)
    corners = head.triangles[head.network_triangles[points]]
    places = np.einsum(
        "mc,mcd->md", head.network_weights[points], head.texture_coordinates[corners]
    )
    polygon = cv2.convexHull(np.rint(places * atlas.size - 0.5).astype(np.int32))
    mask = np.zeros((atlas.size, atlas.size), np.float32)
    cv2.fillConvexPoly(mask, polygon, 1.0)
    soft = cv2.GaussianBlur(mask, (0, 0), max(0.5, SOFT_EDGE * atlas.size))
    found = np.clip(2 * soft[atlas.rows, atlas.columns], OUTSIDE, 1)
    inside = head.parts[atlas.corners[:, 0]] == PARTS.index("mouth")
    return np.where(inside, 1, found).astype(np.float32)


def within_outline(
    shape: ShapeFree,
    crops: Sequence[Crop],
    faces: Sequence[FaceParameters],
    points: Sequence[Array],
) -> Single:
    """(k,) share of the frames in which each texel lies within the landmarks' outline of the face.

    points: (468, >= 2) pixels, landmarks of each frame.
    """
    count = np.zeros(len(shape), np.float32)
    for crop, face, places in zip(crops, faces, points, strict=True):
        corners = crop.from_frame(places[list(OUTLINE), :2].astype(np.float32))
        mask = np.zeros(crop.picture.shape[:2], np.float32)
        cv2.fillConvexPoly(mask, cv2.convexHull(np.rint(corners).astype(np.int32)), 1.0)
        count += sample(mask, crop.from_frame(shape.positions(face)))[:, 0].clip(0, 1)
    return count / np.float32(max(len(crops), 1))


def shape_free_stack(
    head: Head,
    shape: ShapeFree,
    crops: Sequence[Crop],
    faces: Sequence[FaceParameters],
    vertices: Sequence[Array],
    cell_mm: float = DEPTH_CELL_MM,
    workers: int | None = None,
) -> Stack:
    """Sample the texels of `shape` in every crop.

    vertices: (n, 3) of each frame, head frame.  cell_mm: see `visible_texels`.
    workers: see `on_cores`.
    """

    def look(view: tuple[Crop, FaceParameters, Array]) -> tuple[Single, NDArray[np.bool_], Single]:
        crop, face, mesh = view
        positions = shape.positions(face)
        colours = sample(crop.picture, crop.from_frame(positions))
        seen = visible_texels(head, shape.atlas, face.pose, mesh, cell_mm)
        return colours, seen, texel_areas(shape, positions) * seen

    views = on_cores(look, zip(crops, faces, vertices, strict=True), workers)
    colours, seen, areas = (np.array(parts) for parts in zip(*views, strict=True))
    return Stack(colours, seen, areas.mean(0).astype(np.float32))


def texel_areas(shape: ShapeFree, positions: Single) -> Single:
    """(k,) pixels that each texel covers in the frame."""
    atlas = shape.atlas
    grid = np.full((atlas.size, atlas.size, 2), np.nan, np.float32)
    grid[atlas.rows, atlas.columns] = positions
    across, down = (np.asarray(np.gradient(grid, axis=axis)) for axis in (1, 0))
    area = np.abs(across[..., 0] * down[..., 1] - across[..., 1] * down[..., 0])
    found = area[atlas.rows, atlas.columns]
    usual = float(np.nanmedian(found))
    return np.asarray(np.minimum(np.nan_to_num(found, nan=usual), 4 * usual), np.float32)


def mean_colours(shape: ShapeFree, stack: Stack, unseen: Single) -> Single:
    """(k, 3) mean of what was seen of each texel, else `unseen` (k, 3), or what is around it."""
    count = stack.seen.sum(0)[:, None]
    total = (stack.colours * stack.seen[..., None]).sum(0)
    mean = np.where(count > 0, total / np.maximum(count, 1), unseen).astype(np.float32)
    at = (shape.atlas.rows, shape.atlas.columns)
    image = np.zeros((shape.atlas.size, shape.atlas.size, 3), np.float32)
    known = np.zeros(image.shape[:2], bool)
    known[at] = np.isfinite(mean[:, 0])
    image[at] = np.nan_to_num(mean)
    return fill(image, known)[at]


def luma_modes(stack: Stack, mean: Single, count: int) -> Single:
    """(count, k) leading luma modes of the stack about `mean` (k, 3), for tracking."""
    if not count:
        return np.zeros((0, len(mean)), np.float32)
    residual = to_luma(stack.colours - mean) * stack.seen
    root = np.sqrt(np.maximum(stack.weight, 1e-6))
    _, _, rows = np.linalg.svd(residual * root, full_matrices=False)
    return np.asarray(rows[:count] / root, np.float32)


def template_of(stack: Stack, mean: Single, modes: Single) -> Template:
    """The tracking template of a mean (k, 3) and luma modes (m, k)."""
    return Template(to_luma(mean), modes, stack.weight)


def code_appearance(
    shape: ShapeFree, stack: Stack, mean: Single, mask: Single, face_bytes: int, most_modes: int
) -> Appearance:
    """Code mean and modes within `face_bytes` together, by the quantiser that explains most."""
    if not most_modes:
        texture, decoded = finest_still(_picture(shape, mean), face_bytes)
        size = shape.atlas.size
        return Appearance(texture, (), decoded, np.zeros((0, size, size, 3), np.float32))
    relief = encode_relief(fineness(shape.atlas, stack.weight))
    bench = _Bench(shape, stack, mean, mask, relief, face_bytes, most_modes)
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
    """A stack to be coded in several ways."""

    shape: ShapeFree
    stack: Stack
    mean: Single
    mask: Single
    relief: bytes
    face_bytes: int
    most_modes: int

    def code(self, step: int) -> _Coded:
        """The mean, and as many modes as fit, each found in what the coded ones leave over."""
        size, at = self.shape.atlas.size, (self.shape.atlas.rows, self.shape.atlas.columns)
        texture, mean = encode_still(_picture(self.shape, self.mean), step, self.relief)
        root = np.sqrt(np.maximum(self.stack.weight * self.mask, 1e-6))[:, None]
        support = np.where(self.mask > 2 * OUTSIDE, self.mask, 0)[:, None]
        planes = to_planes(self.stack.colours - mean[at]) * self.stack.seen[..., None]
        frames = (planes * root).reshape(len(planes), -1)
        remainder = _Remainder(frames)
        series, left = ModeSeries(size, self.relief), self.face_bytes - len(texture)
        coded: list[bytes] = []
        images: list[Single] = []
        while len(coded) < self.most_modes:
            direction = np.zeros((size, size, 3), np.float32)
            direction[at] = remainder.strongest().reshape(-1, 3) / root * support
            data, image = series.encode(direction, step)
            row = (to_planes(image[at]) * root).ravel()
            left -= len(data) + MODE_OVERHEAD
            if left < 0 or float(row @ row) < LEAST_ENERGY:
                break
            coded.append(data)
            images.append(image)
            remainder.explain(row)
        shown = np.array(images, np.float32).reshape(-1, size, size, 3)
        error = remainder.error if len(texture) <= self.face_bytes else np.inf
        return _Coded(Appearance(texture, tuple(coded), mean, shown), step, error)


class _Remainder:
    """What coded modes leave of frames (t, d), by least squares; kept as inner products."""

    def __init__(self, frames: Single) -> None:
        self._frames = frames
        self._gram = (frames @ frames.T).astype(np.float64)
        self._rows = np.zeros((0, frames.shape[1]), np.float32)
        self._shares: Array = np.zeros((len(frames), 0))
        self._left: Array = self._gram

    @property
    def error(self) -> float:
        """Mean log2 of the frames' energy that is left."""
        return float(np.log2(np.maximum(np.diag(self._left), 1e-6)).mean())

    def strongest(self) -> Single:
        """(d,) the strongest direction left, as long as frames usually go along it."""
        _, vectors = np.linalg.eigh(self._left)
        vector = vectors[:, -1]
        known = (vector @ self._shares).astype(np.float32) @ self._rows
        found = vector.astype(np.float32) @ self._frames - known
        return np.asarray(found / np.sqrt(np.float32(len(self._frames))), np.float32)

    def explain(self, row: Single) -> None:
        """Take a coded mode (d,) out of the frames."""
        self._rows = np.concatenate([self._rows, row[None]])
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
