"""Milliseconds a frame of the encoder's measurements on a clip, and how calm they are.

    python scripts/measure_tracking.py SOURCE [--frames 100]

Prints medians and minima for detection, face mesh, irises, KLT and filter, each by itself, and the
root mean square second difference of pitch, yaw and roll from the landmarks alone and from the
filter.
"""

import argparse
import time
from collections import defaultdict
from collections.abc import Callable
from functools import partial
from itertools import islice
from typing import TypeVar

import numpy as np

from encoder.capture import open_source
from encoder.detect import BlazeFaceDetector
from encoder.ekf import FaceFilter
from encoder.fit import fit_frame, fit_identity, landmark_model, personalise
from encoder.iris import IrisFinder
from encoder.klt import KltTracker
from encoder.landmarks import LandmarkTracker
from encoder.networks import find_network_folder
from shared_model.animate import Face
from shared_model.geometry import euler_deg
from shared_model.mesh import generic_head
from shared_model.parameters import FaceParameters

T = TypeVar("T")
LANDMARKS_USED = 12  # every so many of the landmarks goes into the filter
LANDMARK_SIGMA = 0.015  # of the distance between the eyes; their errors move together


class Stopwatch:
    """Milliseconds of each call, by name."""

    def __init__(self) -> None:
        self.ms: dict[str, list[float]] = defaultdict(list)

    def time(self, name: str, call: Callable[[], T]) -> T:
        start = time.perf_counter()
        result = call()
        self.ms[name].append(1000 * (time.perf_counter() - start))
        return result


def calmness(angles: list[tuple[float, float, float]]) -> str:
    rms = np.sqrt(np.mean(np.diff(angles, 2, axis=0) ** 2, axis=0))
    return " ".join(f"{value:.2f}" for value in rms)


def measure(source: str, count: int) -> None:
    folder, head, watch = find_network_folder(), generic_head(), Stopwatch()
    detector, irises = BlazeFaceDetector(folder), IrisFinder(folder)
    tracker = LandmarkTracker(folder, detector)
    with open_source(source) as capture:
        frames, elapsed_s = [f for _, f in islice(capture, count)], float(1 / capture.fps)
    for frame in frames[::10]:
        watch.time("detect", partial(detector.detect, frame))
    seen = [watch.time("face mesh", partial(tracker.update, frame)) for frame in frames]
    points = [found.points for found in seen if found is not None]
    if len(points) < len(frames):
        raise SystemExit(f"{source}: a face is missing in {len(frames) - len(points)} frames")
    for frame, at in zip(frames[::5], points[::5], strict=True):
        watch.time("irises", partial(irises.find, frame, at))
    fitted = fit_identity(
        head, (frames[0].shape[1], frames[0].shape[0]), points[:: len(points) // 3]
    )
    camera, face = fitted.camera, Face(head, fitted.identity)
    model = personalise(landmark_model(head), fitted.identity.aau, fitted.control_mm)
    alone = [fit_frame(model, camera, points[0], fitted.frames[0])]
    for at in points[1:]:
        alone.append(watch.time("fit", partial(fit_frame, model, camera, at, alone[-1])))
    klt = KltTracker(face, frames[0], camera, alone[0])
    chosen = np.arange(0, len(model.index), LANDMARKS_USED)
    total = len(klt.index) + len(chosen)
    filter_ = FaceFilter(camera, alone[0].pose, np.zeros(0), total)
    filtered = [alone[0].pose]
    for frame, at, shape in zip(frames[1:], points[1:], alone[1:], strict=True):
        ahead = filter_.predict(elapsed_s)
        guess = FaceParameters(ahead.pose, shape.eau)
        tracks = watch.time("klt", partial(klt.track, frame, ahead.camera, guess))
        eyes = np.linalg.norm(at[33, :2] - at[263, :2])
        up, down = np.maximum(shape.eau, 0), np.maximum(-shape.eau, 0)
        mesh = model.neutral + np.tensordot(up, model.up, 1) + np.tensordot(down, model.down, 1)
        variance = np.full(len(chosen), (LANDMARK_SIGMA * eyes) ** 2)
        measured = (
            np.concatenate([tracks.points_mm, mesh[chosen]]),
            np.concatenate([tracks.pixels, at[model.index[chosen], :2]]),
            np.concatenate([tracks.variance_px2, variance]),
            np.zeros(0),
            np.zeros(0),
        )
        held = watch.time("filter", partial(filter_.update, *measured))
        klt.put_back(frame, held.camera, FaceParameters(held.pose, shape.eau))
        filtered.append(held.pose)
    for name, ms in watch.ms.items():
        print(f"{name:10} {np.median(ms):6.2f} ms, at best {min(ms):6.2f}")
    print("jitter pitch yaw roll, degrees: landmarks", calmness([euler_deg(a.pose) for a in alone]))
    print("                                   filter", calmness([euler_deg(p) for p in filtered]))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("source")
    parser.add_argument("--frames", type=int, default=100)
    arguments = parser.parse_args()
    measure(arguments.source, arguments.frames)
