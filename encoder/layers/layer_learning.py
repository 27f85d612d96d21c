"""The layers of a call's person, where the segmentation network is installed and finds them.

They are learned from a sample of frames; a live call begins with those of a single frame.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from encoder.detection.segmentation import PersonSegmenter
from encoder.detection.tflite import find_segmentation_network
from encoder.layers.frame_layers import FrameLayers, layer_distortion
from encoder.layers.layer_model import (
    LIGHT_SIGMA,
    LayerModel,
    coarse_fitter,
    encode_layers,
    learn_layers,
    with_fields,
)
from encoder.layers.layer_samples import (
    PICTURE_SIDE,
    FittedFrames,
    collect_samples,
    reference_mesh,
    scaled_shape,
    shrunk,
)
from encoder.layers.light import in_newest_light
from encoder.layers.motion_fields import FULL_CODE, field_codes
from encoder.layers.person_picture import PERSON_SHARE, SOFT_OPACITY, covered_region
from encoder.layers.scene import CLEAR_MATTE, SceneLayer
from protocol.pictures.foreground_mask import FINE_MASK_SIDE
from protocol.pictures.layered_background import (
    FIELD_CODES_PER_PX,
    LIGHT_COEFFICIENTS,
    SCENE_COEFFICIENTS,
    LayeredBackground,
    field_shape,
)
from shared_model.appearance import pull_push_fill
from shared_model.arrays import Array, Integers, Mask, Picture, Single
from shared_model.layers.head_motion import smoothstep
from shared_model.layers.soft_mask import opacity

NO_NETWORK = (
    "the segmentation network is not installed: shoulders and scene are one picture (pip install"
    " 'mediapipe==0.10.14')"
)
NO_PERSON = "the person cannot be told from the scene: both are one picture"

# How far the skull is above the outline of the face, in its height.
SKULL_ABOVE = 0.4
# In face widths: hair around the face's outline; how far from it the body begins to move by itself;
# from the middle of the face to that of the body.
HAIR_MARGIN, NECK_WIDTHS, BODY_BELOW = 0.15, 0.5, 1.5
# Standard deviations of the body's own motion, in face widths, and of the scene's, in its units;
# no coefficient exceeds so many.
BODY_SIGMA, SCENE_SIGMA, MAX_SIGMAS = 0.06, 0.5, 6.0
# Weight of an error around the face in the layers of a single frame, against that in learned ones:
# the bits of the first second are few, and the face needs them.
FIRST_SHARE = 1 / 3
# See `LayerFitter.start_sigma`.
START_SIGMA = 3.0


def layers_of_person(
    frames: FittedFrames, follows_light: bool = False, workers: int | None = None
) -> tuple[LayerModel | None, str]:
    """The layers of a sample of frames; None and why, if there are none.

    follows_light: they are in the light of the newest frame, and follow that of later ones.
    workers: see `parallel_map`.
    """
    path = find_segmentation_network()
    if path is None:
        return None, NO_NETWORK
    samples = collect_samples(PersonSegmenter(path).matte, frames, workers)
    if samples is None:
        return None, NO_PERSON
    if follows_light:
        samples = in_newest_light(samples)
    return learn_layers(frames.person, samples, follows_light), ""


@dataclass(frozen=True, slots=True, eq=False)
class FirstLayers:
    """The layers of a single frame.

    scene, person: (h, w, 3) BGR.  mask: of the person.  outline_px: (k, 2) of the face, pixels.
    fields: codes of how any body moves, see `body_fields`.
    """

    scene: Single
    person: Single
    mask: Mask
    outline_px: Array
    fields: Integers

    def encode(self, max_bytes: int) -> bytes:
        """See `Background`."""
        draft = LayeredBackground(
            self.mask, b"", b"", self.fields, (), scene_moves=True, light_changes=True
        )
        return encode_layers((self.person, self.scene), draft, max_bytes)

    def encode_rough(self, max_bytes: int) -> bytes:
        """See `Background`."""
        draft = LayeredBackground(self.mask, b"", b"", self.fields[:0])
        return encode_layers((self.person, self.scene), draft, max_bytes)

    def frame_layers(self, frames: FittedFrames) -> FrameLayers:
        """What fits and codes frames.  frames: the first one is that of the layers."""
        size, face = (frames.camera.width, frames.camera.height), frames.faces[:1]
        scene = SceneLayer(self.scene, np.zeros((1, SCENE_COEFFICIENTS)))
        mesh = reference_mesh(frames)
        still = coarse_fitter(frames.person, mesh, size, self.mask, self.person, scene)
        fitter = with_fields(still, self.fields)
        body = BODY_SIGMA * float(np.ptp(self.outline_px[:, 0])) * FIELD_CODES_PER_PX / FULL_CODE
        sigmas = np.array([body] * len(self.fields) + [SCENE_SIGMA] * SCENE_COEFFICIENTS)
        limits = MAX_SIGMAS * np.stack([-sigmas, sigmas], 1)
        fitter = replace(fitter, limits=limits, start_sigma=START_SIGMA, follows_light=True)
        sigmas = np.append(sigmas, np.full(LIGHT_COEFFICIENTS, LIGHT_SIGMA))
        at_rest = np.zeros((1, len(sigmas)))
        distortion = layer_distortion(fitter, face, [self.outline_px], at_rest)
        return FrameLayers(fitter, FIRST_SHARE * distortion, sigmas**2)


def layers_of_frame(frame: Picture, outline_px: Array) -> FirstLayers | None:
    """The layers of a frame (h, w, 3) uint8 BGR; None without the network or a person.

    outline_px: (k, 2) of the face, pixels.
    """
    path = find_segmentation_network()
    matte = None if path is None else PersonSegmenter(path).matte(frame, outline_px)
    return None if matte is None else first_layers(frame, outline_px, matte)


def first_layers(frame: Picture, outline_px: Array, matte: Single) -> FirstLayers:
    """The layers of a frame (h, w, 3) uint8 BGR.

    outline_px: (k, 2) of the face, pixels.  matte: (s, s) 0..1, of the person.
    """
    size = frame.shape[1], frame.shape[0]
    shape = scaled_shape(size, PICTURE_SIDE)
    picture = shrunk(frame, shape).astype(np.float32)
    cells = (FINE_MASK_SIDE, FINE_MASK_SIDE)
    mask = np.asarray(cv2.resize(matte, cells, interpolation=cv2.INTER_LINEAR) > PERSON_SHARE)
    share = cv2.resize(matte, shape[::-1], interpolation=cv2.INTER_LINEAR)
    scene = pull_push_fill(picture, share < CLEAR_MATTE)
    alpha = opacity(mask, shape[1], shape[0]).astype(np.float32)[..., None]
    # Drawn over the scene, the person gives the frame.
    unmixed = (picture - (1 - alpha) * scene) / np.maximum(alpha, SOFT_OPACITY[1])
    known = (alpha[..., 0] > SOFT_OPACITY[1]) & ~covered_region(outline_px, size, shape)
    person = pull_push_fill(np.clip(unmixed, 0, 255).astype(np.float32), known)
    return FirstLayers(scene, person, mask, outline_px, field_codes(body_fields(outline_px, size)))


def body_fields(outline_px: Array, size: tuple[int, int]) -> Array:
    """(4, rows, columns, 2) motion fields of a body: to the right, down, nearer, and leaning.

    outline_px: (k, 2) of the face, pixels of a picture of `size`.  The head does not move by them.
    """
    rows, columns = field_shape(*size)
    x, y = np.meshgrid(
        np.linspace(-0.5, size[0] - 0.5, columns), np.linspace(-0.5, size[1] - 0.5, rows)
    )
    width, height = np.ptp(outline_px, axis=0)
    # The skull is above the outline of the face.
    skull = outline_px - np.array([0, SKULL_ABOVE * height])
    head = cv2.convexHull(np.concatenate([outline_px, skull]).astype(np.float32))
    points = np.stack([x, y], -1).reshape(-1, 2)
    within = [cv2.pointPolygonTest(head, (float(u), float(v)), True) for u, v in points]
    away = np.maximum(-np.reshape(within, x.shape) - HAIR_MARGIN * width, 0)
    free = smoothstep(away / (NECK_WIDTHS * width))
    middle = outline_px.mean(0) + np.array([0, BODY_BELOW * width])
    right, down = (x - middle[0]) / width, (y - middle[1]) / width
    one, zero = np.ones_like(x), np.zeros_like(x)
    fields = [(one, zero), (zero, one), (right, down), (-down, right)]
    return np.array([free[..., None] * np.stack(field, -1) for field in fields])
