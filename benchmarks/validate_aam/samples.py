"""Annotated faces with the landmarks that found points are compared with."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aam.annotation.annotation_file import read_annotations
from aam.training.faces import AnnotatedFace
from shared_model.arrays import Array
from shared_model.parameters import AAUS

# Landmarks of the network that are anatomical, not interpolated (3.1): corners of the eyes, ends of
# the brows, nasion, tip, wings and base of the nose, corners and middle of the lips, chin.
ANATOMICAL = (
    *(33, 133, 362, 263, 70, 107, 336, 300),
    *(168, 4, 98, 327, 2, 61, 291, 0, 17, 152),
)


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """An annotated face and its landmarks, (468, 2) pixels of its window."""

    face: AnnotatedFace
    landmarks: Array

    @property
    def eyes(self) -> Array:
        """(2, 2) middle between the corners of the right and of the left eye, pixels."""
        return np.asarray(self.landmarks[[33, 133, 362, 263]].reshape(2, 2, 2).mean(1))

    @property
    def eye_distance(self) -> float:
        """Between the outer corners of the eyes, pixels."""
        return float(np.linalg.norm(self.landmarks[33] - self.landmarks[263]))

    @property
    def eau(self) -> Array:
        """(14,) the expression part of the shape vector."""
        return self.face.shape[len(AAUS) :]


def read_samples(folders: Sequence[Path]) -> list[Sample]:
    """All annotated faces of some folders; a person counts as one within a folder alone.

    Raises `UserError`.
    """
    found = []
    for folder in folders:
        for each in read_annotations(folder):
            window, person = each.window, f"{folder.name}/{each.person}"
            pose = window.pose_to_window(each.pose)
            face = AnnotatedFace(f"{folder.name}/{each.name}", person, window, each.shape, pose)
            found.append(Sample(face, window.to_window(each.landmarks[:, :2])))
    return found


def split_people(samples: Sequence[Sample], parts: int) -> list[list[Sample]]:
    """The samples in parts none of which shares a person with another."""
    people = sorted({sample.face.person for sample in samples})
    number = {person: index % parts for index, person in enumerate(people)}
    return [
        [sample for sample in samples if number[sample.face.person] == part]
        for part in range(parts)
    ]
