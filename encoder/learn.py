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
from encoder.refine import Template
from encoder.shape_free import ShapeFree
from encoder.texture import compress, fill, sample, visible_texels
from shared_model.appearance import Atlas, resized
from shared_model.mesh import PARTS, Head
from shared_model.parameters import FaceParameters

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Picture = NDArray[np.uint8]

# How much an error of each chroma difference counts against one of luma.
CHROMA = 0.3
MODE_REACH = 115.0
# Modes are smoother than faces: they are coded at this part of the texture's size, no larger than
# this, and rather coarsely.  Measured on akiyo, carphone and turn: more modes gain more than finer
# ones.
MODE_SCALE = 0.75
MODE_SIDE = 100
MODE_QUALITY = 20
# What hair and neck count beside the face, and how soft the border is, in atlas sides.
OUTSIDE = 0.1
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


def shape_free_stack(
    head: Head,
    shape: ShapeFree,
    crops: Sequence[Crop],
    faces: Sequence[FaceParameters],
    vertices: Sequence[Array],
) -> Stack:
    """Sample the texels of `shape` in every crop.  vertices: (n, 3) of each frame, head frame."""
    colours, seen, areas = [], [], []
    for crop, face, mesh in zip(crops, faces, vertices, strict=True):
        positions = shape.positions(face)
        colours.append(sample(crop.picture, crop.from_frame(positions)))
        seen.append(visible_texels(head, shape.atlas, face.pose, mesh))
        areas.append(texel_areas(shape, positions) * seen[-1])
    return Stack(np.array(colours), np.array(seen), np.mean(areas, axis=0).astype(np.float32))


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


def to_luma(colours: Single) -> Single:
    """Luma (...,) of BGR colours (..., 3)."""
    return np.asarray(colours @ np.array([0.114, 0.587, 0.299], np.float32))


def template_of(stack: Stack, mean: Single, modes: Single) -> Template:
    """The tracking template of a mean (k, 3) and luma modes (m, k)."""
    return Template(to_luma(mean), modes, stack.weight)


def code_appearance(
    shape: ShapeFree,
    stack: Stack,
    mean: Single,
    mask: Single,
    texture_bytes: int,
    modes_bytes: int,
    most_modes: int,
) -> Appearance:
    """Code the mean within `texture_bytes`, then modes one by one within `modes_bytes` together."""
    texture = compress(_picture(shape, mean), texture_bytes)
    mean_image = _decoded(texture, shape.atlas.size)
    at = (shape.atlas.rows, shape.atlas.columns)
    planes = _planes(stack.colours - mean_image[at]) * stack.seen[..., None]
    root = np.sqrt(np.maximum(stack.weight * mask, 1e-6))[:, None]
    support = np.where(mask > 2 * OUTSIDE, mask, 0)[:, None]
    residual = (planes * root).reshape(len(planes), -1)
    coded: list[bytes] = []
    images: list[Single] = []
    left = modes_bytes
    while len(coded) < most_modes:
        data = _next_mode(shape, residual, root, support, left)
        if data is None:
            break
        image = _decoded(data, shape.atlas.size) - 128.0
        row = (_planes(image[at]) * root).ravel()
        energy = float(row @ row)
        if energy < 1e-6:
            break
        coded.append(data)
        images.append(image)
        left -= len(data)
        basis = _orthonormal(np.array([(_planes(i[at]) * root).ravel() for i in images]))
        full = (planes * root).reshape(len(planes), -1)
        residual = full - (full @ basis.T) @ basis
    shown = np.array(images, np.float32).reshape(-1, *mean_image.shape)
    return Appearance(texture, tuple(coded), mean_image, shown)


def _next_mode(
    shape: ShapeFree, residual: Single, root: Single, support: Single, left: int
) -> bytes | None:
    """The strongest direction left, as a coded picture; None if it takes more than `left` bytes."""
    gram = residual @ residual.T
    _, vectors = np.linalg.eigh(gram.astype(np.float64))
    direction = (vectors[:, -1] @ residual).reshape(-1, 3) / root * support
    colours = _unplanes(direction.astype(np.float32))
    peak = float(np.percentile(np.abs(colours), 99.8))
    scaled = np.clip(colours * (MODE_REACH / max(peak, 1e-9)), -127, 127) + 128
    side = min(round(MODE_SCALE * shape.atlas.size), MODE_SIDE)
    picture = cv2.resize(_picture(shape, scaled, 128.0), (side, side), interpolation=cv2.INTER_AREA)
    data = _webp(np.asarray(picture, np.uint8), MODE_QUALITY)
    return data if len(data) <= left else None


def _picture(shape: ShapeFree, colours: Single, around: float | None = None) -> Picture:
    """The whole atlas of texel colours (k, 3), continued smoothly; uint8 BGR."""
    atlas = shape.atlas
    image = np.zeros((atlas.size, atlas.size, 3), np.float32)
    known = np.zeros((atlas.size, atlas.size), bool)
    image[atlas.rows, atlas.columns] = colours
    known[atlas.rows, atlas.columns] = True
    whole = fill(image, known) if around is None else np.where(known[..., None], image, around)
    return np.asarray(np.clip(np.rint(whole), 0, 255), np.uint8)


def _planes(colours: Single) -> Single:
    """BGR differences (..., 3) to luma and weighted chroma differences."""
    y = to_luma(colours)
    blue, red = colours[..., 0] - y, colours[..., 2] - y
    return np.asarray(np.stack([y, CHROMA * blue, CHROMA * red], -1), np.float32)


def _unplanes(planes: Single) -> Single:
    y = planes[..., 0]
    blue, red = y + planes[..., 1] / CHROMA, y + planes[..., 2] / CHROMA
    green = (y - 0.114 * blue - 0.299 * red) / 0.587
    return np.asarray(np.stack([blue, green, red], -1), np.float32)


def _orthonormal(rows: Single) -> Single:
    q, _ = np.linalg.qr(rows.T.astype(np.float64))
    return np.asarray(q.T, np.float32)


def _webp(picture: Picture, quality: int) -> bytes:
    done, data = cv2.imencode(".webp", picture, [cv2.IMWRITE_WEBP_QUALITY, quality])
    assert done
    return data.tobytes()


def _decoded(data: bytes, size: int) -> Single:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return resized(np.asarray(image, np.float32), size)
