"""Faces with known action units: a real face whose pixels are moved as the muscles would.

The labelled databases of the thesis (MMI, FG-NET) cannot be had here.  What these pictures lack is
what moving pixels cannot make: wrinkles, teeth, and the way in which people differ in a gesture.
"""

from dataclasses import replace

import cv2
import numpy as np

from aam.shape_space import LOW, actuators, shape_vector
from aam.warps import head_warp
from benchmarks.validate_aam.samples import Sample
from runtime.image_ops import hull_mask
from shared_model.arrays import Array, Picture, Single
from shared_model.parameters import EAU_INDEX, EAUS, clip_eau

# EAUs of each action unit at full intensity (Table 2.3), of those that Tables 3.3 and 3.4 name.
UNITS: dict[str, dict[str, float]] = {
    "AU1": {"eyebrow_inner": 1.0},
    "AU2": {"eyebrow_middle": 1.0, "eyebrow_outer": 1.0},
    "AU4": {"eyebrow_middle": -1.0, "eyebrow_inner": -1.0},
    "AU12": {"mouth_corners": 1.0},
    "AU15": {"mouth_corners": -1.0},
    "AU26": {"jaw_drop": 1.0},
}
EXPRESSIONS: tuple[tuple[str, ...], ...] = (
    (),
    ("AU1",),
    ("AU2",),
    ("AU1", "AU2"),
    ("AU4",),
    ("AU12",),
    ("AU15",),
    ("AU26",),
    ("AU12", "AU26"),
    ("AU1", "AU2", "AU26"),
    ("AU1", "AU15"),
)
INTENSITIES = (0.6, 1.0)
# Expressions are drawn on faces at rest: the mouth's EAUs are below this, of their ranges.  What
# the annotation says of the brows is a part of who it is: no face has all of its EAUs below .1.
REST, REST_EAUS = 0.25, ("jaw_drop", "mouth_corners")
TEXELS = 256
INNER_LIPS = (
    *(78, 191, 80, 81, 82, 13, 312, 311, 310, 415, 308),
    *(324, 318, 402, 317, 14, 87, 178, 88, 95),
)
# What shows between the lips.
MOUTH_BGR = (35, 30, 45)


def is_at_rest(sample: Sample) -> bool:
    """Whether expressions are drawn on a face, see `REST`."""
    return all(abs(float(sample.eau[EAU_INDEX[name]])) < REST for name in REST_EAUS)


def with_units(sample: Sample, units: tuple[str, ...], intensity: float) -> Sample:
    """The sample at rest but for some units.

    Its landmarks are those of the model, moved.
    """
    eau = np.zeros(len(EAUS))
    for unit in units:
        for name, value in UNITS[unit].items():
            eau[EAU_INDEX[name]] += intensity * value
    aau, _ = actuators(sample.face.shape)
    shape = shape_vector(aau, clip_eau(eau))
    return moved(sample, shape)


def moved(sample: Sample, shape: Array) -> Sample:
    """The sample with another shape vector (25,); its pixels follow the texels."""
    assert shape.shape == LOW.shape
    warp, face, picture = head_warp(TEXELS, "full"), sample.face, sample.face.window.picture
    before, after = (warp.positions(each, face.pose) for each in (face.shape, shape))
    colours = cv2.remap(picture, *_grid(before), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    colours = np.asarray(colours, np.uint8).reshape(-1, 3)[: before.shape[1]]
    index, points = warp.landmark_index, warp.landmarks(shape, face.pose)
    drawn = _splatted(after, colours, points[np.isin(index, INNER_LIPS)], picture)
    shift = points - warp.landmarks(face.shape, face.pose)
    landmarks = np.array(sample.landmarks)
    landmarks[index] += shift
    window = replace(face.window, picture=drawn)
    return Sample(replace(face, window=window, shape=shape), landmarks)


def _splatted(places: Single, colours: Picture, lips: Array, behind: Picture) -> Picture:
    """Texels drawn on a picture, and the mouth where they leave a gap between the lips (n, 2)."""
    height, width = behind.shape[:2]
    at = np.rint(places).astype(int)
    inside = (at[0] >= 0) & (at[0] < width) & (at[1] >= 0) & (at[1] < height)
    total, weight = np.zeros((height, width, 3)), np.zeros((height, width))
    np.add.at(total, (at[1, inside], at[0, inside]), colours[inside].astype(float))
    np.add.at(weight, (at[1, inside], at[0, inside]), 1.0)
    # Texels are sparse on the nose and the forehead: gaps take what is about them, but for that
    # between the lips.
    face, gap = total / np.maximum(weight, 1)[..., None], weight == 0
    mouth = hull_mask(lips, (height, width)) * gap
    for sigma in (0.7, 2.0, 5.0):
        near = cv2.GaussianBlur(weight, (0, 0), sigma)
        filled = cv2.GaussianBlur(total, (0, 0), sigma) / np.maximum(near, 1e-6)[..., None]
        is_new = gap & (near > 0.02)
        face[is_new], gap[is_new] = filled[is_new], False
    cover = 1 - np.asarray(cv2.GaussianBlur(mouth, (0, 0), 0.5))
    outline = hull_mask(places.T.astype(np.float64), (height, width))
    outline = np.asarray(cv2.GaussianBlur(outline, (0, 0), 1.0))
    within = cover[..., None] * face + (1 - cover[..., None]) * np.array(MOUTH_BGR)
    mixed = outline[..., None] * within + (1 - outline[..., None]) * behind
    return np.asarray(np.clip(mixed, 0, 255), np.uint8)


def _grid(places: Single) -> tuple[Single, Single]:
    columns = 1024
    count = places.shape[1]
    padded = np.zeros((2, -(-count // columns) * columns), np.float32)
    padded[:, :count] = places
    x, y = padded.reshape(2, -1, columns)
    return x, y
