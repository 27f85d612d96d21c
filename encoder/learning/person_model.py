"""The person model: identity, coded appearance, and what fits them to further frames.

It is built from a sample of the frames of a call.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from encoder.appearance.masks import face_mask, mouth_weights, outline_coverage
from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.appearance.template import Template
from encoder.appearance.texel_visibility import visible_texels
from encoder.appearance.texture import atlas_size_for, default_colours, pixels_per_texel
from encoder.appearance.texture_samples import (
    TextureSamples,
    mean_texture,
    texel_footprints,
)
from encoder.capture.face_crop import Crop, crop_face
from encoder.fitting.analysis_by_synthesis import NOMINAL_TEXELS, TexelFitter
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.render_and_compare import MAX_PIXELS, ImageFitter
from encoder.learning.appearance_encoder import CodedAppearance, encode_appearance
from encoder.learning.hidden_faces import Outlines
from encoder.learning.sample_fitting import (
    fit_samples,
    fit_samples_coarse,
    fit_samples_in_image,
    sample_faces,
    super_resolved,
)
from protocol.pictures.picture_codec import to_luma
from shared_model.animate import Face
from shared_model.appearance import atlas_of
from shared_model.arrays import Array, Picture, Single
from shared_model.geometry import Camera
from shared_model.parameters import EAU_INDEX, EAUS, FaceParameters

# The expression of a wide open face, and the share of its texel footprints that counts for texels
# that the sample hides.
WIDE_OPEN_EAUS = {"jaw_drop": 0.6, "upper_lip_raise": 0.5, "lower_lip_lower": 0.5}
DISOCCLUSION_SHARE = 0.5


# Levenberg-Marquardt iterations of a frame's fit.
FRAME_FIT_ITERATIONS = 3


@dataclass(frozen=True, slots=True)
class PersonModel:
    """What is constant for a person between two model packets.

    face: with the quantised identity.  reference: the pose of the model packet.
    texel_fitter: fits frames at a subset of the texels.
    shape: all texels.  weight: (k,) of squared errors of each texel.
    mask: (k,) 1 on the face, see `face_mask`.
    """

    fitted: IdentityFit
    face: Face
    reference: FaceParameters
    texel_fitter: TexelFitter
    appearance: CodedAppearance
    pixels_per_texel: float
    shape: ShapeFreeFrame
    weight: Single
    mask: Single

    def fit_texels(
        self,
        crop: Crop,
        initial: FaceParameters,
        iterations: int = FRAME_FIT_ITERATIONS,
        halved: bool = False,
    ) -> FaceParameters:
        """The face of a frame, near `initial`, fitted in the shape-free frame.

        halved: the crop has half the resolution; half the rows and columns of texels are fitted.
        """
        fitter = self.texel_fitter.halved if halved else self.texel_fitter
        return fitter.fit_crop(crop, initial, iterations)

    def image_fitter(self, max_pixels: int = MAX_PIXELS) -> ImageFitter:
        """Renders the appearance as a decoder does.  max_pixels: see `ImageFitter`."""
        mean, modes = to_luma(self.appearance.mean), to_luma(self.appearance.mode_images)
        return ImageFitter(self.face, self.shape.camera, mean, modes, max_pixels)


@dataclass(frozen=True, slots=True)
class TrainedModel:
    """A person model, and the crops and fitted faces of its sample."""

    person: PersonModel
    crops: list[Crop]
    faces: list[FaceParameters]


@dataclass(frozen=True, slots=True)
class PersonModelOptions:
    """How a person model is trained.

    texture_size: the most texels a side.  appearance_bytes: of mean and modes.
    image_space_fit: fit the faces of the sample in image space after the shape-free frame.
    weight_disoccluded: give hidden texels the weight that they have in a wide open face.
    weight_mouth: multiply the weight of mouth and lips, see `mouth_weights`.
    nominal_texels: see `TexelFitter`.
    reference: index of the frame whose face is the reference.
    searches_step: see `encode_appearance`.
    """

    texture_size: int
    appearance_bytes: int
    max_modes: int
    image_space_fit: bool = True
    weight_disoccluded: bool = False
    weight_mouth: bool = False
    nominal_texels: int = NOMINAL_TEXELS
    reference: int = 0
    searches_step: bool = True


@dataclass(frozen=True, slots=True)
class PersonBase:
    """What a person model is built on: see `PersonModel`."""

    fitted: IdentityFit
    face: Face
    reference: FaceParameters
    shape: ShapeFreeFrame
    pixels_per_texel: float
    mask: Single


def build_person_model(
    fitted: IdentityFit,
    face: Face,
    camera: Camera,
    faces: Sequence[FaceParameters],
    sample_frames: Sequence[tuple[int, Picture]],
    landmarks: Sequence[Array],
    options: PersonModelOptions,
    workers: int | None = None,
    hands: Sequence[Outlines] = (),
) -> TrainedModel:
    """Build the model of a person from a sample of frames (index, picture).

    face: with the quantised identity.  camera: of the call parameters, with rounded focal length.
    faces, landmarks: of all frames, (468, 3) pixels; indices of the sample refer to them.
    workers: see `parallel_map`.
    hands: what hides the face in each frame of the sample; empty: nothing does.
    """
    reference = faces[options.reference]
    shape, scale = texel_frame(face, camera, reference, options.texture_size)
    crops = [crop_face(frame, landmarks[index], scale) for index, frame in sample_frames]
    if hands:
        crops = [crop.hiding(outlines) for crop, outlines in zip(crops, hands, strict=True)]
    sampled = [faces[index] for index, _ in sample_frames]
    sampled_landmarks = [landmarks[index] for index, _ in sample_frames]
    sampled = fit_samples_coarse(face, shape, crops, sampled, workers, options.nominal_texels)
    if options.image_space_fit:
        sampled = fit_samples_in_image(face, shape, crops, sampled, sampled_landmarks, workers)
    coverage = outline_coverage(shape, crops, sampled, sampled_landmarks, workers)
    mask = np.maximum(face_mask(face.head, shape.atlas), coverage)
    base = PersonBase(fitted, face, reference, shape, scale, mask)
    person = person_of_fitted_sample(base, crops, sampled, options, workers)
    sampled = fit_samples(person.texel_fitter, crops, sampled, workers)
    return TrainedModel(person, crops, sampled)


def person_of_fitted_sample(
    base: PersonBase,
    crops: Sequence[Crop],
    faces: Sequence[FaceParameters],
    options: PersonModelOptions,
    workers: int | None = None,
) -> PersonModel:
    """The model of a person whose faces in a sample of crops are known (thesis eq. 2.17).

    workers: see `parallel_map`.
    """
    face, shape, mask = base.face, base.shape, base.mask
    samples = sample_faces(face, shape, crops, faces, workers)
    weight = _texel_weight(face, shape, samples.weight, faces, mask, options)
    samples = replace(samples, weight=weight)
    sharp = super_resolved(shape, samples, crops, faces, workers)
    mean = mean_texture(shape, sharp, default_colours(face.head, shape.atlas))
    appearance = _encode_appearance(shape, sharp, mean, mask, options)
    template = sampled_template(shape, samples, sharp, appearance)
    fitter = TexelFitter(face, shape, template, nominal_texels=options.nominal_texels)
    return PersonModel(
        base.fitted,
        face,
        base.reference,
        fitter,
        appearance,
        base.pixels_per_texel,
        shape,
        weight * mask,
        mask,
    )


def _encode_appearance(
    shape: ShapeFreeFrame,
    sharp: TextureSamples,
    mean: Single,
    mask: Single,
    options: PersonModelOptions,
) -> CodedAppearance:
    most = options.appearance_bytes, options.max_modes
    return encode_appearance(shape, sharp, mean, mask, *most, options.searches_step)


def texel_frame(
    face: Face, camera: Camera, reference: FaceParameters, max_size: int
) -> tuple[ShapeFreeFrame, float]:
    """The texels at the resolution of the reference frame, and its pixels per texel."""
    vertices = face.animate(reference.eau)
    coarse = atlas_of(face.head, 64)
    size = atlas_size_for(coarse, camera, reference.pose, vertices, max_size)
    atlas = atlas_of(face.head, size)
    scale = pixels_per_texel(atlas, camera, reference.pose, vertices)
    return ShapeFreeFrame(face, atlas, camera), scale


def _texel_weight(
    face: Face,
    shape: ShapeFreeFrame,
    footprints: Single,
    faces: Sequence[FaceParameters],
    mask: Single,
    options: PersonModelOptions,
) -> Single:
    """(k,) weight of each texel's squared errors, less outside the face.

    footprints: (k,) mean number of pixels in the sample.  faces: of the sample.
    """
    weight = footprints
    if options.weight_disoccluded:
        weight = np.maximum(weight, disocclusion_weight(face, shape, faces))
    if options.weight_mouth:
        weight = weight * mouth_weights(face.head, shape.atlas)
    return np.asarray(weight * np.where(shape.on_face, np.float32(1), mask), np.float32)


def disocclusion_weight(
    face: Face, shape: ShapeFreeFrame, faces: Sequence[FaceParameters]
) -> Single:
    """(k,) share of the pixels that each texel covers with mouth and eyes wide open.

    faces: of the sample; the pose is that of the first.
    """
    eau = np.zeros(len(EAUS))
    for name, value in WIDE_OPEN_EAUS.items():
        eau[EAU_INDEX[name]] = value
    wide_open = FaceParameters(faces[0].pose, eau)
    visible = visible_texels(shape.atlas, wide_open.pose, face.animate(eau))
    footprints = texel_footprints(shape, shape.positions(wide_open))
    return np.asarray(DISOCCLUSION_SHARE * footprints * visible, np.float32)


def decoded_template(
    shape: ShapeFreeFrame, samples: TextureSamples, appearance: CodedAppearance
) -> Template:
    """The template of mean and modes as a decoder paints them."""
    at = (shape.atlas.rows, shape.atlas.columns)
    modes = np.array([to_luma(image[at]) for image in appearance.mode_images], np.float32)
    return Template(to_luma(appearance.mean[at]), modes.reshape(-1, len(at[0])), samples.weight)


def sampled_template(
    shape: ShapeFreeFrame,
    samples: TextureSamples,
    sharp: TextureSamples,
    appearance: CodedAppearance,
) -> Template:
    """The template that texels sampled from a frame are compared with.

    Samples are blurred against the texture that is painted: mean and modes are the regression of
    the samples on the coefficients of the painted modes.
    sharp: the samples after super-resolution.
    """
    painted = decoded_template(shape, sharp, appearance)
    if not len(painted.modes):
        return Template(to_luma(samples.colours.mean(0)), painted.modes, samples.weight)
    weight = np.sqrt(np.maximum(samples.weight, 1e-6))
    residual = (to_luma(sharp.colours) - painted.mean) * sharp.visible
    rows = painted.modes * weight
    coefficients = np.linalg.lstsq(rows.T, (residual * weight).T, rcond=None)[0].T
    design = np.concatenate([np.ones((len(coefficients), 1)), coefficients], 1)
    luma = np.where(
        samples.visible, to_luma(samples.colours), painted.mean + coefficients @ painted.modes
    )
    regressed = (np.linalg.pinv(design) @ luma).astype(np.float32)
    return Template(regressed[0], regressed[1:], samples.weight)
