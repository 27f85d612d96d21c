"""Fits the face in a sample of frames, and samples its texture and finds the main modes of it.

There is no person model yet.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from encoder.appearance.shape_free import ShapeFreeFrame
from encoder.appearance.super_resolution import back_projected
from encoder.appearance.template import Template
from encoder.appearance.texel_visibility import DEPTH_CELL_MM
from encoder.appearance.texture import default_colours
from encoder.appearance.texture_samples import TextureSamples, mean_texture, sample_textures
from encoder.capture.face_crop import Crop
from encoder.detection.landmark_indices import face_outline
from encoder.fitting.analysis_by_synthesis import NOMINAL_TEXELS, TexelFitter, solve_coefficients
from encoder.fitting.render_and_compare import ImageFitter
from protocol.pictures.picture_codec import to_luma
from runtime.parallel import parallel_map
from shared_model.animate import Face
from shared_model.appearance import atlas_of, filled_atlas
from shared_model.arrays import Array, Mask, Single
from shared_model.parameters import FaceParameters

# Modes of the template in each round of the coarse fit, and of the fit in the image.
COARSE_MODE_SCHEDULE = (0, 4, 8)
IMAGE_FIT_MODES = 14
FIT_STEPS = 2
FRAMES_PER_MODE = 3


def fit_samples_coarse(
    face: Face,
    shape: ShapeFreeFrame,
    crops: Sequence[Crop],
    faces: Sequence[FaceParameters],
    workers: int | None = None,
    nominal_texels: int = NOMINAL_TEXELS,
) -> list[FaceParameters]:
    """Fit the faces in crops to their own mean and modes, in the shape-free frame.

    Each round samples a new mean and more modes by the faces of the round before.
    shape: all texels; the fit uses an atlas of about `nominal_texels`.
    faces: initial, one a crop.  workers: see `parallel_map`.
    """
    reduction = max(1, round(float(np.sqrt(len(shape) / nominal_texels))))
    atlas = atlas_of(face.head, shape.atlas.size // reduction)
    coarse = ShapeFreeFrame(face, atlas, shape.camera)
    cell_mm = reduction * DEPTH_CELL_MM
    luma_crops, faces = [crop.as_luma for crop in crops], list(faces)
    for modes in COARSE_MODE_SCHEDULE:
        samples = sample_faces(face, coarse, luma_crops, faces, workers, cell_mm)
        template = luma_template(face, coarse, samples, modes)
        fitter = TexelFitter(face, coarse, template, cell_mm=cell_mm)
        faces = fit_samples(fitter, crops, faces, workers)
    return faces


def fit_samples_in_image(
    face: Face,
    shape: ShapeFreeFrame,
    crops: Sequence[Crop],
    faces: Sequence[FaceParameters],
    landmarks: Sequence[Array],
    workers: int | None = None,
) -> list[FaceParameters]:
    """Fit the faces in crops to their own mean and modes, in image space.

    faces: initial, one a crop.  landmarks: (468, >= 2) pixels of each frame.
    workers: see `parallel_map`.
    """
    luma_crops = [crop.as_luma for crop in crops]
    samples = sample_faces(face, shape, luma_crops, faces, workers)
    sharp = super_resolved(shape, samples, luma_crops, faces, workers)
    template = luma_template(face, shape, sharp, IMAGE_FIT_MODES)
    textures = [template.mean, *template.modes]
    images = np.array([filled_atlas(shape.atlas, each[:, None])[..., 0] for each in textures])
    fitter = ImageFitter(face, shape.camera, images[0], images[1:])
    weights = samples.weight * samples.visible

    def fit(index: int) -> FaceParameters:
        luma = sharp.colours[index][:, 0]
        start = replace(faces[index], modes=solve_coefficients(template, luma, weights[index]))
        return fitter.fit(crops[index], start, face_outline(landmarks[index]))

    return parallel_map(fit, range(len(crops)), workers)


def fit_samples(
    fitter: TexelFitter,
    crops: Sequence[Crop],
    faces: Sequence[FaceParameters],
    workers: int | None = None,
) -> list[FaceParameters]:
    """The faces in crops after `FIT_STEPS` steps of `fitter`.  workers: see `parallel_map`."""
    pairs = zip(crops, faces, strict=True)
    return parallel_map(lambda pair: fitter.fit_crop(pair[0], pair[1], FIT_STEPS), pairs, workers)


def luma_template(
    face: Face, shape: ShapeFreeFrame, samples: TextureSamples, max_modes: int
) -> Template:
    """Mean and leading modes of luma samples, at most one mode to `FRAMES_PER_MODE` frames."""
    default = to_luma(default_colours(face.head, shape.atlas))[:, None]
    mean = mean_texture(shape, samples, default)
    count = min(max_modes, len(samples.colours) // FRAMES_PER_MODE)
    return make_template(samples, mean, luma_modes(samples, mean, count))


def sample_faces(
    face: Face,
    shape: ShapeFreeFrame,
    crops: Sequence[Crop],
    faces: Sequence[FaceParameters],
    workers: int | None,
    cell_mm: float = DEPTH_CELL_MM,
) -> TextureSamples:
    """The texels of `shape` in crops whose faces are fitted, see `sample_textures`."""
    vertices = [face.animate(fitted.eau) for fitted in faces]
    return sample_textures(shape, crops, faces, vertices, cell_mm, workers)


def super_resolved(
    shape: ShapeFreeFrame,
    samples: TextureSamples,
    crops: Sequence[Crop],
    faces: Sequence[FaceParameters],
    workers: int | None = None,
) -> TextureSamples:
    """The samples with colours that render to the crops, see `back_projected`.

    faces: of the crops that were sampled.  workers: see `parallel_map`.
    """

    def sharpen(view: tuple[Crop, FaceParameters, Single, Mask]) -> Single:
        crop, face, colours, visible = view
        return back_projected(shape, crop, crop.to_crop_px(shape.positions(face)), colours, visible)

    views = zip(crops, faces, samples.colours, samples.visible, strict=True)
    return replace(samples, colours=np.array(parallel_map(sharpen, views, workers)))


def luma_modes(samples: TextureSamples, mean: Single, count: int) -> Single:
    """The leading `count` principal components (count, k) of luma samples about `mean` (k, 1).

    The components have unit length in the metric of the samples' texel weights.
    """
    if not count:
        return np.zeros((0, len(mean)), np.float32)
    residual = (samples.colours - mean)[..., 0] * samples.visible
    root = np.sqrt(np.maximum(samples.weight, 1e-6))
    rows = np.asarray(residual * root, np.float32)
    # Frames are fewer than texels: the Gram matrix of the frames is smaller than an SVD's input.
    _, vectors = np.linalg.eigh((rows @ rows.T).astype(np.float64))
    modes = vectors[:, : -count - 1 : -1].T.astype(np.float32) @ rows
    lengths = np.maximum(np.linalg.norm(modes, axis=1, keepdims=True), 1e-6)
    return np.asarray(modes / lengths / root, np.float32)


def make_template(samples: TextureSamples, mean: Single, modes: Single) -> Template:
    """The template of a mean (k, 1) and modes (m, k), luma, with the weights of the samples."""
    return Template(mean[:, 0], modes, samples.weight)
