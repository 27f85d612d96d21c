"""First frames: the share of single pictures of new people in which a face is fitted right.

Three ways to find it: the landmark network, the network weighted against a search of the AAM that
starts where it ends, and the AAM from the eyes that Viola-Jones finds, without any network.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from aam.annotation.annotation_file import read_annotations
from aam.annotation.landmark_schemes import IBUG_68, from_search
from aam.annotation.landmark_search import ModelLandmarks, StillLandmarks
from aam.annotation.still_fit import fit_still
from aam.model import MultiResolutionModel
from benchmarks.validate_aam.weighted_search import weighted_landmarks
from encoder.detection.landmark_indices import FACE_OVAL, LANDMARK_COUNT, OUTER_EYE_CORNERS
from runtime.parallel import parallel_map
from shared_model.arrays import Array, Picture
from shared_model.errors import UserError
from shared_model.mesh import generic_head

RIGHT_NME = 0.05
# Landmarks (468, 2 or 3) of each picture, pixels; None: no face.
Found = Sequence[Array | None]
WAYS = ("network", "network + AAM", "Viola-Jones + AAM")


@dataclass(frozen=True, slots=True, eq=False)
class TruePicture:
    """A picture and the known place of its face.

    folder: of its annotation, by name.  person: who is shown.
    landmarks: (468, 2) pixels, nan where unknown, and on the outline of the face, along which a
        landmark's place is not defined.
    """

    folder: str
    person: str
    picture: Picture
    landmarks: Array


@dataclass(frozen=True, slots=True, eq=False)
class FirstFrames:
    """nme: mean distance of the known landmarks in terms of the outer corners of the eyes, of each
    picture; infinite where no face was found.
    nme_shifted: the same where all truth is moved by one shift, pixels, the median of what the
        network finds: what is left where the truth's pixels are counted from elsewhere.
    nme_offset: the same where each landmark of the truth is moved by what the network finds in the
        mean of other people, see `landmark_offsets`: what is left where the truth means other
        points by the same names.
    """

    nme: Array
    nme_shifted: Array
    nme_offset: Array

    @property
    def found(self) -> float:
        """Share of the pictures in which a face was found."""
        return float(np.isfinite(self.nme).mean())

    @property
    def right(self) -> float:
        """Share of the pictures whose mean distance is below 5 %."""
        return float((self.nme < RIGHT_NME).mean())

    @property
    def right_shifted(self) -> float:
        """The same with the truth moved, see above."""
        return float((self.nme_shifted < RIGHT_NME).mean())

    @property
    def right_offset(self) -> float:
        """The same with each landmark of the truth moved, see above."""
        return float((self.nme_offset < RIGHT_NME).mean())


def read_true_pictures(folders: Sequence[Path]) -> list[TruePicture]:
    """The pictures of annotations by given landmarks; of more than 73 these of iBUG's scheme count.

    Raises `UserError`.
    """
    found = []
    for folder in folders:
        for each in read_annotations(folder):
            picture = cv2.imread(each.image, cv2.IMREAD_COLOR)
            if picture is None:
                raise UserError(f"cannot read {each.image}, the picture of {folder}/{each.name}")
            landmarks = each.landmarks[:, :2].copy()
            if np.isfinite(landmarks[:, 0]).sum() > 2 * len(IBUG_68):
                landmarks[np.setdiff1d(np.arange(len(landmarks)), IBUG_68)] = np.nan
            landmarks[list(FACE_OVAL)] = np.nan
            person = f"{folder.name}/{each.person}"
            found.append(TruePicture(folder.name, person, np.asarray(picture, np.uint8), landmarks))
    return found


def find_first_frames(
    model: MultiResolutionModel, pictures: Sequence[TruePicture]
) -> dict[str, Found]:
    """The landmarks by each of `WAYS`.  Raises `UserError` if the networks are not installed."""
    network, without = StillLandmarks(), ModelLandmarks(model)
    points = [network.find(each.picture) for each in pictures]

    def searched(number: int) -> Array | None:
        found, picture = points[number], pictures[number].picture
        if found is None:
            return None
        size = picture.shape[1], picture.shape[0]
        fit = fit_still(generic_head(), size, from_search(found))
        return weighted_landmarks(model, picture, found, fit.pose, fit.shape)

    return {
        WAYS[0]: points,
        WAYS[1]: parallel_map(searched, range(len(pictures)), None),
        WAYS[2]: [without.find(each.picture) for each in pictures],
    }


def judged_frames(
    found: Mapping[str, Found], pictures: Sequence[TruePicture], offsets: Array
) -> dict[str, FirstFrames]:
    """What `find_first_frames` found against the truth.

    offsets: (468, 2) of other people, see `landmark_offsets`.
    """
    shift, along = common_shift(found[WAYS[0]], pictures), [_eye_line(each) for each in pictures]
    moves = (
        [np.zeros(2)] * len(pictures),
        [shift] * len(pictures),
        [offsets @ line for line in along],
    )
    return {
        way: FirstFrames(*(_distances(points, pictures, each) for each in moves))
        for way, points in found.items()
    }


def landmark_offsets(found: Found, pictures: Sequence[TruePicture]) -> Array:
    """(468, 2) mean of found less true place of each landmark, along the line of the eyes and
    across it, in terms of the outer corners' distance; 0 where the truth has no landmark.
    """
    moved = [
        (a[:, :2] - b.landmarks) @ np.linalg.inv(_eye_line(b))
        for a, b in zip(found, pictures, strict=True)
        if a is not None
    ]
    if not moved:
        return np.zeros((LANDMARK_COUNT, 2))
    known = np.isfinite(moved)
    return np.asarray(np.nan_to_num(moved).sum(0) / np.maximum(known.sum(0), 1))


def common_shift(found: Found, pictures: Sequence[TruePicture]) -> Array:
    """(2,) median of found less true landmarks over all pictures, pixels."""
    shifts = [a[:, :2] - b.landmarks for a, b in zip(found, pictures, strict=True) if a is not None]
    return np.asarray(np.nanmedian(np.concatenate(shifts), axis=0)) if shifts else np.zeros(2)


def _distances(found: Found, pictures: Sequence[TruePicture], moves: Sequence[Array]) -> Array:
    """(n,) `FirstFrames.nme` with the truth moved, each picture's by (2,) or (468, 2), pixels."""
    triples = zip(found, pictures, moves, strict=True)
    return np.array([_nme(a, replace(b, landmarks=b.landmarks + c)) for a, b, c in triples])


def _eye_line(picture: TruePicture) -> Array:
    """(2, 2) rows: from the outer corner of one eye to that of the other, pixels, and across."""
    right, left = (picture.landmarks[index] for index in OUTER_EYE_CORNERS)
    x, y = left - right
    return np.array([[x, y], [-y, x]])


def _nme(found: Array | None, picture: TruePicture) -> float:
    if found is None:
        return float("inf")
    right, left = (picture.landmarks[index] for index in OUTER_EYE_CORNERS)
    both = np.isfinite(found[:, 0]) & np.isfinite(picture.landmarks[:, 0])
    distance = np.linalg.norm(found[both, :2] - picture.landmarks[both], axis=1)
    return float(distance.mean() / np.linalg.norm(left - right))
