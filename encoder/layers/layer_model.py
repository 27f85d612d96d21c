"""The layers around a person's face: learned from a sample, encoded, and fitted to frames."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from encoder.layers.changes import CodedChanges, flicker_ratio, learn_changes
from encoder.layers.displacement import dense
from encoder.layers.field_refinement import refined_fields
from encoder.layers.frame_layers import FrameLayers, layer_distortion
from encoder.layers.layer_fitter import LayerFitter
from encoder.layers.layer_samples import (
    COARSE_SIDE,
    CoarseFrame,
    LayerSamples,
    luma_at,
    scaled_shape,
)
from encoder.layers.motion_fields import field_codes, motion_fields
from encoder.layers.person_picture import person_mask, person_picture, with_headwear
from encoder.layers.scene import SceneLayer, find_scene
from encoder.picture_coding.picture_encoder import EncodedPicture, encode_picture
from encoder.picture_coding.quantiser_search import STEPS_PER_HALVING, finest_quantiser_within
from protocol.pictures.layered_background import (
    FIELD_CODES_PER_PX,
    LIGHT_COEFFICIENTS,
    SCENE_COEFFICIENTS,
    LayeredBackground,
    serialise_layers,
)
from protocol.pictures.picture_codec import MAX_STEP_CODE
from runtime.parallel import parallel_map
from shared_model.animate import Face
from shared_model.arrays import Array, Integers, Mask, Single
from shared_model.layers.head_motion import BackgroundMesh
from shared_model.layers.layer_motion import fields_at_mesh
from shared_model.layers.soft_mask import opacity

# By how much a coefficient may exceed those of the sample, in their range.
LIMIT_MARGIN = 0.3
# Passes over the sample: the person's picture, coefficients, then so many steps of the fields.
PASSES, FIELD_STEPS = 2, 2
# The longer side of the pictures in all passes but the last, pixels.
DRAFT_SIDE = 2 * COARSE_SIDE
# A change has coefficients of about 1 in the frames that it was found in.  One with a greater
# standard deviation stands for something else, and the scene would flicker by it.
MAX_CHANGE_SIGMA = 3.0
# Standard deviation of the coefficients of the light, in later frames.
LIGHT_SIGMA = 2.0
# The mask is made narrower as long as what is behind the person changes more as it is drawn than in
# the frames: where the outline is a pixel off, the scene flickers.
MASK_MARGINS, MAX_FLICKER = (0.0, 0.5, 1.0, 1.5), 1.0


@dataclass(frozen=True, slots=True, eq=False)
class LayerModel:
    """Scene, person, motion fields and changes of a call.

    scene, person: (h, w, 3) BGR.  mask: of the person.  fields: codes, see `LayeredBackground`.
    changes: encoded.
    fitter: of what is behind the face in other frames.
    coefficients: (n, l) of the sample.
    distortion: (l, l) squared grey levels around the face per squared unit, for each pixel of the
        face.
    workers: of what is encoded, see `parallel_map`.
    """

    scene: Single
    person: Single
    mask: Mask
    fields: Integers
    changes: tuple[bytes, ...]
    fitter: LayerFitter
    coefficients: Array
    distortion: Array
    workers: int | None = 1

    @property
    def frames(self) -> FrameLayers:
        """What fits and codes frames."""
        if not self.fitter.follows_light:
            return FrameLayers(self.fitter, self.distortion)
        variance = np.zeros(len(self.distortion))
        variance[-LIGHT_COEFFICIENTS:] = LIGHT_SIGMA**2
        return FrameLayers(self.fitter, self.distortion, variance)

    def encode(self, max_bytes: int) -> bytes:
        """The layered background, its pictures as fine as `max_bytes` for all of it allow."""
        follows = self.fitter.scene_moves, self.fitter.follows_light
        draft = LayeredBackground(self.mask, b"", b"", self.fields, self.changes, *follows)
        return encode_layers((self.person, self.scene), draft, max_bytes, self.workers)

    def encode_rough(self, max_bytes: int) -> bytes:
        """The same without what frames change: for a base layer."""
        draft = LayeredBackground(self.mask, b"", b"", self.fields[:0])
        return encode_layers((self.person, self.scene), draft, max_bytes, self.workers)


def encode_layers(
    pictures: tuple[Single, Single],
    draft: LayeredBackground,
    max_bytes: int,
    workers: int | None = 1,
) -> bytes:
    """A layered background, its pictures as fine as `max_bytes` for all of it allow.

    pictures: (h, w, 3) BGR of person and scene.  draft: all but these.
    workers: see `parallel_map`.
    """
    # The length of the person's picture takes up to two bytes more than that of an empty one.
    free_bytes = max_bytes - len(serialise_layers(draft)) - 2

    def encoded(step: int) -> tuple[EncodedPicture, ...]:
        return tuple(parallel_map(lambda each: encode_picture(each, step), pictures, workers))

    person, scene = finest_quantiser_within(
        encoded,
        lambda both: sum(each.size_bytes for each in both),
        free_bytes,
        range(MAX_STEP_CODE + 1),
        MAX_STEP_CODE // 2,
        STEPS_PER_HALVING,
    )[1]
    layers = replace(draft, person=person.serialise(), scene=scene.serialise())
    return serialise_layers(layers)


def learn_layers(face: Face, samples: LayerSamples, follows_light: bool = False) -> LayerModel:
    """The layers of a person, from a sample of their frames.

    follows_light: later frames have coefficients of the light; the sample is of one light.
    """
    full, scene = _told_apart(samples)
    samples = full.shrunk(DRAFT_SIDE)
    fields = motion_fields(samples)
    coefficients = np.zeros((len(samples.faces), len(fields)))
    for _ in range(PASSES):
        fitter, _, _ = _with_person(face, samples, scene, fields, coefficients)
        frames = _with_scene_motion(fitter, samples)
        coefficients = _fitted(fitter, frames, samples.workers)
        for _ in range(FIELD_STEPS if len(fields) else 0):
            refined = refined_fields(fields / FIELD_CODES_PER_PX, samples, fitter, coefficients)
            fields = field_codes(refined)
            fitter = with_fields(fitter, fields)
            coefficients = _fitted(fitter, frames, samples.workers)
    for margin in MASK_MARGINS:
        fitter, mask, person = _with_person(face, full, scene, fields, coefficients, margin)
        frames = _with_scene_motion(fitter, samples)
        coefficients = _fitted(fitter, frames, samples.workers)
        if flicker_ratio(samples, fitter, coefficients) <= MAX_FLICKER:
            break
    fitter, changes, coefficients = _with_calm_changes(fitter, samples, frames, coefficients)
    margin = LIMIT_MARGIN * np.ptp(coefficients, axis=0)
    limits = np.stack([coefficients.min(0) - margin, coefficients.max(0) + margin], 1)
    fitter = replace(fitter, limits=limits, follows_light=follows_light)
    coefficients = np.pad(coefficients, ((0, 0), (0, LIGHT_COEFFICIENTS * follows_light)))
    distortion = layer_distortion(fitter, samples.faces, samples.outlines_px, coefficients)
    coded = mask, fields, changes.data
    fitted = fitter, coefficients, distortion
    return LayerModel(scene.picture, person, *coded, *fitted, samples.workers)


def _told_apart(samples: LayerSamples) -> tuple[LayerSamples, SceneLayer]:
    """The sample with headwear in its mattes, and its scene."""
    scene = find_scene(samples)
    more = with_headwear(samples, scene)
    return (samples, scene) if more is samples else (more, find_scene(more))


def _with_person(
    face: Face,
    samples: LayerSamples,
    scene: SceneLayer,
    fields: Integers,
    coefficients: Array,
    margin: float = 0.0,
) -> tuple[LayerFitter, Mask, Single]:
    """What fits the person's picture from frames with these coefficients; mask and picture.

    margin: see `person_mask`.
    """
    at_mesh = fields_at_mesh(samples.mesh, fields / FIELD_CODES_PER_PX)
    motions = [
        motion + np.tensordot(own[: len(fields)], at_mesh, 1)
        for motion, own in zip(samples.motion, coefficients, strict=True)
    ]
    mask = person_mask(samples, motions, scene, margin)
    person = person_picture(samples, motions, mask, scene)
    fitter = coarse_fitter(face, samples.mesh, samples.size, mask, person, scene)
    return with_fields(fitter, fields), mask, person


def coarse_fitter(
    face: Face,
    mesh: BackgroundMesh,
    size: tuple[int, int],
    mask: Mask,
    person: Single,
    scene: SceneLayer,
) -> LayerFitter:
    """What fits two pictures (h, w, 3) to frames of `size`, without fields and changes."""
    shape = scaled_shape(size, COARSE_SIDE)
    alpha = opacity(mask, shape[1], shape[0]).astype(np.float32)
    return LayerFitter(
        face,
        mesh,
        size,
        luma_at(person, shape) * alpha,
        alpha,
        luma_at(scene.picture, shape),
        np.zeros((0, *shape, 2), np.float32),
        np.zeros((0, *shape), np.float32),
        np.zeros((0, 2)),
        scene.motion is not None,
    )


def with_fields(fitter: LayerFitter, fields: Integers) -> LayerFitter:
    """The fitter with other motion fields, without changes."""
    shape = fitter.scene.shape[0], fitter.scene.shape[1]
    at_mesh = fields_at_mesh(fitter.mesh, fields / FIELD_CODES_PER_PX)
    dense_fields = [dense(field, fitter.size, shape) for field in at_mesh]
    return replace(
        fitter,
        fields=np.array(dense_fields, np.float32).reshape(-1, *shape, 2),
        limits=_no_limits(len(fields), fitter),
    )


def _no_limits(count: int, fitter: LayerFitter) -> Array:
    """Limits of `count` coefficients and those of the scene's motion."""
    return np.tile([-np.inf, np.inf], (count + SCENE_COEFFICIENTS * fitter.scene_moves, 1))


def _with_changes(fitter: LayerFitter, changes: Single) -> LayerFitter:
    """The fitter with changes (c, rows, columns), luma."""
    shape = fitter.scene.shape[0], fitter.scene.shape[1]
    resized = [cv2.resize(each, shape[::-1], interpolation=cv2.INTER_LINEAR) for each in changes]
    return replace(
        fitter,
        changes=np.array(resized, np.float32).reshape(-1, *shape),
        limits=_no_limits(len(fitter.fields) + len(changes), fitter),
    )


def _with_calm_changes(
    fitter: LayerFitter, samples: LayerSamples, frames: list[CoarseFrame], coefficients: Array
) -> tuple[LayerFitter, CodedChanges, Array]:
    """A fitter with changes that stay calm, those changes, and coefficients (n, l) of a sample.

    frames: of the sample.  coefficients: without changes.
    """
    changes = learn_changes(samples, fitter, coefficients)
    fitter = _with_changes(fitter, changes.luma)
    coefficients = _fitted(fitter, frames, samples.workers)
    first = len(fitter.fields)
    while (calm := _calm_changes(coefficients[:, first:], changes)) < len(changes.data):
        changes = changes.first(calm)
        fitter = _with_changes(fitter, changes.luma)
        coefficients = _fitted(fitter, frames, samples.workers)
    return fitter, changes, coefficients


def _calm_changes(coefficients: Array, changes: CodedChanges) -> int:
    """How many changes there are before the first that stands for something else.

    coefficients: (n, c or more) of the changes in each frame.
    """
    wild = coefficients[:, : len(changes.data)].std(0) > MAX_CHANGE_SIGMA
    return int(wild.argmax()) if wild.any() else len(wild)


def _with_scene_motion(fitter: LayerFitter, samples: LayerSamples) -> list[CoarseFrame]:
    return parallel_map(fitter.with_scene_motion, samples.coarse_frames(), samples.workers)


def _fitted(fitter: LayerFitter, frames: list[CoarseFrame], workers: int | None) -> Array:
    """(n, l) the coefficients of the frames of a sample, in the light of the layers."""
    return np.array(parallel_map(fitter.fit_motion, frames, workers)).reshape(len(frames), -1)
