"""A caller: identity and appearance, learned from a sample of frames, to find further frames by."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from encoder.appearance.masks import face_mask, mouth_weight, within_outline
from encoder.appearance.shape_free import ShapeFree
from encoder.appearance.super_resolution import sharpened
from encoder.appearance.template import Template
from encoder.appearance.texel_visibility import DEPTH_CELL_MM, visible_texels
from encoder.appearance.texture import fitting_size, texel_pixels, unseen_colours
from encoder.appearance.texture_samples import Stack, mean_colours, shape_free_stack, texel_areas
from encoder.capture.face_crop import Crop, crop_face
from encoder.coding.model_packet import Budget, identity_of, shape_packet
from encoder.detection.landmark_indices import outline_of
from encoder.fitting.analysis_by_synthesis import TEXELS, Refiner, coefficients
from encoder.fitting.identity import Fitted
from encoder.fitting.render_and_compare import Drawing
from encoder.learning.appearance_encoder import Appearance, code_appearance, whole_atlas
from encoder.learning.pca import luma_modes, template_of
from encoder.runtime.parallel import on_cores
from protocol.packets import CallParameters
from protocol.pictures.picture_codec import to_luma
from shared_model.animate import Face
from shared_model.appearance import atlas_of
from shared_model.geometry import Camera
from shared_model.mesh import Head
from shared_model.parameters import EAU_INDEX, EAUS, FaceParameters

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Picture = NDArray[np.uint8]

TRACKING_MODES = (0, 4, 8)
DRAWN_MODES = 14
# A face that shows all it has, and what share of the texels' pixels then counts of those that have
# not been seen.
OPEN = {"jaw_drop": 0.6, "upper_lip_raise": 0.5, "lower_lip_lower": 0.5}
OPEN_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class Caller:
    """Everything about the caller that does not change from frame to frame.

    face: with this identity, as the decoder has it.
    tracker: what frames are refined with, at a part of the texels.
    shape: all texels.  weight: (k,) what each counts: the pixels it covers, less beside the face;
        in live calls more in the mouth and on the lips, and what may yet be seen as if half seen.
    mask: (k,) 1 on the face, see `face_mask`.
    """

    fitted: Fitted
    face: Face
    reference: FaceParameters
    tracker: Refiner
    appearance: Appearance
    pixels_per_texel: float
    shape: ShapeFree
    weight: Single
    mask: Single


@dataclass(frozen=True, slots=True)
class Learned:
    """A caller, and the sample it was learned from with its refined faces."""

    caller: Caller
    crops: list[Crop]
    faces: list[FaceParameters]


def learn_caller(
    head: Head,
    fitted: Fitted,
    faces: Sequence[FaceParameters],
    sample_frames: Sequence[tuple[int, Picture]],
    points: Sequence[Array],
    call: CallParameters,
    budget: Budget,
    workers: int | None = None,
    live: bool = False,
) -> Learned:
    """The caller's appearance from a sample of frames (number, picture).

    workers: see `on_cores`; one where frames of a live call are coded meanwhile.
    live: what these frames hide in the mouth and behind the lids may yet be seen, what a mouth does
        must be learned from a part of it, and all of it before the next update: the sample's faces
        are not fitted by their pixels.
    """
    reference = faces[0]
    packet = shape_packet(fitted, reference, call)
    camera = call.camera
    face = Face(head, identity_of(head, packet))
    rest = face.animate(reference.eau)
    size = fitting_size(atlas_of(head, 64), camera, reference.pose, rest, budget.texture_size)
    atlas = atlas_of(head, size)
    shape = ShapeFree(face, atlas, camera)
    ratio = texel_pixels(atlas, camera, reference.pose, rest)
    crops = [crop_face(frame, points[number], ratio) for number, frame in sample_frames]
    found = [faces[number] for number, _ in sample_frames]
    found = tracked(head, face, camera, size, crops, found, workers)
    outlines = [points[number] for number, _ in sample_frames]
    if not live:
        found = drawn_best(head, shape, face, crops, found, outlines, workers)
    stack = shape_free_views(head, shape, face, crops, found, workers)
    shown = within_outline(shape, crops, found, outlines)
    mask = np.maximum(face_mask(head, atlas), shown)
    weight = stack.weight
    if live:
        weight = np.maximum(weight, opened(head, shape, face, found)) * mouth_weight(head, atlas)
    stack = replace(stack, weight=weight * np.where(shape.on_face, np.float32(1), mask))
    sharp = sharpened_stack(shape, stack, crops, found, workers)
    mean = mean_colours(shape, sharp, unseen_colours(head, atlas))
    appearance = code_appearance(shape, sharp, mean, mask, budget.face_bytes, budget.most_modes)
    refiner = Refiner(head, face, shape, sampled_template(shape, stack, sharp, appearance))
    found = refined(refiner, crops, found, workers)
    weight = stack.weight * mask
    caller = Caller(fitted, face, reference, refiner, appearance, ratio, shape, weight, mask)
    return Learned(caller, crops, found)


def opened(head: Head, shape: ShapeFree, face: Face, faces: Sequence[FaceParameters]) -> Single:
    """(k,) part of the pixels that each texel would cover with mouth and eyes wide open.

    faces: of the caller; the pose is the first one's.
    """
    eau = np.zeros(len(EAUS))
    for name, value in OPEN.items():
        eau[EAU_INDEX[name]] = value
    wide = FaceParameters(faces[0].pose, eau)
    seen = visible_texels(head, shape.atlas, wide.pose, face.animate(eau))
    return np.asarray(OPEN_SHARE * texel_areas(shape, shape.positions(wide)) * seen, np.float32)


def tracked(
    head: Head,
    face: Face,
    camera: Camera,
    size: int,
    crops: Sequence[Crop],
    found: Sequence[FaceParameters],
    workers: int | None = None,
) -> list[FaceParameters]:
    """The faces `found` in crops, refined against their own mean and ever more modes.

    size: of the texture that the crops are for, a side; a coarser one serves here.
    workers: see `on_cores`.
    """
    coarser = max(1, round(float(np.sqrt(len(atlas_of(head, size).rows) / TEXELS))))
    shape = ShapeFree(face, atlas_of(head, size // coarser), camera)
    cell_mm = coarser * DEPTH_CELL_MM
    grey, faces = [crop.grey for crop in crops], list(found)
    for modes in TRACKING_MODES:
        stack = shape_free_views(head, shape, face, grey, faces, workers, cell_mm)
        template = luma_template(head, shape, stack, modes)
        refiner = Refiner(head, face, shape, template, cell_mm=cell_mm)
        faces = refined(refiner, crops, faces, workers)
    return faces


def luma_template(head: Head, shape: ShapeFree, stack: Stack, most_modes: int) -> Template:
    """Mean and leading modes of a stack of luma, no more than one mode to three frames."""
    mean = mean_colours(shape, stack, to_luma(unseen_colours(head, shape.atlas))[:, None])
    count = min(most_modes, len(stack.colours) // 3)
    return template_of(stack, mean, luma_modes(stack, mean, count))


def drawn_best(
    head: Head,
    shape: ShapeFree,
    face: Face,
    crops: Sequence[Crop],
    found: Sequence[FaceParameters],
    points: Sequence[Array],
    workers: int | None = None,
) -> list[FaceParameters]:
    """The faces `found` in crops as they draw best, see `Drawing`, with their own mean and modes.

    points: (468, >= 2) pixels, landmarks of each frame.  workers: see `on_cores`.
    """
    grey = [crop.grey for crop in crops]
    stack = shape_free_views(head, shape, face, grey, found, workers)
    sharp = sharpened_stack(shape, stack, grey, found, workers)
    template = luma_template(head, shape, sharp, DRAWN_MODES)
    painted = [template.mean, *template.modes]
    layers = np.array([whole_atlas(shape, layer[:, None])[..., 0] for layer in painted])
    drawing = Drawing(face, shape.camera, layers[0], layers[1:])
    weights = stack.weight * stack.seen

    def fit(number: int) -> FaceParameters:
        luma = sharp.colours[number][:, 0]
        start = replace(found[number], modes=coefficients(template, luma, weights[number]))
        return drawing.fit(crops[number], start, outline_of(points[number]))

    return on_cores(fit, range(len(crops)), workers)


def refined(
    refiner: Refiner,
    crops: Sequence[Crop],
    faces: Sequence[FaceParameters],
    workers: int | None = None,
) -> list[FaceParameters]:
    """The faces in crops, two steps nearer to what the template says.

    workers: see `on_cores`.
    """
    pairs = zip(crops, faces, strict=True)
    return on_cores(lambda pair: refiner.refine(pair[0], pair[1], 2), pairs, workers)


def decoded_template(shape: ShapeFree, stack: Stack, appearance: Appearance) -> Template:
    """What the decoder will paint, as the template to refine against."""
    at = (shape.atlas.rows, shape.atlas.columns)
    modes = np.array([to_luma(image[at]) for image in appearance.mode_images], np.float32)
    return Template(to_luma(appearance.mean[at]), modes.reshape(-1, len(at[0])), stack.weight)


def sampled_template(
    shape: ShapeFree, stack: Stack, sharp: Stack, appearance: Appearance
) -> Template:
    """What sampling a picture should give where the decoder paints `appearance`.

    Samples are blunter than what is painted; their mean and modes are regressed on the painted
    modes' coefficients in the stack.
    """
    painted = decoded_template(shape, sharp, appearance)
    if not len(painted.modes):
        return Template(to_luma(stack.colours.mean(0)), painted.modes, stack.weight)
    weight = np.sqrt(np.maximum(stack.weight, 1e-6))
    wanted = (to_luma(sharp.colours) - painted.mean) * sharp.seen
    rows = painted.modes * weight
    coefficients = np.linalg.lstsq(rows.T, (wanted * weight).T, rcond=None)[0].T
    design = np.concatenate([np.ones((len(coefficients), 1)), coefficients], 1)
    filled = np.where(
        stack.seen, to_luma(stack.colours), painted.mean + coefficients @ painted.modes
    )
    fitted = np.linalg.lstsq(design, filled, rcond=None)[0].astype(np.float32)
    return Template(fitted[0], fitted[1:], stack.weight)


def sharpened_stack(
    shape: ShapeFree,
    stack: Stack,
    crops: Sequence[Crop],
    faces: Sequence[FaceParameters],
    workers: int | None = None,
) -> Stack:
    """The stack with colours that draw right, see `sharpened`.  workers: see `on_cores`."""

    def sharpen(view: tuple[Crop, FaceParameters, Single, NDArray[np.bool_]]) -> Single:
        crop, face, colours, seen = view
        return sharpened(shape, crop, crop.from_frame(shape.positions(face)), colours, seen)

    views = zip(crops, faces, stack.colours, stack.seen, strict=True)
    return replace(stack, colours=np.array(on_cores(sharpen, views, workers)))


def shape_free_views(
    head: Head,
    shape: ShapeFree,
    face: Face,
    crops: Sequence[Crop],
    found: Sequence[FaceParameters],
    workers: int | None,
    cell_mm: float = DEPTH_CELL_MM,
) -> Stack:
    """What the texels of `shape` show in crops, see `shape_free_stack`.  face: the caller's."""
    vertices = [face.animate(f.eau) for f in found]
    return shape_free_stack(head, shape, crops, found, vertices, cell_mm, workers)
