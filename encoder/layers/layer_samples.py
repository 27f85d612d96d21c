"""The sample of frames that layers are learned from: small pictures, mattes and motion of the head.

Everything is at two sizes: that of the coded pictures, and a coarse one at which motion is found.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.capture.colour import luma_f32
from encoder.layers.displacement import dense, origins, pixel_grid, sample
from protocol.pictures.foreground_mask import FINE_MASK_SIDE
from protocol.pictures.picture_codec import to_luma
from runtime.area_resize import area_resized
from runtime.image_ops import hull_mask
from runtime.parallel import parallel_map
from shared_model.animate import Face
from shared_model.arrays import Array, Mask, Picture, Single
from shared_model.geometry import Camera
from shared_model.layers.head_motion import BackgroundMesh, make_background_mesh, warp
from shared_model.parameters import FaceParameters

FindMatte = Callable[[Picture, Array], Single | None]

# The longer sides of the coded pictures and of the coarse ones, pixels.
PICTURE_SIDE, COARSE_SIDE = 640, 144
# The most frames of a sample.
MAX_SAMPLES = 48
# A pixel is known if the frames that show it weigh as much as so many.
MIN_FRAMES = 0.75


@dataclass(frozen=True, slots=True, eq=False)
class FittedFrames:
    """n frames of one person whose faces are known.

    person, camera: of all frames.
    pictures: (h, w, 3) uint8 BGR.  faces: of each.  outlines_px: (k, 2) of the face in each.
    canonical: number of the frame whose pose is nearest to those of the others.
    reference: the face of that frame, as a decoder has it.
    empty: (h, w, 3) uint8 BGR, pictures in which nobody is there.
    """

    person: Face
    camera: Camera
    pictures: Sequence[Picture]
    faces: Sequence[FaceParameters]
    outlines_px: Sequence[Array]
    canonical: int
    reference: FaceParameters
    empty: Sequence[Picture] = ()


@dataclass(frozen=True, slots=True, eq=False)
class CoarseFrame:
    """What the layers are fitted to in a frame.

    luma: (h, w).  origins: (h, w, 2) coarse pixels, where the person comes from in the canonical
    picture by the motion of the head.  outside: (h, w) 0 in the face, else 1.
    scene_motion: (4,) of the scene behind the person, where that is known.
    """

    luma: Single
    origins: Single
    outside: Single
    scene_motion: Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LayerSamples:
    """n frames of one person, among them the canonical frame.

    mesh: of the canonical face.  size: of the source, (width, height), pixels.
    pictures: (n, h, w, 3) uint8 BGR.  mattes: (n, s, s) 0..1, of the person.
    faces: of each frame.  outlines_px: (n, k, 2) of the face, source pixels.
    motion: (n, rows, columns, 2) source pixels: how the mesh moves with the head.
    canonical: number of the canonical frame.
    empty: (m, h, w, 3) uint8 BGR, pictures in which nobody is there.
    workers: of what is learned from them, see `parallel_map`.
    """

    mesh: BackgroundMesh
    size: tuple[int, int]
    pictures: Picture
    mattes: Single
    faces: tuple[FaceParameters, ...]
    outlines_px: Array
    motion: Array
    canonical: int
    empty: Picture
    workers: int | None = None
    # See `coarse_frames` and `small_pictures`.
    _coarse: list[CoarseFrame] = field(init=False, default_factory=list, repr=False)
    _small: list[Single] = field(init=False, default_factory=list, repr=False)

    def mattes_at(self, shape: tuple[int, int]) -> Single:
        """(n, h, w) the mattes at another size."""
        mattes = np.empty((len(self.mattes), *shape), np.float32)
        for number, matte in enumerate(self.mattes):
            mattes[number] = cv2.resize(matte, shape[::-1], interpolation=cv2.INTER_LINEAR)
        return mattes

    def coarse_frames(self) -> list[CoarseFrame]:
        """The frames at the coarse size; they are made once."""
        if self._coarse:
            return self._coarse
        shape = scaled_shape(self.size, COARSE_SIDE)

        def coarse(number: int) -> CoarseFrame:
            at = origins(dense(self.motion[number], self.size, shape))
            outside = ~face_region(self.outlines_px[number], self.size, shape)
            luma = luma_f32(shrunk(self.pictures[number], shape))
            return CoarseFrame(luma, at, outside.astype(np.float32))

        self._coarse.extend(parallel_map(coarse, range(len(self.faces)), self.workers))
        return self._coarse

    def small_pictures(self) -> Single:
        """(n, FINE_MASK_SIDE, FINE_MASK_SIDE, 3) the pictures; they are made once."""
        if not self._small:
            self._small.append(np.array(parallel_map(mask_sized, self.pictures, self.workers)))
        return self._small[0]

    def chosen(self, numbers: Sequence[int]) -> "LayerSamples":
        """The same of some of the frames, the canonical one among them."""
        kept = list(numbers)
        return replace(
            self,
            pictures=self.pictures[kept],
            mattes=self.mattes[kept],
            faces=tuple(self.faces[number] for number in kept),
            outlines_px=self.outlines_px[kept],
            motion=self.motion[kept],
            canonical=kept.index(self.canonical),
        )

    def shrunk(self, longer: int) -> "LayerSamples":
        """The same with pictures of the source shrunk to a longer side of at most `longer`."""
        shape = scaled_shape(self.size, longer)
        pictures, empty = (
            np.array(parallel_map(lambda each: shrunk(each, shape), some, self.workers), np.uint8)
            for some in (self.pictures, self.empty)
        )
        return replace(self, pictures=pictures, empty=empty)


def scaled_shape(size: tuple[int, int], longer: int) -> tuple[int, int]:
    """Rows and columns of source pictures of `size` (width, height), shrunk to a longer side.

    Pictures that are laid over each other all have the shape that this gives for the *source*: that
    of a picture which is shrunk already can round to another one.
    """
    ratio = min(1.0, longer / max(size))
    return max(2, round(size[1] * ratio)), max(2, round(size[0] * ratio))


def shrunk(picture: Picture, shape: tuple[int, int]) -> Picture:
    """A picture (h, w, 3) of these rows and columns, see `scaled_shape`."""
    if shape == picture.shape[:2]:
        return picture
    return area_resized(picture, (shape[1], shape[0]))


def coarse_picture(picture: Picture) -> Picture:
    """A source picture (h, w, 3) at the coarse size."""
    return shrunk(picture, scaled_shape((picture.shape[1], picture.shape[0]), COARSE_SIDE))


def mask_sized(picture: NDArray[np.generic]) -> Single:
    """(n, n, 3) a picture (h, w, 3) at the size of the mask, FINE_MASK_SIDE."""
    size = FINE_MASK_SIDE, FINE_MASK_SIDE
    small = cv2.resize(np.asarray(picture, np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32)


def luma_at(picture: Single, shape: tuple[int, int]) -> Single:
    """The luma of a picture (h, w, 3) BGR, shrunk to `shape`."""
    small = cv2.resize(picture, shape[::-1], interpolation=cv2.INTER_AREA)
    return to_luma(np.asarray(small, np.float32))


def typical_frame(faces: Sequence[FaceParameters]) -> int:
    """The frame whose pose is nearest to the median of all."""
    poses = np.array([[*f.pose.translation_mm, *f.pose.rotation[1:]] for f in faces])
    away = np.abs(poses - np.median(poses, 0)) / np.maximum(poses.std(0), 1e-6)
    return int(away.sum(1).argmin())


def collect_samples(
    find_matte: FindMatte, frames: FittedFrames, workers: int | None = None
) -> LayerSamples | None:
    """The sample of some frames; None if the canonical one shows no person.

    find_matte: as `PersonSegmenter.matte`, called by several threads.  Frames in which the person
    is not found are left out.  workers: see `LayerSamples`.
    """
    camera = frames.camera
    stride = -(-len(frames.pictures) // MAX_SAMPLES)
    chosen = sorted({frames.canonical, *range(0, len(frames.pictures), stride)})
    mattes = parallel_map(
        lambda i: find_matte(frames.pictures[i], frames.outlines_px[i]), chosen, workers
    )
    found = {i: matte for i, matte in zip(chosen, mattes, strict=True) if matte is not None}
    if frames.canonical not in found:
        return None
    kept = list(found)
    mesh = reference_mesh(frames)
    size = camera.width, camera.height
    shape = scaled_shape(size, PICTURE_SIDE)

    def move(number: int) -> Array:
        return motion_with_head(mesh, frames.person, frames.faces[number])

    return LayerSamples(
        mesh,
        size,
        np.array([shrunk(frames.pictures[i], shape) for i in kept]),
        np.array(list(found.values())),
        tuple(frames.faces[i] for i in kept),
        np.array([frames.outlines_px[i] for i in kept]),
        np.array(parallel_map(move, kept, workers)),
        kept.index(frames.canonical),
        np.array([shrunk(picture, shape) for picture in frames.empty], np.uint8),
        workers,
    )


def positions(samples: LayerSamples, motions: Sequence[Array], shape: tuple[int, int]) -> Single:
    """(n, h, w, 2) where the pixels of the canonical picture are in pictures (h, w) of the frames.

    motions: (rows, columns, 2) source pixels, of the mesh in each frame.
    """

    def place(motion: Array) -> Single:
        return pixel_grid(shape) + dense(motion, samples.size, shape)

    return np.array(parallel_map(place, motions, samples.workers))


def sampled(images: NDArray[Any], at: Single, workers: int | None) -> Single:
    """(n, h', w') or (n, h', w', c) images (n, h, w) or (n, h, w, c) at positions (n, h', w', 2).

    workers: see `parallel_map`.
    """
    values = np.empty((*at.shape[:3], *images.shape[3:]), np.float32)

    def fill(number: int) -> None:
        values[number] = sample(images[number], at[number])

    parallel_map(fill, range(len(images)), workers)
    return values


def reference_mesh(frames: FittedFrames) -> BackgroundMesh:
    """The mesh of the canonical frame, as a decoder makes it."""
    person, reference = frames.person, frames.reference
    vertices = person.animate(reference.eau)
    return make_background_mesh(frames.camera, reference.pose, person.head, vertices)


def motion_with_head(mesh: BackgroundMesh, face: Face, parameters: FaceParameters) -> Array:
    """(rows, columns, 2) source pixels: how the mesh moves with the head in a frame."""
    return warp(mesh, parameters.pose, face.animate(parameters.eau)) - mesh.grid_px


def face_region(outline_px: Array, size: tuple[int, int], shape: tuple[int, int]) -> Mask:
    """(h, w) where a picture of `size` (width, height), shrunk to (h, w), shows the face.

    outline_px: (k, 2) of the face, pixels of the picture of `size`.
    """
    ratio = np.array(shape[::-1]) / np.array(size)
    return hull_mask((outline_px + 0.5) * ratio - 0.5, shape) > 0
