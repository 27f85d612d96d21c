"""What the page of annotations shows: the picture, the model on it, its texture, every value."""

import hashlib
from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from aam.annotation.annotation_file import Annotation, read_annotation, read_header
from aam.annotation.correction import WEIGHTS, Correction, correct, correction_from, fit_of
from aam.annotation.originals import read_original, save_corrected
from aam.annotation.still_texture import fitted_vertices
from aam.shape_space import HIGH, LOW, SHAPE_NAMES
from aam.weak_pose import euler_angles_deg, pose_vector, project
from aam.window import FACE_CENTRE_MM, WINDOW_MM, FaceWindow, window_around
from encoder.fitting.landmark_fit import landmark_model
from risorius.view.annotation_residual import Residual
from runtime.image_ops import jpeg
from shared_model.arrays import Array, Integers, Picture
from shared_model.errors import UserError, cannot_read
from shared_model.geometry import Camera, pixel_from_head, pose_from_euler
from shared_model.mesh import PARTS, generic_head
from shared_model.parameters import AAUS, EAUS

# What of a picture the page shows: this many windows, within these sides, pixels.
MARGIN, LEAST_PX, MOST_PX = 1.1, 480, 960
JPEG_QUALITY = 92
ANGLES = ("pitch_deg", "yaw_deg", "roll_deg")


@dataclass(frozen=True, slots=True, eq=False)
class OpenAnnotation:
    """An annotation while it is corrected.

    original: without a hand.  present: as it stands in its files.  picture: (h, w, 3) uint8 BGR.
    view: what of the picture is shown.
    """

    original: Annotation
    present: Annotation
    picture: Picture
    view: FaceWindow

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the picture."""
        return self.picture.shape[1], self.picture.shape[0]

    def corrected(self, values: Mapping[str, Any]) -> Annotation:
        """The annotation with what the page has set.

        values: as of `correction_values`, but the pose as of `shown`.  Raises `ValueError`.
        """
        pose = values.get("pose")
        turned = dict(values) | {"pose": None if pose is None else _vector(pose)}
        return correct(self.original, self.picture, correction_from(turned, self.size))


class AnnotationFolder:
    """The annotations that a page shows, in files.  Raises `UserError`.

    path: a folder, or the JSON file of one annotation.  pictures: a folder to look for pictures
    that are not where they were.
    """

    def __init__(self, path: Path, pictures: Path | None = None) -> None:
        chosen = [path] if path.is_file() else sorted(path.glob("*.json"))
        if not chosen:
            raise UserError(f"{path} holds no annotations; make some by: risorius annotate")
        self.path, self._pictures = chosen[0].parent, pictures
        errors = {each.stem: _error(each) for each in chosen}
        self.names = sorted(errors, key=lambda name: -errors[name])

    def errors(self) -> dict[str, float]:
        """Each annotation's error (see `StillFit.error`) by its name, the worst first."""
        return {name: _error(self.path / f"{name}.json") for name in self.names}

    def open(self, name: str) -> OpenAnnotation:
        """Raises `ValueError` for a name that is none of these, `UserError`."""
        if name not in self.names:
            raise ValueError(f"no annotation is called {name!r}")
        original = read_original(self.path, name)
        picture = _read_picture(original, self._pictures)
        present = read_annotation(self.path / f"{name}.json")
        return OpenAnnotation(original, present, picture, _view(picture, original.pose))

    def save(self, opened: OpenAnnotation, corrected: Annotation) -> None:
        """Write a correction; the fit without a hand is kept beside.  Raises `UserError`."""
        save_corrected(self.path, opened.original, corrected)


def description(folder: AnnotationFolder, compared: str) -> dict[str, Any]:
    """What holds for every annotation of the page: names, sliders, triangles of the face."""
    controls = [
        {"name": name, "region": region, "low": float(low), "high": float(high), "au": au}
        for name, region, low, high, au in zip(
            SHAPE_NAMES,
            ["Anthropometry"] * len(AAUS) + [eau.region for eau in EAUS],
            LOW,
            HIGH,
            [""] * len(AAUS) + [eau.au for eau in EAUS],
            strict=True,
        )
    ]
    return {
        "annotations": folder.errors(),
        "compared": compared,
        "controls": controls,
        "weights": WEIGHTS,
        "triangles": face_triangles()[1].ravel().tolist(),
    }


def shown(opened: OpenAnnotation, annotation: Annotation, residual: Residual) -> dict[str, Any]:
    """All that the page shows of an annotation, places in pixels of the picture.

    Poses have angles in place of the rotation vector.
    """
    fitted = fit_of(annotation, opened.size)
    vertices = pixel_from_head(fitted.camera, fitted.face.pose, fitted_vertices(fitted))
    head = generic_head()
    index = landmark_model(head).index
    corners = vertices[head.triangles[head.network_triangles[index]]]
    model = np.einsum("mc,mcd->md", head.network_weights[index], corners)
    known = np.flatnonzero(np.isfinite(annotation.landmarks[:, 0]))
    set_by_hand = correction_from(annotation.correction, opened.size)
    left = residual.of(annotation)
    return {
        "name": annotation.name,
        "person": annotation.person,
        "image": annotation.image,
        "projection": annotation.projection,
        "error": annotation.error,
        "corner": opened.view.corner.tolist(),
        "ratio": opened.view.ratio,
        "side": len(opened.view.picture),
        "correction": _correction(set_by_hand),
        "pose": _angles(annotation.pose),
        "shape": dict(zip(SHAPE_NAMES, annotation.shape.tolist(), strict=True)),
        "landmarks": _points(known, annotation.landmarks[known, :2]),
        "model": _points(index, model),
        "vertices": np.round(vertices[face_triangles()[0]], 2).ravel().tolist(),
        "texture": _data_url(annotation.texture),
        "residual": None if left is None else _data_url(left[0]),
        "unexplained": None if left is None else left[1],
    }


@cache
def face_triangles() -> tuple[Integers, Integers]:
    """Vertices (v,) of the generic head that are drawn, and triangles (t, 3) of these."""
    head = generic_head()
    parts = [PARTS.index(name) for name in ("skin", "eye_left", "eye_right")]
    chosen = np.isin(head.parts, parts) & (head.opacity > 0.5)
    triangles = head.triangles[chosen[head.triangles].all(1)]
    vertices, numbers = np.unique(triangles, return_inverse=True)
    return vertices.astype(np.int64), numbers.reshape(-1, 3).astype(np.int64)


def _error(path: Path) -> float:
    value = read_header(path).get("error")
    if not isinstance(value, int | float):
        raise UserError(f"{path}: error is missing; annotate the picture again")
    return float(value)


def _read_picture(annotation: Annotation, folder: Path | None) -> Picture:
    """The picture of an annotation, where it was or below the folder.  Raises `UserError`."""
    path = Path(annotation.image)
    parts = [part for part in path.parts if part != path.anchor]
    below = [folder.joinpath(*parts[-n:]) for n in range(1, len(parts) + 1)] if folder else []
    for place in (path, *below):
        if not place.is_file():
            continue
        try:
            data = place.read_bytes()
        except OSError as error:
            raise cannot_read(place, error) from error
        if hashlib.sha256(data).hexdigest() == annotation.image_sha256:
            picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
            if picture is not None:
                return np.asarray(picture, np.uint8)
    where = "name its folder by --pictures" if folder is None else f"nor is it in {folder}"
    raise UserError(f"{path} is not there as it was when {annotation.name} was annotated; {where}")


def _view(picture: Picture, pose: Array) -> FaceWindow:
    side = float(np.exp(pose[5]) * WINDOW_MM * MARGIN)
    size = int(np.clip(round(side), LEAST_PX, MOST_PX))
    return window_around(picture, project(pose, FACE_CENTRE_MM[None])[0], side, size)


def _correction(correction: Correction) -> dict[str, Any]:
    pose = None if correction.pose is None else _angles(np.array(correction.pose))
    landmarks = {str(index): list(at) for index, at in correction.landmarks.items()}
    return {
        "landmarks": landmarks,
        "shape": dict(correction.shape),
        "pose": pose,
        "weight": correction.weight,
    }


def _angles(pose: Array) -> dict[str, float]:
    angles = dict(zip(ANGLES, euler_angles_deg(pose), strict=True))
    return angles | {"tx": float(pose[3]), "ty": float(pose[4]), "scale": float(pose[5])}


def _vector(pose: Any) -> list[float]:
    """(6,) weak-perspective vector of what `_angles` says.  Raises `ValueError`."""
    try:
        pitch, yaw, roll = (float(pose[name]) for name in ANGLES)
        place = [float(pose[name]) for name in ("tx", "ty", "scale")]
    except (KeyError, TypeError) as error:
        expected = f"{', '.join(ANGLES)}, tx, ty, scale"
        raise ValueError(f"pose is {pose!r}, expected {expected}") from error
    turned = pose_from_euler(pitch, yaw, roll, np.array([0.0, 0.0, 1.0]))
    return [*pose_vector(turned, Camera(1, 1, 1.0))[:3].tolist(), *place]


def _points(index: NDArray[Any], points: Array) -> list[list[float]]:
    rows = zip(index.tolist(), np.round(points, 2).tolist(), strict=True)
    return [[number, *at] for number, at in rows]


def _data_url(picture: Picture) -> str:
    return f"data:image/jpeg;base64,{b64encode(jpeg(picture, JPEG_QUALITY)).decode()}"
