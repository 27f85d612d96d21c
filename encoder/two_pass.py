"""The default profile of a recorded source: look at all of it, then send the best call.

First pass: landmarks of every frame.  Between: one identity for the whole call, an appearance
model learned from a sample of frames.  Second pass: every frame refined against that model,
combined, coded.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from encoder.code_appearance import Appearance, code_appearance
from encoder.combine import Sensitivity, combine, project, sensitivity
from encoder.crop import Crop, crop_face
from encoder.fit import (
    EYE_CORNERS,
    Fitted,
    fit_frame,
    fit_identity,
    landmark_model,
    personalise,
    start_parameters,
)
from encoder.learn import (
    Stack,
    face_mask,
    luma_modes,
    mean_colours,
    shape_free_stack,
    template_of,
    texel_areas,
    within_outline,
)
from encoder.model import Budget, identity_of, shape_packet
from encoder.parallel import on_cores
from encoder.refine import TEXELS, Refiner, Template
from encoder.shape_free import ShapeFree
from encoder.sharpen import sharpened
from encoder.texture import (
    DEPTH_CELL_MM,
    fitting_size,
    texel_pixels,
    unseen_colours,
    visible_texels,
)
from protocol.components import Components, serialise_components, vector_from_face
from protocol.messages import CallParameters, ModelPacket
from protocol.pictures import to_luma
from shared_model.animate import Face
from shared_model.appearance import atlas_of
from shared_model.geometry import Camera
from shared_model.mesh import Head
from shared_model.parameters import EAU_INDEX, EAUS, FaceParameters

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Picture = NDArray[np.uint8]

IDENTITY_FRAMES = 10
TRAINING_FRAMES = 64
TRACKING_MODES = (0, 4, 8)
SENSITIVITY_FRAMES = 12
# A face that shows all it has, and what share of the texels' pixels then counts of those that have
# not been seen.
OPEN = {"jaw_drop": 0.6, "upper_lip_raise": 0.5, "lower_lip_lower": 0.5}
OPEN_SHARE = 0.5
# Landmarks are smoothed over time with this kernel before the first fit.
SMOOTHING = np.array([0.06, 0.24, 0.4, 0.24, 0.06])


@dataclass(frozen=True, slots=True)
class Caller:
    """Everything about the caller that does not change from frame to frame.

    tracker: what frames are refined with, at a part of the texels.
    shape: all texels.  weight: (k,) pixels that each covers, less beside the face.
    mask: (k,) 1 on the face, see `face_mask`.
    """

    fitted: Fitted
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


class Sampler:
    """Keeps `least` frames to twice as many of a source of any length."""

    def __init__(self, least: int = TRAINING_FRAMES) -> None:
        self._least, self._stride = least, 1
        self.frames: list[tuple[int, Picture]] = []

    def offer(self, number: int, window: Callable[[], Picture]) -> None:
        """Take or leave item `number`; `window` makes the picture to keep."""
        if number % self._stride:
            return
        self.frames.append((number, window()))
        if len(self.frames) >= 2 * self._least:
            self._stride *= 2
            self.frames = [f for f in self.frames if f[0] % self._stride == 0]


def follow_all(
    head: Head, size: tuple[int, int], points: Sequence[Array]
) -> tuple[Fitted, list[FaceParameters]]:
    """One identity, and pose and actuators of every frame, from its landmarks (468, 3)."""
    chosen = spread_frames(np.array(points))
    fitted = fit_identity(head, size, [points[i] for i in chosen])
    model = personalise(landmark_model(head), fitted.identity.aau, fitted.control_mm)
    current = start_parameters(model, fitted.camera, points[0])
    faces = []
    for place in points:
        current = fit_frame(model, fitted.camera, place, current)
        faces.append(current)
    return fitted, faces


def smoothed(points: Array) -> Array:
    """Landmarks (t, 468, 3) low-passed over time; the ends as they are mirrored."""
    reach = len(SMOOTHING) // 2
    if len(points) <= reach:
        return points
    padded = np.pad(points, ((reach, reach), (0, 0), (0, 0)), mode="reflect")
    return np.asarray(sum(w * padded[i : i + len(points)] for i, w in enumerate(SMOOTHING)))


def spread_frames(points: Array) -> list[int]:
    """Indices of up to `IDENTITY_FRAMES` frames, spread over yaw and pitch."""
    eyes = points[:, list(EYE_CORNERS)].mean(1)
    turn = points[:, 1, :2] - eyes[:, :2]
    shares = np.linspace(0.02, 0.98, IDENTITY_FRAMES // 2)
    picks = [np.argsort(turn[:, axis])[(shares * (len(points) - 1)).astype(int)] for axis in (0, 1)]
    return sorted(set(np.concatenate(picks).tolist()))


def learn_caller(
    head: Head,
    fitted: Fitted,
    faces: Sequence[FaceParameters],
    sample_frames: Sequence[tuple[int, Picture]],
    points: Sequence[Array],
    call: CallParameters,
    budget: Budget,
    workers: int | None = None,
    more_to_come: bool = False,
) -> Learned:
    """The caller's appearance from a sample of frames (number, picture).

    workers: see `on_cores`; one where frames of a live call are coded meanwhile.
    more_to_come: what these frames hide in the mouth and behind the lids may yet be seen.
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
    stack = shape_free_views(head, shape, face, crops, found, workers)
    shown = within_outline(shape, crops, found, [points[number] for number, _ in sample_frames])
    mask = np.maximum(face_mask(head, atlas), shown)
    if more_to_come:
        stack = replace(stack, weight=np.maximum(stack.weight, opened(head, shape, face, found)))
    stack = replace(stack, weight=stack.weight * np.where(shape.on_face, np.float32(1), mask))
    sharp = sharpened_stack(shape, stack, crops, found, workers)
    mean = mean_colours(shape, sharp, unseen_colours(head, atlas))
    appearance = code_appearance(shape, sharp, mean, mask, budget.face_bytes, budget.most_modes)
    refiner = Refiner(head, face, shape, sampled_template(shape, stack, sharp, appearance))
    found = refined(refiner, crops, found, workers)
    caller = Caller(fitted, reference, refiner, appearance, ratio, shape, stack.weight * mask, mask)
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
    unseen, faces = unseen_colours(head, shape.atlas), list(found)
    for modes in TRACKING_MODES:
        stack = shape_free_views(head, shape, face, crops, faces, workers, cell_mm)
        mean = mean_colours(shape, stack, unseen)
        template = template_of(stack, mean, luma_modes(stack, mean, min(modes, len(crops) // 3)))
        refiner = Refiner(head, face, shape, template, cell_mm=cell_mm)
        faces = refined(refiner, crops, faces, workers)
    return faces


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


def combine_call(
    learned: Learned, faces: Sequence[FaceParameters], frames_per_packet: int
) -> tuple[Components, Array]:
    """The call's components, and their values (t, n) in every frame."""
    caller = learned.caller
    pose = caller.reference.pose
    harm = sensitivity_of(learned).harm(caller.tracker.template.modes)
    vectors = np.array([vector_from_face(face, pose) for face in faces])
    components = combine(vectors, harm, caller.appearance.modes, frames_per_packet)
    return components, project(components, vectors, harm)


def sensitivity_of(learned: Learned) -> Sensitivity:
    """What errors do to this caller's picture, by a few of the frames it was learned from."""
    caller = learned.caller
    every = slice(None, None, max(1, len(learned.crops) // SENSITIVITY_FRAMES))
    pose = caller.reference.pose
    return sensitivity(caller.tracker, learned.crops[every], learned.faces[every], pose)


def default_model(
    caller: Caller, components: Components, call: CallParameters, background: bytes
) -> ModelPacket:
    """The model packet of the default profile.  background: the coded still."""
    return replace(
        shape_packet(caller.fitted, caller.reference, call),
        background=background,
        texture=caller.appearance.texture,
        extension=serialise_components(components),
    )


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
