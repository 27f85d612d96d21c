"""What is compared: the AAM of the 3D head and the 2D AAM, trained on the same pictures."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from aam.model import AppearanceModel
from aam.search.find_face import FaceFit, find_in_window
from aam.search.search import SearchOptions
from aam.training.faces import TrainingFace, at_resolution, mirrored_face
from aam.training.train import SIZES, Progress, TrainingOptions, train_levels
from aam.warps import HeadWarp, Warp, head_warp, pose_from_eyes, pose_from_two_points
from benchmarks.validate_aam.planar_warp import (
    PLANAR_LANDMARKS,
    PlanarWarp,
    mean_shape,
    mirrored_planar,
    planar_face,
)
from benchmarks.validate_aam.residual_shape import ResidualFaces, residual_faces
from benchmarks.validate_aam.samples import ANATOMICAL, Sample
from shared_model.arrays import Array

# Nasion and subnasale, the anthropometric vertical axis (2.3.2), among the network's landmarks.
NOSE_LINE = (168, 2)
# By which two points of a face a search's start is brought upright, to its place and to its size.
ANCHORS = ("eyes", "n-sn")


@dataclass(frozen=True, slots=True, eq=False)
class Contender:
    """A trained AAM.

    planar: (68, 2) the mean shape of the 2D AAM; None: the AAM of the 3D head.
    residual: residual modes of the head; None: AE shapes alone.
    """

    levels: tuple[AppearanceModel, ...]
    warps: tuple[Warp, ...]
    options: TrainingOptions
    planar: Array | None
    residual: ResidualFaces | None = None

    def points(self, landmarks: Array, indices: Sequence[int]) -> Array:
        """(n, 2) landmarks of the network among the own ones (m, 2)."""
        if self.planar is not None:
            own: Sequence[int] = PLANAR_LANDMARKS
        else:
            warp = self.warps[-1]
            assert isinstance(warp, HeadWarp)
            own = warp.landmark_index.tolist()
        at = {landmark: number for number, landmark in enumerate(own)}
        return np.asarray(landmarks[[at[index] for index in indices]])

    def prepared(self, samples: Sequence[Sample], level: int) -> list[TrainingFace]:
        """Samples with the shape and pose of this AAM at a level's resolution."""
        if self.residual is not None:
            plain = head_warp(self.warps[level].size, self.options.frame)
            faces = [self.residual.face(sample, plain) for sample in samples]
        elif self.planar is None:
            faces = [sample.face for sample in samples]
        else:
            chosen = list(PLANAR_LANDMARKS)
            faces = [
                planar_face(sample.face, sample.landmarks[chosen], self.planar)
                for sample in samples
            ]
        return at_resolution(faces, self.warps[level].size, self.options.normalisation)


def train_head(
    samples: Sequence[Sample], options: TrainingOptions, progress: Progress = lambda share: None
) -> Contender:
    """The AAM of the 3D head."""
    faces = [sample.face for sample in samples]
    if options.mirror:
        faces += [mirrored_face(face) for face in faces]
    warps = tuple(head_warp(size, options.frame) for size in SIZES[options.size])
    random = np.random.default_rng(options.seed)
    return Contender(train_levels(faces, warps, options, random, progress), warps, options, None)


def train_residual_head(
    samples: Sequence[Sample], options: TrainingOptions, progress: Progress = lambda share: None
) -> Contender:
    """The AAM of the 3D head with modes of what AE shapes leave of the samples' landmarks."""
    sizes = SIZES[options.size]
    plain = head_warp(sizes[-1], options.frame)
    residual = residual_faces(samples, plain)
    faces = [residual.face(sample, plain) for sample in samples]
    if options.mirror:
        faces += [residual.mirrored(sample, plain) for sample in samples]
    warps = tuple(HeadWarp(size, options.frame, residual.modes) for size in sizes)
    random = np.random.default_rng(options.seed)
    levels = train_levels(faces, warps, options, random, progress)
    return Contender(levels, warps, options, None, residual)


def train_planar(
    samples: Sequence[Sample], options: TrainingOptions, progress: Progress = lambda share: None
) -> Contender:
    """The 2D AAM, of the same resolution."""
    pairs = [
        (sample.face, sample.face.window, sample.landmarks[list(PLANAR_LANDMARKS)])
        for sample in samples
    ]
    if options.mirror:
        pairs += [(face, *mirrored_planar(window, points)) for face, window, points in pairs]
    mean = mean_shape([points for _, _, points in pairs])
    faces = [planar_face(replace(face, window=window), at, mean) for face, window, at in pairs]
    warps = tuple(PlanarWarp(size, mean) for size in SIZES[options.size])
    random = np.random.default_rng(options.seed)
    return Contender(train_levels(faces, warps, options, random, progress), warps, options, mean)


def start_pose(
    contender: Contender, sample: Sample, shift: Array, scale: float, anchors: str = "eyes"
) -> Array:
    """The pose of a search's start: the mean shape at two points of the face, moved and scaled.

    shift: (2,) in terms of the distance between the eyes.  anchors: one of `ANCHORS`.
    """
    eyes, warp, mean = sample.eyes, contender.warps[0], contender.levels[0].shape.mean
    points = eyes if anchors == "eyes" else sample.landmarks[list(NOSE_LINE)]
    moved = points + shift * float(np.linalg.norm(eyes[1] - eyes[0]))
    target = moved.mean(0) + scale * (moved - moved.mean(0))
    if anchors == "eyes":
        return pose_from_eyes(warp, mean, target)
    own = contender.points(warp.landmarks(mean, warp.upright(0.0, np.zeros(3))), NOSE_LINE)
    return pose_from_two_points(warp, own, target)


def found_points(
    contender: Contender, sample: Sample, pose: Array, options: SearchOptions
) -> Array:
    """(68, 2) the landmarks `PLANAR_LANDMARKS` that a search finds, pixels of the window."""
    fit = find_from(contender, sample, pose, options)
    return contender.points(fit.landmarks, PLANAR_LANDMARKS)


def find_from(contender: Contender, sample: Sample, pose: Array, options: SearchOptions) -> FaceFit:
    """A search in a sample's window that starts at a pose (p,)."""
    return find_in_window(
        contender.levels,
        contender.warps,
        contender.options.normalisation,
        sample.face.window,
        [pose],
        options,
    )


def errors(sample: Sample, points: Array) -> tuple[float, float]:
    """Eq. 3.1 over the anatomical landmarks, in square pixels of a face whose outer corners of the
    eyes are 100 px apart; mean distance of all 68 in terms of the distance of these corners.
    """
    truth = sample.landmarks[list(PLANAR_LANDMARKS)]
    distance = np.linalg.norm(points - truth, axis=1) / sample.eye_distance
    chosen = [PLANAR_LANDMARKS.index(index) for index in ANATOMICAL]
    return float(((100 * distance[chosen]) ** 2).mean()), float(distance.mean())
