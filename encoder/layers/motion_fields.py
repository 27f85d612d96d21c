"""Motion fields of a person: how shoulders and hair move in addition to the head's motion.

Optical flow from the canonical frame to each other one, less the head's motion, gives coarse
displacements; their principal components are the fields.
"""

import cv2
import numpy as np

from encoder.layers.displacement import dense, pixel_grid, sample
from encoder.layers.layer_samples import COARSE_SIDE, LayerSamples, face_region
from protocol.pictures.layered_background import MAX_FIELD_CODE, field_shape
from runtime.cauchy_weight import cauchy_weight
from runtime.parallel import parallel_map
from shared_model.arrays import Array, Integers, Picture, Single

MAX_FIELDS = 6
# A field must explain this share of the motion, and its displacement be so large, coarse pixels.
MIN_SHARE, MIN_MOTION_PX = 0.01, 0.08
# Flow whose pictures differ by so many grey levels counts half.
MATCH_GREY = 10.0
# Contrast, grey levels per pixel, at which flow counts half; what counts in any case.
CONTRAST_GREY, MIN_CONFIDENCE = 3.0, 0.01
# Standard deviation of the kernel by which flow is smoothed, in cells of a field.
SMOOTHING_CELLS = 0.8
# The largest code of a field.
FULL_CODE = 32


def motion_fields(samples: LayerSamples) -> Integers:
    """(k, rows, columns, 2) codes of the fields, see `LayeredBackground`; k may be 0."""
    motions, weight = _own_motions(samples)
    count = len(motions)
    # A field is weighted by how much of the person is at each of its points.
    root = np.sqrt(np.maximum(weight, 1e-3))[..., None]
    rows = ((motions - motions.mean(0)) * root).reshape(count, -1)
    _, sizes, axes = np.linalg.svd(rows, full_matrices=False)
    power = sizes**2
    rms_px = np.sqrt(power / count / max(weight.sum(), 1e-6))
    ratio = min(1.0, COARSE_SIDE / max(samples.size))
    large = (power > MIN_SHARE * power.sum()) & (rms_px * ratio > MIN_MOTION_PX)
    chosen = axes[:MAX_FIELDS][large[:MAX_FIELDS]].reshape(-1, *motions.shape[1:]) / root
    return field_codes(chosen)


def field_codes(fields: Array) -> Integers:
    """The codes of fields (k, rows, columns, 2), each at a scale of its own."""
    return np.array([_codes(field) for field in fields], np.int64).reshape(fields.shape)


def _codes(field: Array) -> Integers:
    largest = max(float(np.abs(field).max()), 1e-9)
    return np.rint(np.clip(field / largest * FULL_CODE, -MAX_FIELD_CODE, MAX_FIELD_CODE)).astype(
        np.int64
    )


def _own_motions(samples: LayerSamples) -> tuple[Array, Array]:
    """(n, rows, columns, 2) source pixels, own motion of each frame; (rows, columns) weights."""
    lumas = [frame.luma for frame in samples.coarse_frames()]
    shape = lumas[0].shape
    canonical = lumas[samples.canonical]
    confidence = _confidence(samples, canonical)

    def own_motion(number: int) -> tuple[Array, Array]:
        luma, motion = lumas[number], samples.motion[number]
        flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        with_head = dense(motion, samples.size, (shape[0], shape[1]))
        moved = flow.calc(_bytes(canonical), _bytes(luma), with_head.copy())
        at = pixel_grid((shape[0], shape[1])) + np.asarray(moved, np.float32)
        error = sample(luma, at) - canonical
        around = np.asarray(cv2.blur(error, (3, 3)), np.float32)
        weight = np.asarray(cauchy_weight(around, MATCH_GREY, confidence), np.float32)
        return _smoothed(np.asarray(moved, np.float32) - with_head, weight, samples.size)

    each = parallel_map(own_motion, range(len(lumas)), samples.workers)
    motions, weights = zip(*each, strict=True)
    return np.array(motions), np.mean(weights, 0)


def _confidence(samples: LayerSamples, canonical: Single) -> Single:
    """(h, w) weight of the flow: on the person, outside the face, where there is contrast."""
    shape = (canonical.shape[0], canonical.shape[1])
    matte = samples.mattes_at(shape)[samples.canonical]
    across, down = (cv2.Sobel(canonical, cv2.CV_32F, *d) / 8 for d in ((1, 0), (0, 1)))
    contrast = cv2.GaussianBlur(across**2 + down**2, (0, 0), 1.5)
    share = contrast / (contrast + CONTRAST_GREY**2) + MIN_CONFIDENCE
    outside = ~face_region(samples.outlines_px[samples.canonical], samples.size, shape)
    return np.asarray(share * (matte > 0.5) * (0.1 + 0.9 * outside), np.float32)


def _smoothed(flow: Single, weight: Single, size: tuple[int, int]) -> tuple[Array, Array]:
    """A displacement (rows, columns, 2) at the points of a field, source pixels, and its weight."""
    rows, columns = field_shape(*size)
    height, width = weight.shape
    cell = max(height / (rows - 1), width / (columns - 1))
    sigma = SMOOTHING_CELLS * cell
    known = cv2.GaussianBlur(weight, (0, 0), sigma)
    mean = cv2.GaussianBlur(flow * weight[..., None], (0, 0), sigma)
    wide = cv2.GaussianBlur(weight, (0, 0), 3 * sigma) + 1e-6
    wide_mean = cv2.GaussianBlur(flow * weight[..., None], (0, 0), 3 * sigma)
    # Where little is known nearby, what is known farther away counts.
    blend = 0.05 * wide
    smooth = (mean + blend[..., None] * wide_mean / wide[..., None]) / (known + blend)[..., None]
    ends = np.linspace(0, width - 1, columns), np.linspace(0, height - 1, rows)
    at = np.stack(np.meshgrid(*ends), -1).astype(np.float32)
    scale = np.array(size) / np.array([width, height])
    field = sample(np.asarray(smooth, np.float32), at) * scale
    return field, sample(np.asarray(known, np.float32), at).astype(np.float64)


def _bytes(luma: Single) -> Picture:
    return np.asarray(np.clip(luma, 0, 255), np.uint8)
