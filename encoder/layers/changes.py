"""Changes of the picture around the face that are no motion, such as those of the light.

The principal components of what is left after motion, in luma, coded one after the other.  And how
much a drawn picture changes from frame to frame where the true one does not.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from encoder.layers.layer_fitter import LayerFitter
from encoder.layers.layer_samples import LayerSamples
from encoder.picture_coding.picture_encoder import EncodedPicture, encode_mode
from encoder.picture_coding.quantiser_search import STEPS_PER_HALVING, finest_quantiser_within
from protocol.pictures.layered_background import change_codec, change_shape
from protocol.pictures.picture_codec import MAX_STEP_CODE, to_luma
from runtime.cauchy_weight import cauchy_weight
from runtime.parallel import parallel_map
from shared_model.arrays import Array, Single

MAX_CHANGES, MAX_CHANGE_BYTES = 4, 160
# A change must explain this share of the squared residual, and so many squared grey levels.
MIN_SHARE, MIN_GREY2 = 0.06, 0.4
# The finest quantiser of a change.
FINEST_STEP_CODE = 12
# The share of a pixel's changes from which on one counts there, and fully; and the standard
# deviation of the kernel that smooths it, pixels.
RELIABLE_SHARE, RELIABILITY_SIGMA = (0.3, 0.6), 2.0
# Residuals of so many grey levels count half: more than elsewhere, for changes are large.
CHANGE_GREY = 20.0
# Matte from which on a pixel is the person's; the least change from frame to frame that counts.
PERSON_MATTE, MIN_CHANGE_GREY = 0.5, 0.05


@dataclass(frozen=True, slots=True, eq=False)
class CodedChanges:
    """Changes as a decoder has them.

    data: of each.  luma: (c, rows, columns).
    """

    data: tuple[bytes, ...]
    luma: Single

    def first(self, count: int) -> "CodedChanges":
        """The first `count` changes; each is coded by those before it: only last ones can go."""
        return CodedChanges(self.data[:count], self.luma[:count])


def learn_changes(samples: LayerSamples, fitter: LayerFitter, coefficients: Array) -> CodedChanges:
    """The changes that explain most of what is left in the frames of a sample.

    coefficients: (n, k) of the motion fields in each frame.
    """
    shape = change_shape(*samples.size)
    codec, coded = change_codec(*samples.size), list[EncodedPicture]()
    left, weight = _residuals(samples, fitter, coefficients, shape)
    rows = (left * weight).reshape(len(left), -1)
    rows = rows - rows.mean(0)
    total = float((rows**2).sum())
    for _ in range(min(MAX_CHANGES, len(rows) - 1)):
        _, sizes, axes = np.linalg.svd(rows, full_matrices=False)
        grey2 = sizes[0] ** 2 / max(float(weight.sum()), 1e-6)
        if sizes[0] ** 2 < MIN_SHARE * total or grey2 < MIN_GREY2:
            break
        # At the size of one standard deviation.
        image = (axes[0] * sizes[0] / np.sqrt(len(rows))).reshape(shape)
        image *= _reliability(image, rows)
        planes = np.zeros((*shape, 3), np.float32)
        planes[..., 0] = image / np.maximum(np.sqrt((weight**2).mean(0)), 0.2)
        _, mode = finest_quantiser_within(
            lambda step, planes=planes: encode_mode(codec.copy(), planes, step),  # type: ignore[misc]
            lambda mode: mode.size_bytes,
            MAX_CHANGE_BYTES,
            range(FINEST_STEP_CODE, MAX_STEP_CODE + 1),
            FINEST_STEP_CODE,
            STEPS_PER_HALVING,
        )
        step = mode.header[-1]
        row = (to_luma(mode.decoded) * np.sqrt((weight**2).mean(0))).ravel()
        if float(row @ row) < 0.25 * float((image**2).sum()):
            break
        coded.append(encode_mode(codec, planes, step))
        rows = rows - np.outer(rows @ row / float(row @ row), row)
    luma = np.array([to_luma(mode.decoded) for mode in coded], np.float32).reshape(-1, *shape)
    return CodedChanges(tuple(mode.serialise() for mode in coded), luma)


def _reliability(image: Array, rows: Array) -> Array:
    """(rows, columns) 0..1: how much of what changes at each pixel is this change.

    image: at the size of one standard deviation.  rows: (n, pixels) residuals.
    Elsewhere it is noise, by which what stands still would flicker.
    """
    share = image**2 / np.maximum((rows**2).mean(0).reshape(image.shape), 1e-6)
    low, high = RELIABLE_SHARE
    smooth = cv2.GaussianBlur(share, (0, 0), RELIABILITY_SIGMA)
    return np.asarray(np.clip((smooth - low) / (high - low), 0, 1))


def _residuals(
    samples: LayerSamples, fitter: LayerFitter, coefficients: Array, shape: tuple[int, int]
) -> tuple[Single, Single]:
    """(n, rows, columns) what is left of each frame, and its weight: 0 in the face."""
    left, weights = [], []
    drawn = _drawn(samples, fitter, coefficients)
    for frame, picture in zip(samples.coarse_frames(), drawn, strict=True):
        residual = frame.luma - picture
        weight = cauchy_weight(residual, CHANGE_GREY, frame.outside)
        left.append(cv2.resize(residual, shape[::-1], interpolation=cv2.INTER_AREA))
        weights.append(cv2.resize(weight, shape[::-1], interpolation=cv2.INTER_AREA))
    return np.array(left), np.array(weights)


def _drawn(samples: LayerSamples, fitter: LayerFitter, coefficients: Array) -> list[Single]:
    """(h, w) the coarse luma of each frame of a sample, as it is drawn."""
    frames = list(zip(samples.coarse_frames(), coefficients, strict=True))
    return parallel_map(
        lambda each: fitter.draw_at(each[0].origins, each[1]), frames, samples.workers
    )


def flicker_ratio(samples: LayerSamples, fitter: LayerFitter, coefficients: Array) -> float:
    """The change behind the person from one frame of a sample to the next, drawn over true.

    coefficients: of each frame.  What the person moves over is left out.
    """
    frames, drawn = samples.coarse_frames(), _drawn(samples, fitter, coefficients)
    pairs = [(frame.luma, picture) for frame, picture in zip(frames, drawn, strict=True)]
    mattes = samples.mattes_at((fitter.scene.shape[0], fitter.scene.shape[1]))
    covered = [
        (matte > PERSON_MATTE) | (frame.outside == 0)
        for matte, frame in zip(mattes, frames, strict=True)
    ]
    change = np.zeros(2)
    for i in range(1, len(pairs)):
        behind = ~covered[i - 1] & ~covered[i]
        before, after = pairs[i - 1], pairs[i]
        if behind.any():
            change += [np.abs(b - a)[behind].mean() for a, b in zip(before, after, strict=True)]
    true, shown = change / max(len(pairs) - 1, 1)
    return float(shown / max(true, MIN_CHANGE_GREY))
