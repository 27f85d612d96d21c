"""The appearance of one person at the faces that a tracker has found: mean texture and modes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from encoder.appearance.masks import face_mask
from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.capture.face_crop import Crop, crop_face
from encoder.coding.model_packet import ModelBudget
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.quantised_identity import quantised_identity
from encoder.learning.person_model import (
    PersonBase,
    PersonModelOptions,
    TrainedModel,
    person_of_fitted_sample,
    texel_frame,
)
from protocol.frames.scalar_quantiser import EAU_STEP, codes_from_values, values_from_codes
from shared_model.animate import Face
from shared_model.arrays import Array, Picture
from shared_model.geometry import Camera
from shared_model.parameters import FaceParameters
from shared_model.surround import head_with_surround

# Levenberg-Marquardt iterations of a frame's fit.
ITERATIONS = 3


@dataclass(frozen=True, slots=True)
class TextureModes:
    """A learned appearance (thesis eq. 2.17).

    active: the actuators that are sent.  rest: (EAUs,) values of the others.
    """

    trained: TrainedModel
    active: Sequence[int]
    rest: Array

    def fit(self, picture: Picture, tracked: FaceParameters) -> FaceParameters:
        """The face with its coefficients, by analysis by synthesis from the tracked one (2.27).

        picture: (h, w, 3) uint8 BGR.
        """
        person = self.trained.person
        start = _with_sent_eaus(tracked, self.active, self.rest)
        crop = _crop(person.shape, person.pixels_per_texel, picture, start)
        return person.texel_fitter.fit_crop(crop, start, ITERATIONS, self.active)


def learn_texture_modes(
    fitted: IdentityFit,
    camera: Camera,
    tracked: Mapping[int, FaceParameters],
    sample: Sequence[tuple[int, Picture]],
    active: Sequence[int],
    budget: ModelBudget,
    max_modes: int,
) -> TextureModes:
    """Learn the mean texture and modes of a sample of frames (source frame, picture).

    camera: of the call parameters.  tracked: faces by source frame; the first is the reference.
    active: actuators that are sent.
    """
    head = head_with_surround()
    face = Face(head, quantised_identity(head, fitted))
    first = tracked[min(tracked)]
    rest = values_from_codes(codes_from_values(first.eau, EAU_STEP, low=-127), EAU_STEP)
    reference = replace(first, eau=rest, modes=np.zeros(0))
    options = PersonModelOptions(budget.texture_size, budget.appearance_bytes, max_modes)
    shape, scale = texel_frame(face, camera, reference, options.texture_size)
    mask = face_mask(head, shape.atlas)
    base = PersonBase(fitted, face, reference, shape, scale, mask)
    faces = [_with_sent_eaus(tracked[index], active, rest) for index, _ in sample]
    pairs = zip(sample, faces, strict=True)
    crops = [_crop(shape, scale, picture, at) for (_, picture), at in pairs]
    person = person_of_fitted_sample(base, crops, faces, options)
    return TextureModes(TrainedModel(person, crops, faces), active, rest)


def _with_sent_eaus(face: FaceParameters, active: Sequence[int], rest: Array) -> FaceParameters:
    """The face as it is sent: actuators that are not keep their values in the first frame."""
    eau = rest.copy()
    eau[list(active)] = face.eau[list(active)]
    return FaceParameters(face.pose, eau)


def _crop(shape: ShapeFreeFrame, scale: float, picture: Picture, face: FaceParameters) -> Crop:
    """The window of a picture that holds the face.  scale: see `PersonModel`."""
    border = np.array(picture.shape[1::-1]) - 1.0
    positions = shape.positions(face)[shape.on_face].astype(np.float64)
    return crop_face(picture, np.clip(positions, 0, border), scale)
