"""Texture samples: the shape-free textures of several frames, which appearance models are built
from (thesis eq. 2.17)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from encoder.appearance.shape_free import ShapeFreeFrame, warp_jacobian
from encoder.appearance.texel_visibility import DEPTH_CELL_MM, visible_texels
from encoder.capture.face_crop import Crop
from runtime.image_ops import sample_bicubic
from runtime.jit import jit
from runtime.parallel import parallel_map
from shared_model.appearance import pull_push_fill
from shared_model.arrays import Array, Mask, Single
from shared_model.parameters import FaceParameters

# No texel's footprint exceeds this multiple of the median.
MAX_FOOTPRINT = 4


@dataclass(frozen=True, slots=True)
class TextureSamples:
    """The texels of t frames.

    colours: (t, k, 3) float32 BGR, or (t, k, 1) luma.  visible: (t, k).
    weight: (k,) float32, of each texel's squared errors; as sampled, the mean number of pixels
    that the texel covers.
    """

    colours: Single
    visible: Mask
    weight: Single


def sample_textures(
    shape_free: ShapeFreeFrame,
    crops: Sequence[Crop],
    faces: Sequence[FaceParameters],
    vertices: Sequence[Array],
    cell_mm: float = DEPTH_CELL_MM,
    workers: int | None = None,
) -> TextureSamples:
    """Sample the texels in every crop.

    vertices: of each frame, (n, 3) mm, head frame.  cell_mm: see `visible_texels`.
    workers: see `parallel_map`.
    """

    def sample(view: tuple[Crop, FaceParameters, Array]) -> tuple[Single, Mask, Single]:
        crop, face, mesh = view
        positions = shape_free.positions(face)
        in_crop = crop.to_crop_px(positions)
        colours = sample_bicubic(crop.picture, in_crop)
        visible = visible_texels(shape_free.atlas, face.pose, mesh, cell_mm)
        visible &= crop.shows(in_crop)
        return colours, visible, texel_footprints(shape_free, positions) * visible

    views = parallel_map(sample, zip(crops, faces, vertices, strict=True), workers)
    colours, visible, footprints = (np.array(parts) for parts in zip(*views, strict=True))
    return TextureSamples(colours, visible, footprints.mean(0).astype(np.float32))


def texel_footprints(shape_free: ShapeFreeFrame, positions: Single) -> Single:
    """(k,) area of each texel in the frame, pixels^2.

    positions: (k, 2) of the texels, pixels.
    """
    ax, ay, bx, by = warp_jacobian(shape_free.to_grid(positions), shape_free.flat_index)
    areas = np.abs(ax * by - ay * bx)
    median = float(np.nanmedian(areas))
    known = np.nan_to_num(areas, nan=median)
    return np.asarray(np.minimum(known, MAX_FOOTPRINT * median), np.float32)


def mean_texture(shape_free: ShapeFreeFrame, samples: TextureSamples, default: Single) -> Single:
    """(k, c) mean colour of each texel over the frames that show it.

    default: (k, c) colours of texels that no frame shows; nan: filled from their surroundings.
    """
    atlas = shape_free.atlas
    mean = _mean_of_visible(samples.colours, samples.visible, default.astype(np.float32))
    at = atlas.rows, atlas.columns
    image = np.zeros((atlas.size, atlas.size, mean.shape[1]), np.float32)
    known = np.zeros(image.shape[:2], bool)
    known[at] = np.isfinite(mean[:, 0])
    image[at] = np.nan_to_num(mean)
    return pull_push_fill(image, known)[at]


@jit
def _mean_of_visible(colours: Single, visible: Mask, default: Single) -> Single:
    """(k, c) mean of colours (t, k, c) where a texel is visible (t, k), nowhere: `default`."""
    total, count = np.zeros_like(default), np.zeros(len(default), np.int64)
    for frame in range(len(colours)):
        for texel in range(len(default)):
            if visible[frame, texel]:
                count[texel] += 1
                for channel in range(default.shape[1]):
                    total[texel, channel] += colours[frame, texel, channel]
    for texel in range(len(default)):
        for channel in range(default.shape[1]):
            if count[texel]:
                total[texel, channel] = total[texel, channel] / np.float64(count[texel])
            else:
                total[texel, channel] = default[texel, channel]
    return total
