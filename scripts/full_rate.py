"""The tracker's faces as they are: python -m scripts.full_rate SOURCE VIDEO

Follows SOURCE with the whole tracker and draws the first frame's texture and shape at the face of
every frame, as the thesis profile would be without its ten samples a second and eight bits.  With
--light each picture is given the low-order light that suits its source best over the face: an
offset, and a gain that is quadratic in the place; seven numbers a frame, not quantised.
"""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from decoder.frame_sink import open_sink
from decoder.playout import PlayoutFrame
from decoder.scene import Scene
from encoder.capture.video_source import Capture, open_source
from encoder.coding.model_packet import budget_for, build_thesis_model_packet, call_parameters
from encoder.tracking.trackers import TRACKED_EAUS, TrackingOptions, open_tracker
from loopback.quality import TrackedFaceMask
from scripts.command import run, warn
from scripts.track_synthetic import follow_frame
from shared_model.errors import UserError
from shared_model.mesh import generic_head
from shared_model.parameters import FaceParameters
from shared_model.stage_timer import StageTimer

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Picture = NDArray[np.uint8]

# The light ends softly: so much of the picture's width beyond the face, a standard deviation.
EDGE_SIGMA = 0.01


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("source")
    parser.add_argument("video", type=Path)
    parser.add_argument("--frames", type=int, help="only so many")
    parser.add_argument("--light", action="store_true", help="light as it suits each frame")
    parser.add_argument("--without-lids", action="store_true", help="the thesis' four actuators")
    options = parser.parse_args(arguments)
    follow = TrackingOptions(eyelids=not options.without_lids, refine_identity=False)
    with ExitStack() as stack:
        capture = stack.enter_context(open_source(options.source))
        size = capture.width, capture.height
        sink = stack.enter_context(
            open_sink(options.video, *size, capture.fps, capture.colour_matrix)
        )
        area = TrackedFaceMask() if options.light else None
        for original, drawn in drawings(capture, follow, options.frames, stack):
            face = area(original) if area else None
            sink.write(drawn if face is None else relit(drawn, original, face))


def drawings(
    capture: Capture, options: TrackingOptions, frames: int | None, stack: ExitStack
) -> Iterator[tuple[Picture, Picture]]:
    """Each source frame and the caller drawn as the tracker has them, who may not move before."""
    head, scene, last = generic_head(), None, None
    size, elapsed_s = (capture.width, capture.height), float(1 / capture.fps)
    follower = open_tracker(options, head, size, TRACKED_EAUS, elapsed_s, warn)
    for index, frame in capture:
        if index == frames:
            return
        face = follow_frame(follower, frame)
        if scene is None:
            if face is None:
                raise UserError(f"{capture.name} begins without a face")
            fitted = follower.fitted
            call = call_parameters(capture, "thesis", fitted.camera.focal_px, index)
            model = build_thesis_model_packet(
                head, fitted, face, frame, call, budget_for("thesis", None)
            )
            scene = Scene(model, head)
            stack.callback(scene.close)
        last = face or last
        assert last is not None
        shown = FaceParameters(last.pose, last.eau)
        yield frame, scene.draw(PlayoutFrame(index, shown, face is None), StageTimer())


def relit(drawn: Picture, original: Picture, face: Mask) -> Picture:
    """`drawn` under the light of `original`, both (h, w, 3) BGR, where the `face` (h, w) is."""
    factors = _light(face)
    have, want = (_luma(picture)[face] for picture in (drawn, original))
    gains = [factor[face] * have for factor in factors]
    # Luma tells the light of all channels: lamps that change their colour are rare.
    light = np.linalg.lstsq(np.stack([*gains, np.ones_like(have)], 1), want - have, rcond=None)[0]
    gain = np.tensordot(light[:-1], factors, 1)
    # Beyond the face, where it was not measured, the light fades.
    share = cv2.GaussianBlur(face.astype(np.float64), (0, 0), EDGE_SIGMA * face.shape[1])
    share[face] = 1.0
    change = share[..., None] * (gain[..., None] * drawn + light[-1])
    return np.asarray(np.clip(np.rint(drawn + change), 0, 255), np.uint8)


def _light(face: Mask) -> Array:
    """(6, h, w) how gains may change over a picture: quadratically, about the face's middle."""
    rows, columns = np.nonzero(face)
    down, across = np.mgrid[: face.shape[0], : face.shape[1]]
    x = (across - columns.mean()) / max(float(np.ptp(columns)), 1.0)
    y = (down - rows.mean()) / max(float(np.ptp(rows)), 1.0)
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])


def _luma(picture: Picture) -> Array:
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.float64)


if __name__ == "__main__":
    run(main)
