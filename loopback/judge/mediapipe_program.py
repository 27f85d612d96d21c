"""What the judge's environment runs: MediaPipe looks at raw frames; nothing else of the project.

    mediapipe_program.py landmarks|people WIDTH HEIGHT < BGR frames > .npy

landmarks: (n, 478, 3) float32 pixels, nan where no face is found.
people: (n, h, w) bool, where a person is.
"""

import os
import sys
from collections.abc import Iterator
from io import BytesIO
from types import ModuleType
from typing import Any, BinaryIO

# MediaPipe draws with it, which nobody asks for; to import it takes longer than all the rest.
sys.modules["matplotlib"] = sys.modules["matplotlib.pyplot"] = ModuleType("matplotlib")

import cv2  # noqa: E402
import mediapipe  # noqa: E402
import numpy as np  # noqa: E402

# Frames of fewer rows are enlarged: the network that finds faces misses small ones.
LEAST_ROWS = 480
POINTS = 478
MIN_DETECTION = 0.3
PERSON = 0.5

Frame = np.ndarray[Any, np.dtype[np.uint8]]


def read_frames(stream: BinaryIO, width: int, height: int) -> Iterator[Frame]:
    """Frames (h, w, 3) until the stream ends."""
    while len(data := stream.read(width * height * 3)) == width * height * 3:
        yield np.frombuffer(data, np.uint8).reshape(height, width, 3)


def landmarks(frames: Iterator[Frame]) -> Any:
    """See above."""
    mesh = mediapipe.solutions.face_mesh.FaceMesh(
        max_num_faces=1, refine_landmarks=True, min_detection_confidence=MIN_DETECTION
    )
    found = []
    for frame in frames:
        height, width = frame.shape[:2]
        zoom = max(1, round(LEAST_ROWS / height))
        large = cv2.resize(frame, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_CUBIC)
        faces = mesh.process(cv2.cvtColor(large, cv2.COLOR_BGR2RGB)).multi_face_landmarks
        points = np.full((POINTS, 3), np.nan, np.float32)
        if faces:
            points[:] = [(p.x * width, p.y * height, p.z * width) for p in faces[0].landmark]
        found.append(points)
    return np.array(found, np.float32).reshape(-1, POINTS, 3)


def people(frames: Iterator[Frame]) -> Any:
    """See above."""
    segment = mediapipe.solutions.selfie_segmentation.SelfieSegmentation(model_selection=0)
    masks = [
        segment.process(cv2.cvtColor(frame, cv2.COLOR_BGR2RGB)).segmentation_mask > PERSON
        for frame in frames
    ]
    return np.array(masks, bool)


def main() -> None:
    task, width, height = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    # MediaPipe writes its own lines to either stream.
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    frames = read_frames(sys.stdin.buffer, width, height)
    found = BytesIO()
    np.save(found, landmarks(frames) if task == "landmarks" else people(frames))
    with output:
        output.write(found.getvalue())


if __name__ == "__main__":
    main()
