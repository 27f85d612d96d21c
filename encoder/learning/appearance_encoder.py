"""Encodes the appearance model of a person (thesis eq. 2.17): mean texture and modes.

Closed-loop principal component analysis: mean and modes are coded as small pictures one after the
other, and each mode is the leading direction of the residual after the decoded pictures before it.
"""

from dataclasses import dataclass

import numpy as np

from encoder.appearance.masks import root_weight_and_support
from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.appearance.texture_samples import TextureSamples
from encoder.learning.orthogonal_residual import OrthogonalResidual
from encoder.learning.step_search import INFEASIBLE_COST, best_candidate, filling_candidate
from encoder.picture_coding.image_budget import encode_picture_within
from encoder.picture_coding.picture_encoder import EncodedPicture, encode_mode, encode_picture
from protocol.pictures.picture_codec import (
    MAX_STEP_CODE,
    MODE_CHROMA_WEIGHT,
    ModeCodec,
    to_luma,
    to_planes,
)
from protocol.pictures.probability_model import TEXTURE
from protocol.pictures.weight_map import GRID_SIDE, encode_weight_map
from runtime.jit import jit
from shared_model.appearance import Atlas, filled_atlas
from shared_model.arrays import Array, Mask, Single

# Where the search of the quantiser step starts, in steps of `picture_codec.step_size`.
INITIAL_STEP = 22
# At the optimum the mean takes about this share of `NOMINAL_BYTES`; with fewer bytes the share
# rises by this power, since few and coarse modes explain little of a short sample.
TEXTURE_SHARE, NOMINAL_BYTES, SHARE_POWER, SHARE_ITERATIONS = 0.36, 7000, 0.8, 2
STEPS_PER_HALVING = 10
# Bytes of a mode besides its picture: a length, a centre, a unit and a column of the basis.
MODE_OVERHEAD_BYTES = 24
# A mode must reduce the mean log2 residual energy by this much: its coefficient takes bits in
# every frame packet.  At 800 bit/s .01 gave carphone .1 dB less, turn the same.
MIN_MODE_GAIN = 0.006
MIN_MODE_ENERGY = 1e-3
# Coarser steps tried for a mode that exceeds the free bytes, and the fewest bytes of a mode.
LAST_MODE_BACKOFF = (0, 4, 8, 12, 16)
MIN_MODE_BYTES = 40
# Where bytes run out, carphone and foreman want 1.6 and 2.5 times as many modes as fit; others few
# more.
MORE_MODES = 1.5


@dataclass(frozen=True, slots=True)
class CodedAppearance:
    """Coded mean texture and modes, and the pictures that a decoder makes of them.

    texture, modes: the coded pictures.
    mean: (size, size, 3) float32 BGR.
    mode_images: (m, size, size, 3) float32, per unit coefficient.
    mode_codec: codec state after these modes, for further modes.
    """

    texture: bytes
    modes: tuple[bytes, ...]
    mean: Single
    mode_images: Single
    mode_codec: ModeCodec


def encode_appearance(
    shape: ShapeFreeFrame,
    samples: TextureSamples,
    mean: Single,
    mask: Single,
    max_bytes: int,
    max_modes: int,
    searches_step: bool = True,
) -> CodedAppearance:
    """Encode mean and modes in `max_bytes` at the quantiser step of least residual.

    samples: of which modes are found.  mean: (k, 3) BGR.  mask: (k,) see `face_mask`.
    searches_step: else two quantiser steps are tried at most.
    """
    atlas_mean = filled_atlas(shape.atlas, mean)
    weight_map = encode_weight_map(cell_weights(shape.atlas, samples.weight))
    if not max_modes:
        texture, decoded = encode_picture_within(atlas_mean, max_bytes, weight_map, TEXTURE)
        size = shape.atlas.size
        no_modes = np.zeros((0, size, size, 3), np.float32)
        return CodedAppearance(texture, (), decoded, no_modes, ModeCodec(size, weight_map))
    root, support = root_weight_and_support(samples.weight * mask, mask)
    frames = weighted_planes(samples.colours, samples.visible, root[:, 0])
    coder = _AppearanceCoder(
        shape.atlas,
        samples.visible,
        frames,
        root,
        support,
        atlas_mean,
        weight_map,
        max_bytes,
        max_modes,
    )
    search = best_candidate if searches_step else filling_candidate
    return _finalise(search(coder.encode, coder.initial_step(), max_bytes))


def cell_weights(atlas: Atlas, weight: Single) -> Array:
    """Weights (SIDE, SIDE) of the cells of a weight map, 1 for the median texel.

    weight: (k,) of squared errors of each texel.
    """
    cell = (
        atlas.rows * GRID_SIDE // atlas.size * GRID_SIDE + atlas.columns * GRID_SIDE // atlas.size
    )
    root = np.sqrt(np.maximum(weight, 0))
    median = max(float(np.median(root)), 1e-3)
    count = np.bincount(cell, minlength=GRID_SIDE * GRID_SIDE)
    total = np.bincount(cell, root, GRID_SIDE * GRID_SIDE)
    mean = np.where(count > 0, total / np.maximum(count, 1), median)
    return np.maximum(mean / median, 1e-3).reshape(GRID_SIDE, GRID_SIDE)


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A mean and modes coded at one quantiser step, not yet written.

    cost: mean log2 of the frames' residual energy, plus `MIN_MODE_GAIN` for each mode.
    wanted_bytes: of the pictures, with the overhead of the modes, if there were no limit.
    """

    texture: EncodedPicture
    modes: tuple[EncodedPicture, ...]
    mode_codec: ModeCodec
    step: int
    cost: float
    wanted_bytes: float

    @property
    def size_bytes(self) -> int:
        """Bytes of the pictures, with the overhead of the modes."""
        modes = sum(mode.size_bytes + MODE_OVERHEAD_BYTES for mode in self.modes)
        return self.texture.size_bytes + modes


@dataclass(frozen=True, slots=True)
class _AppearanceCoder:
    """The samples and their mean, to be encoded at several quantiser steps.

    visible: (t, k).  frames: (t, k, 3) planes of visible texels, times `root`.
    root, support: see `root_weight_and_support`.  atlas_mean: (size, size, 3) BGR.
    """

    atlas: Atlas
    visible: Mask
    frames: Single
    root: Single
    support: Single
    atlas_mean: Single
    weight_map: bytes
    max_bytes: int
    max_modes: int

    def initial_step(self) -> int:
        """An estimate of the step at which the mean takes its share of the bytes."""
        step = INITIAL_STEP
        scarcity = max(1.0, NOMINAL_BYTES / max(self.max_bytes, 1))
        target = min(TEXTURE_SHARE * scarcity**SHARE_POWER, 1.0) * self.max_bytes
        for _ in range(SHARE_ITERATIONS):
            size = encode_picture(self.atlas_mean, step, self.weight_map, TEXTURE).size_bytes
            octaves = np.log2(size / target)
            step = min(max(step + round(STEPS_PER_HALVING * octaves), 0), MAX_STEP_CODE)
        return step

    def encode(self, step: int) -> _Candidate:
        """The mean, and modes until bytes or gain run out."""
        texture = encode_picture(self.atlas_mean, step, self.weight_map, TEXTURE)
        residual = self._residual(texture)
        codec = ModeCodec(self.atlas.size, self.weight_map)
        free_bytes = self.max_bytes - texture.size_bytes
        error = residual.mean_log_energy if free_bytes >= 0 else INFEASIBLE_COST - free_bytes
        modes: list[EncodedPicture] = []
        wanted = _WantedBytes(texture.size_bytes)
        while len(modes) < self.max_modes:
            image = self._leading_image(residual)
            encoded = _encode_mode_within(codec, image, step, free_bytes - MODE_OVERHEAD_BYTES)
            wanted.add(encoded, step)
            if encoded is None:
                break
            row = self._weighted(encoded.mode.decoded).ravel()
            if float(row @ row) < MIN_MODE_ENERGY:
                break
            residual.add_mode(row)
            if error - residual.mean_log_energy < MIN_MODE_GAIN:
                break
            error = residual.mean_log_energy
            codec, mode = encoded.codec, encoded.mode
            free_bytes -= mode.size_bytes + MODE_OVERHEAD_BYTES
            modes.append(mode)
        cost = error + MIN_MODE_GAIN * len(modes)
        return _Candidate(texture, tuple(modes), codec, step, cost, wanted.estimate)

    def _residual(self, texture: EncodedPicture) -> OrthogonalResidual:
        frames = without_mean(self.frames, self._weighted(texture.decoded), self.visible)
        return OrthogonalResidual(frames.reshape(len(frames), -1))

    def _leading_image(self, residual: OrthogonalResidual) -> Single:
        """The leading direction of a residual as planes (size, size, 3)."""
        direction, _ = residual.leading_direction()
        # Unused texels take no bits if they continue those around: an edge would.
        return filled_atlas(self.atlas, direction.reshape(-1, 3) / self.root * self.support)

    def _weighted(self, image: Single) -> Single:
        """(k, 3) planes of the texels of an image (size, size, 3) BGR, times `root`."""
        colours = image[self.atlas.rows, self.atlas.columns]
        return np.asarray(to_planes(colours) * self.root, np.float32)


def _finalise(candidate: _Candidate) -> CodedAppearance:
    texture = candidate.texture
    modes = tuple(mode.serialise() for mode in candidate.modes)
    images = np.array([mode.decoded for mode in candidate.modes], np.float32)
    images = images.reshape(-1, *texture.decoded.shape)
    return CodedAppearance(
        texture.serialise(), modes, texture.decoded, images, candidate.mode_codec
    )


@dataclass(frozen=True, slots=True)
class _EncodedMode:
    """A mode, the quantiser step of its code, and the codec's state after the mode."""

    mode: EncodedPicture
    step: int
    codec: ModeCodec


class _WantedBytes:
    """What a mean and modes would take at a step if bytes were not limited.

    texture_bytes: of the mean.
    """

    def __init__(self, texture_bytes: int) -> None:
        self._texture_bytes = texture_bytes
        self._modes: list[int] = []
        self._is_limited = False

    def add(self, encoded: _EncodedMode | None, step: int) -> None:
        """Note the next mode; one that there are no bytes for is None or coarser than `step`."""
        if encoded is None or encoded.step != step:
            self._is_limited = True
        else:
            self._modes.append(encoded.mode.size_bytes + MODE_OVERHEAD_BYTES)

    @property
    def estimate(self) -> float:
        """Bytes of the mean and of all modes; if there were more, half as many again."""
        modes = sum(self._modes)
        if not self._is_limited:
            return self._texture_bytes + modes
        return max(self._texture_bytes / TEXTURE_SHARE, self._texture_bytes + MORE_MODES * modes)


def _encode_mode_within(
    codec: ModeCodec, image: Single, step: int, max_bytes: int
) -> _EncodedMode | None:
    """A mode within `max_bytes`, at a coarser step if need be."""
    for backoff in LAST_MODE_BACKOFF if max_bytes >= MIN_MODE_BYTES else ():
        advanced = codec.copy()
        tried = min(step + backoff, MAX_STEP_CODE)
        mode = encode_mode(advanced, image, tried)
        if mode.size_bytes <= max_bytes:
            return _EncodedMode(mode, tried, advanced)
    return None


@jit
def without_mean(frames: Single, mean: Single, visible: Mask) -> Single:
    """Frames (t, k, 3) less a mean (k, 3) where a texel is visible (t, k)."""
    left = np.empty_like(frames)
    for frame in range(len(frames)):
        for texel in range(len(mean)):
            for channel in range(3):
                value = frames[frame, texel, channel]
                if visible[frame, texel]:
                    value -= mean[texel, channel]
                left[frame, texel, channel] = value
    return left


def weighted_planes(colours: Single, visible: Mask, root: Single) -> Single:
    """(t, k, 3) the planes of colours (t, k, 3), see `to_planes`, times `root` (k,) where a texel
    is visible (t, k), else 0."""
    return _weighted_planes(colours, to_luma(colours), visible, root, MODE_CHROMA_WEIGHT)


@jit
def _weighted_planes(
    colours: Single, luma: Single, visible: Mask, root: Single, chroma_weight: float
) -> Single:
    """See `weighted_planes`.  luma: (t, k) of the colours."""
    planes, chroma = np.zeros_like(colours), np.float32(chroma_weight)
    for frame in range(len(colours)):
        for texel in range(len(root)):
            if visible[frame, texel]:
                y = luma[frame, texel]
                planes[frame, texel, 0] = y * root[texel]
                planes[frame, texel, 1] = chroma * (colours[frame, texel, 0] - y) * root[texel]
                planes[frame, texel, 2] = chroma * (colours[frame, texel, 2] - y) * root[texel]
    return planes
