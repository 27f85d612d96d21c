"""Measured poses of a recording: files of BU, BIWI, and of `risorius animate` (thesis 5.3.3).

BU (La Cascia, Sclaroff and Athitsos 2000): `NAME.dat`, a line for each frame after a first one,
of the sensor at rest: number, place (inches), roll, yaw and pitch in degrees; pitch > 0 looks down.
BIWI (Fanelli et al. 2013): `frame_00003_pose.txt` for each frame, the rotation matrix from the
axes of a head that looks into the camera, x to the right, y down, z away, and its place in mm.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from risorius.track_bench.truth_files import files_below, matching_key
from shared_model.arrays import Array
from shared_model.errors import UserError
from shared_model.geometry import (
    FRONTAL,
    matrix_from_quaternion,
    pose_from_euler,
    quaternion_from_matrix,
)
from shared_model.parameters import EAUS

BIWI_ENDING = "_pose.txt"


@dataclass(frozen=True, slots=True, eq=False)
class PoseTruth:
    """kind: "BU", "BIWI" or "animation".

    rotation: (t, 4) `camera_from_head` of each frame, a unit quaternion (`geometry.py`).
    eau: (t, len(EAUS)) of an animation; None: not known.
    """

    kind: str
    rotation: Array
    eau: Array | None = None


def find_pose_truth(place: Path, source: str) -> PoseTruth:
    """The poses of a source, by its name, in a folder or file.

    Raises `UserError` if there are none, or if a file of them cannot be read.
    """
    known: dict[str, tuple[Callable[[Sequence[Path]], PoseTruth], list[Path]]] = {}
    for path in files_below(place, "*.json"):
        known[path.stem] = (read_animation, [path])
    for path in files_below(place, f"*{BIWI_ENDING}"):
        known.setdefault(path.parent.name, (read_biwi, []))[1].append(path)
    for path in files_below(place, "*.dat"):
        known[path.stem] = (read_bu, [path])
    key = next(iter(known), None) if place.is_file() else matching_key(source, known)
    if key is None:
        raise UserError(f"{place}: no poses of {source}: neither .dat, _pose.txt nor .json")
    read, paths = known[key]
    return read(paths)


def read_bu(paths: Sequence[Path]) -> PoseTruth:
    """The poses of one `.dat` file.  Raises `UserError`."""
    values = _numbers(paths[0])
    if values.ndim != 2 or values.shape[1] < 7 or len(values) < 2:
        raise UserError(f"{paths[0]}: expected a line of seven numbers for each frame, as BU has")
    roll, yaw, pitch = values[1:, 4:7].T
    angles = zip(-pitch, yaw, roll, strict=True)
    return PoseTruth("BU", np.array([pose_from_euler(*a, np.zeros(3)).rotation for a in angles]))


def read_biwi(paths: Sequence[Path]) -> PoseTruth:
    """The poses of `_pose.txt` files, one for each frame in their order.  Raises `UserError`."""
    rotations = []
    frontal = matrix_from_quaternion(np.array(FRONTAL))
    for path in paths:
        values = _numbers(path).ravel()
        if len(values) < 9:
            raise UserError(f"{path}: expected a matrix of 3 x 3 numbers, as BIWI has")
        rotations.append(quaternion_from_matrix(values[:9].reshape(3, 3) @ frontal))
    return PoseTruth("BIWI", np.array(rotations))


def read_animation(paths: Sequence[Path]) -> PoseTruth:
    """The truth of an animation (docs/animate.md).  Raises `UserError`."""
    try:
        frames = json.loads(paths[0].read_text(encoding="utf-8"))["frames"]
        rotation = np.array([frame["rotation"] for frame in frames], dtype=np.float64)
        eau = np.array([frame["eau"] for frame in frames], dtype=np.float64)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{paths[0]}: not the truth of an animation: {error}") from error
    return PoseTruth("animation", rotation.reshape(-1, 4), eau.reshape(-1, len(EAUS)))


def _numbers(path: Path) -> Array:
    try:
        return np.array(np.loadtxt(path, ndmin=2), dtype=np.float64)
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: not a file of numbers: {error}") from error
