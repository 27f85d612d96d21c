"""Shape-free pictures of a caller: what an appearance model is learned from (thesis eq. 2.17)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from encoder.appearance.inpaint import fill
from encoder.appearance.shape_free import ShapeFree, spacing
from encoder.appearance.texel_visibility import DEPTH_CELL_MM, visible_texels
from encoder.appearance.texture import sample
from encoder.capture.face_crop import Crop
from encoder.runtime.parallel import on_cores
from shared_model.mesh import Head
from shared_model.parameters import FaceParameters

Array = NDArray[np.float64]
Single = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Stack:
    """Shape-free pictures of some frames.

    colours: (t, k, 3) float32 BGR, or (t, k, 1) luma.  seen: (t, k).  weight: (k,) float32.
    """

    colours: Single
    seen: NDArray[np.bool_]
    weight: Single


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
    ax, ay, bx, by = spacing(shape.whole(positions), shape.place)
    found = np.abs(ax * by - ay * bx)
    usual = float(np.nanmedian(found))
    return np.asarray(np.minimum(np.nan_to_num(found, nan=usual), 4 * usual), np.float32)


def mean_colours(shape: ShapeFree, stack: Stack, unseen: Single) -> Single:
    """(k, c) mean of what was seen of each texel, else `unseen` (k, c), or what is around it."""
    count = stack.seen.sum(0)[:, None]
    total = (stack.colours * stack.seen[..., None]).sum(0)
    mean = np.where(count > 0, total / np.maximum(count, 1), unseen).astype(np.float32)
    at = (shape.atlas.rows, shape.atlas.columns)
    image = np.zeros((shape.atlas.size, shape.atlas.size, mean.shape[1]), np.float32)
    known = np.zeros(image.shape[:2], bool)
    known[at] = np.isfinite(mean[:, 0])
    image[at] = np.nan_to_num(mean)
    return fill(image, known)[at]
