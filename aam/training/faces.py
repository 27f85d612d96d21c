"""The faces that a model is trained on, from annotations and their mirror images."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aam import shape_space, weak_pose
from aam.annotation.annotation_file import read_annotations
from aam.sampling import normalised_luma, window_px
from aam.window import FaceWindow, shrunk
from runtime.parallel import parallel_map
from shared_model.arrays import Array, Mask, Single


@dataclass(frozen=True, slots=True, eq=False)
class AnnotatedFace:
    """A face whose parameters are known.

    person: who it is.  shape: (n,).  pose: (p,) in pixels of the window.
    """

    name: str
    person: str
    window: FaceWindow
    shape: Array
    pose: Array


@dataclass(frozen=True, slots=True, eq=False)
class TrainingFace:
    """An annotated face at the resolution of one level.

    luma: (side, side) normalised window.  shape: (n,).  pose: (p,) in pixels of it.
    """

    person: str
    luma: Single
    shape: Array
    pose: Array


def read_faces(folders: Sequence[Path]) -> list[AnnotatedFace]:
    """All faces of folders that `annotate` wrote.  Raises `UserError`."""
    found = []
    for folder in folders:
        for each in read_annotations(folder):
            pose = each.window.pose_to_window(each.pose)
            found.append(AnnotatedFace(each.name, each.person, each.window, each.shape, pose))
    return found


def mirrored_face(face: AnnotatedFace) -> AnnotatedFace:
    """The mirror image of a face, of the 3D head, as the same person."""
    window = face.window
    picture = np.ascontiguousarray(window.picture[:, ::-1])
    return AnnotatedFace(
        f"{face.name} mirrored",
        face.person,
        FaceWindow(picture, window.corner, window.ratio),
        shape_space.mirrored(face.shape),
        weak_pose.mirrored(face.pose, picture.shape[1]),
    )


def at_resolution(
    faces: Sequence[AnnotatedFace], size: int, normalisation: str
) -> list[TrainingFace]:
    """The faces for textures of `size` texels a side.  normalisation: see `normalised_luma`."""

    def prepare(face: AnnotatedFace) -> TrainingFace:
        window = shrunk(face.window, window_px(size))
        pose = rescaled(face.pose, len(window.picture) / len(face.window.picture))
        luma = normalised_luma(window, normalisation)
        return TrainingFace(face.person, luma, face.shape, pose)

    return parallel_map(prepare, faces, None)


def rescaled(pose: Array, ratio: float) -> Array:
    """A pose (..., p) in pixels of the same picture whose sides are `ratio` times as long."""
    moved = np.array(pose)
    moved[..., -3:-1] = (moved[..., -3:-1] + 0.5) * ratio - 0.5
    moved[..., -1] += np.log(ratio)
    return moved


def second_half(faces: Sequence[TrainingFace]) -> Mask:
    """(faces,) whether the person is in the second half of the people."""
    people = sorted({face.person for face in faces})
    half = {person: number % 2 == 1 for number, person in enumerate(people)}
    return np.array([half[face.person] for face in faces])
