"""One version of a live call's model: its packet, and all that fits and codes frames with it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from encoder.capture.face_crop import Crop, crop_face
from encoder.coding.distortion import DistortionModel, with_layers
from encoder.coding.model_packet import BUDGETS
from encoder.coding.progressive_model import LayeredModel
from encoder.coding.transform import project
from encoder.detection.landmark_indices import face_outline
from encoder.fitting.eyelids import fit_with_eyelids, with_averaged_eyelids
from encoder.fitting.landmark_fit import LandmarkModel
from encoder.fitting.render_and_compare import ImageFitter
from encoder.layers.frame_layers import FrameLayers
from encoder.layers.layer_samples import coarse_picture
from encoder.learning.face_sample import FaceSample
from encoder.learning.hidden_faces import window_of
from encoder.learning.incremental_modes import LearnedMode
from encoder.learning.person_model import PersonModel
from encoder.live_model.work_level import WorkLevel
from protocol.frames.frame_transform import (
    MAX_MODES,
    FrameTransform,
    vector_from_face,
    with_reserved_modes,
)
from protocol.limits import SEQUENCE_MODULUS
from protocol.model_packet import ModelPacket
from shared_model.arrays import Array, Picture, Single
from shared_model.parameters import FaceParameters

# Modes that may be learned between one model packet and the next.
RESERVED_MODES = MAX_MODES - BUDGETS["live"].max_modes
# Distortion that errors of the eyelids add, see `DistortionModel.distortion_matrix`, more than in a
# recorded call: until the person is seen with closed eyes only the actuators show a blink, and the
# coarse quantiser steps of a live call's beginning would lose it.  The difference of the two
# eyelids counts less: people shut both.
EYELID_DISTORTION = 500.0 * np.array([[1.0, 0.8], [0.8, 1.0]])
# Errors of the layers count so much less than in a recorded call: carphone's face gains .6 dB, its
# whole picture loses .1.
LIVE_LAYER_SHARE = 0.3


@dataclass(frozen=True, slots=True)
class ModelVersion:
    """A model packet, and what is needed to fit and code frames with it.

    packet: as it is sent; its transform has `RESERVED_MODES` reserved modes.
    person: the texel fitter has all modes that are in use.
    landmarks: the landmarks of the person's face.
    transform: of the values in use, with as many reserved modes as have been learned.
    distortion_model: the effect of errors on the picture, for any modes.
    distortion: (d, d) of the values in use, see `DistortionModel.distortion_matrix`.
    image_fitter: of what the decoder draws once all that has been sent has arrived.
    layers: what is sent of the model between frame packets; None: nothing.
    frame_layers: of the picture around the face; None: it is one picture, which follows the head.
    first_packet: number in the call of the first frame packet that is coded with it.
    """

    packet: ModelPacket
    person: PersonModel
    landmarks: LandmarkModel
    transform: FrameTransform
    distortion_model: DistortionModel
    distortion: Array
    image_fitter: ImageFitter
    layers: LayeredModel | None = None
    frame_layers: FrameLayers | None = None
    first_packet: int = 0

    @property
    def number(self) -> int:
        """How many versions of the call's model came before."""
        return self.packet.version

    @property
    def learned_modes(self) -> int:
        """Number of reserved modes that have been learned."""
        return self.transform.reserved_modes

    @property
    def free_slots(self) -> int:
        """Number of reserved modes that have not been learned."""
        return RESERVED_MODES - self.learned_modes

    @property
    def padded_transform(self) -> FrameTransform:
        """The transform as the model packet has it, with all reserved modes."""
        return with_reserved_modes(self.transform, self.free_slots)

    def placed_at(self, first_packet: int, start_frame: int) -> "ModelVersion":
        """The same from frame packet `first_packet` on, which begins with `start_frame`."""
        call = replace(self.packet.call, start_frame=start_frame)
        packet = replace(self.packet, call=call, sequence=first_packet % SEQUENCE_MODULUS)
        return replace(self, packet=packet, first_packet=first_packet)

    def sample(
        self,
        picture: Picture,
        points: Array,
        with_layers: bool = True,
        level: WorkLevel = WorkLevel.FULL,
    ) -> FaceSample:
        """A picture (h, w, 3) BGR and its landmarks (468, 3), pixels, ready to be fitted.

        with_layers: fit the layers around the face, too, where there are some.
        level: at which it will be fitted.
        """
        has_layers = with_layers and level.fits_image and self.frame_layers is not None
        coarse = coarse_picture(picture) if has_layers else None
        scale = self.person.pixels_per_texel * (2 if level.halves_resolution else 1)
        return FaceSample(crop_face(picture, points, scale), points, coarse=coarse)

    def mode_sample(
        self,
        picture: Picture,
        points: Array,
        face: FaceParameters | None = None,
        crop: Crop | None = None,
    ) -> FaceSample:
        """The same for modes to be learned from, at full resolution.

        face: as this version has fitted it; None: it has not.  crop: of the face, at full
        resolution; None: there is none yet.
        """
        crop = crop or crop_face(picture, points, self.person.pixels_per_texel)
        return FaceSample(crop, points, face, window=window_of(picture, points))

    def fit(
        self,
        sample: FaceSample,
        initial: FaceParameters | None = None,
        level: WorkLevel = WorkLevel.FULL,
    ) -> FaceParameters:
        """The face in a sample, by texels, then by the pixels of the picture.

        initial: the face in the frame before; None: not known.
        level: of the sample.
        """
        if not level.fits_image:
            return self.fit_texels(sample, initial, level)
        outline = face_outline(sample.landmarks)
        face = self.image_fitter.fit(sample.crop, self.fit_texels(sample, initial), outline)
        if self.frame_layers is None or sample.coarse is None:
            return face
        return self.frame_layers.fitted(sample.coarse, face, outline)

    def fit_texels(
        self,
        sample: FaceSample,
        initial: FaceParameters | None = None,
        level: WorkLevel = WorkLevel.FULL,
    ) -> FaceParameters:
        """The face in a sample, by landmarks, then by texels in the shape-free frame.

        initial, level: see `fit`; the layers stay where they were.
        """
        camera = self.packet.call.camera
        by_landmarks = fit_with_eyelids(self.landmarks, camera, sample.landmarks, initial)
        by_texels = self.person.fit_texels(
            sample.crop, by_landmarks, level.texel_iterations, level.halves_resolution
        )
        face = with_averaged_eyelids(by_landmarks, by_texels)
        return replace(face, layers=by_landmarks.layers)

    def refit(self, sample: FaceSample, face: FaceParameters) -> FaceParameters:
        """A face that was fitted before the newest modes were learned, with these."""
        start = self._with_newest_modes(face)
        return self.image_fitter.fit(sample.crop, start, face_outline(sample.landmarks))

    def refit_modes(self, sample: FaceSample, face: FaceParameters) -> FaceParameters:
        """The same in a quarter of the time: only the coefficients of modes change."""
        start = self._with_newest_modes(face)
        return self.image_fitter.fit_modes(sample.crop, start, face_outline(sample.landmarks))

    def _with_newest_modes(self, face: FaceParameters) -> FaceParameters:
        return replace(face, modes=_zero_padded(face.modes, len(self.transform.modes)))

    def transform_faces(self, faces: Sequence[FaceParameters]) -> Array:
        """(t, n) components of faces; modes that were learned after a fit are 0 in it."""
        pose = self.packet.reference_pose
        faces = [self._with_layers(face) for face in faces]
        values = [_zero_padded(vector_from_face(f, pose), len(self.distortion)) for f in faces]
        projected = project(self.transform, np.array(values), self.distortion)
        return np.pad(projected, ((0, 0), (0, self.free_slots)))

    def rest(self) -> FaceParameters:
        """The face of the reference frame, without any mode."""
        modes = np.zeros(len(self.transform.modes))
        return self._with_layers(FaceParameters(self.packet.reference_pose, modes=modes))

    def _with_layers(self, face: FaceParameters) -> FaceParameters:
        """A face with as many layer coefficients as this version has, 0 if they are not known."""
        count = 0 if self.frame_layers is None else self.frame_layers.count
        return face if len(face.layers) == count else replace(face, layers=np.zeros(count))

    def with_mode(self, mode: LearnedMode) -> "ModelVersion":
        """The same with one of the reserved modes learned."""
        with_texels = self.with_mode_of_texels(mode)
        modes = with_texels.person.texel_fitter.template.modes
        return replace(
            with_texels,
            transform=with_reserved_modes(self.transform, 1),
            distortion=live_distortion(self.distortion_model, modes, self.frame_layers),
            image_fitter=self.image_fitter.with_mode(mode.luma),
        )

    def with_mode_of_texels(self, mode: LearnedMode) -> "ModelVersion":
        """The same for `fit_texels` as `with_mode` makes it; the rest of it has no new mode."""
        atlas = self.person.shape.atlas
        fitter = self.person.texel_fitter.with_mode(mode.luma[atlas.rows, atlas.columns])
        return replace(self, person=replace(self.person, texel_fitter=fitter))


def live_distortion(model: DistortionModel, modes: Single, layers: FrameLayers | None) -> Array:
    """(d, d) the distortion of y, see `ModelVersion`.  modes: (m, k) luma."""
    distortion = model.distortion_matrix(modes, EYELID_DISTORTION)
    if layers is None:
        return distortion
    return with_layers(distortion, LIVE_LAYER_SHARE * layers.distortion)


def _zero_padded(values: Array, count: int) -> Array:
    return np.append(values, np.zeros(count - len(values)))
