"""An annotated picture and its two files: arrays in NAME.npz, values by their names in NAME.json.

Both are open formats and need no code of this project: see docs/aam.md.  The pair holds all that
training needs, the picture's window included, so that the picture itself may go.
"""

import json
import os
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from aam.shape_space import SHAPE_NAMES
from aam.weak_pose import POSE_NAMES, euler_angles_deg
from aam.window import FaceWindow
from shared_model.arrays import Array, Picture
from shared_model.errors import UserError, cannot_read, cannot_write

FORMAT, VERSION = "risorius-annotation", 1
_ARRAYS = (
    "pose",
    "shape",
    "control_mm",
    "texture",
    "landmarks",
    "window",
    "window_corner",
    "window_ratio",
)


@dataclass(frozen=True, slots=True)
class Annotation:
    """The 3D model in one picture.

    name: of the files.  person: who is shown.  image: path of the picture as it was given.
    image_sha256: of the picture's file.  options: what the fit was told, as one string.
    projection: "weak" or "perspective".  focal_px: of the picture's camera.
    error: see `StillFit.error`.
    pose: (6,) of weak perspective, pixels of the picture, see `aam.weak_pose`.
    shape: (25,) AE shape vector in [-1, 1].  control_mm: (k, 3) residual shape.
    texture: (s, s, 3) uint8 BGR, shape-free.  landmarks: (468, 3) pixels, nan where unknown.
    window: of the picture, see `aam.window`.
    correction: what a hand has set, see `aam.annotation.correction`; empty: nothing.
    """

    name: str
    person: str
    image: str
    image_sha256: str
    options: str
    projection: str
    focal_px: float
    error: float
    pose: Array
    shape: Array
    control_mm: Array
    texture: Picture
    landmarks: Array
    window: FaceWindow
    correction: Mapping[str, Any] = field(default_factory=dict)


def write_annotation(folder: Path, annotation: Annotation) -> None:
    """Write both files; the JSON file last, so that it is there only when both are whole.

    Raises `UserError`.
    """
    arrays: dict[str, Any] = {
        "pose": annotation.pose,
        "shape": annotation.shape,
        "control_mm": annotation.control_mm,
        "texture": annotation.texture,
        "landmarks": annotation.landmarks.astype(np.float32),
        "window": annotation.window.picture,
        "window_corner": annotation.window.corner,
        "window_ratio": np.array(annotation.window.ratio),
    }
    text = json.dumps(_as_json(annotation), indent=1) + "\n"
    parts = [folder / f"{annotation.name}{suffix}.part" for suffix in (".npz", ".json")]
    try:
        with parts[0].open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)
        parts[1].write_text(text, encoding="utf-8")
        for part in parts:
            os.replace(part, part.with_suffix(""))
    except OSError as error:
        raise cannot_write(folder / annotation.name, error) from error


def read_annotation(json_path: Path) -> Annotation:
    """Read an annotation by the path of its JSON file.  Raises `UserError`."""
    values = read_header(json_path)
    arrays = _read_arrays(json_path.with_suffix(".npz"))
    try:
        return _annotation(json_path.stem, values, arrays)
    except (KeyError, TypeError, ValueError) as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise UserError(f"{json_path}: {reason}; annotate the picture again") from error


def _annotation(name: str, values: dict[str, Any], arrays: dict[str, Any]) -> Annotation:
    window = FaceWindow(arrays["window"], arrays["window_corner"], float(arrays["window_ratio"]))
    return Annotation(
        name,
        str(values["person"]),
        str(values["image"]),
        str(values["image_sha256"]),
        str(values["options"]),
        str(values["projection"]),
        float(values["focal_px"]),
        float(values["error"]),
        arrays["pose"].astype(np.float64),
        arrays["shape"].astype(np.float64),
        arrays["control_mm"].astype(np.float64),
        arrays["texture"],
        arrays["landmarks"].astype(np.float64),
        window,
        dict(values.get("correction", {})),
    )


def read_header(json_path: Path) -> dict[str, Any]:
    """The values of a JSON file of an annotation.  Raises `UserError`."""
    try:
        values = json.loads(json_path.read_text(encoding="utf-8"))
    except OSError as error:
        raise cannot_read(json_path, error) from error
    except ValueError as error:
        raise UserError(f"{json_path} is not JSON: {error}") from error
    if not isinstance(values, dict) or values.get("format") != FORMAT:
        raise UserError(f"{json_path} is no annotation; make one by: risorius annotate")
    if values.get("version") != VERSION:
        raise UserError(f"{json_path} has version {values.get('version')}, expected {VERSION}")
    return values


def read_annotations(folder: Path) -> list[Annotation]:
    """All annotations of a folder, by name.  Raises `UserError` if there is none."""
    paths = sorted(folder.glob("*.json"))
    if not paths:
        raise UserError(f"{folder} holds no annotations; make some by: risorius annotate")
    return [read_annotation(path) for path in paths]


def _read_arrays(path: Path) -> dict[str, Any]:
    try:
        with np.load(path, allow_pickle=False) as data:
            missing = [name for name in _ARRAYS if name not in data.files]
            if missing:
                raise UserError(f"{path} lacks {', '.join(missing)}")
            return {name: data[name] for name in _ARRAYS}
    except OSError as error:
        raise cannot_read(path, error) from error
    except (ValueError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise UserError(f"{path} is damaged: {error}; annotate the picture again") from error


def _as_json(annotation: Annotation) -> dict[str, Any]:
    pitch, yaw, roll = euler_angles_deg(annotation.pose)
    return {
        "format": FORMAT,
        "version": VERSION,
        "person": annotation.person,
        "image": annotation.image,
        "image_sha256": annotation.image_sha256,
        "options": annotation.options,
        "projection": annotation.projection,
        "focal_px": annotation.focal_px,
        "error": annotation.error,
        "pose": {
            **dict(zip(POSE_NAMES, annotation.pose.tolist(), strict=True)),
            **{"pitch_deg": pitch, "yaw_deg": yaw, "roll_deg": roll},
        },
        "shape": dict(zip(SHAPE_NAMES, annotation.shape.tolist(), strict=True)),
        **({"correction": dict(annotation.correction)} if annotation.correction else {}),
    }
