"""The tracker's faces as they are: python -m scripts.full_rate SOURCE VIDEO

Follows SOURCE with the whole tracker and draws the first frame's texture and shape at the face of
every frame, as the thesis profile would be without its ten samples a second and eight bits.  With
--light each picture is given the gain, offset and slopes of light that suit its source best over
the face.
"""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from decoder.playout import PlayedFrame
from decoder.scene import Scene, StageClock
from decoder.sink import open_sink
from encoder.capture import Capture, open_source
from encoder.follow import FOLLOWED, FollowOptions, open_follower
from encoder.model import budget_for, build_model, call_parameters
from loopback.quality import TrackedFaceArea
from scripts.command import run
from scripts.track_synthetic import follow_frame
from shared_model.errors import UserError
from shared_model.mesh import generic_head
from shared_model.parameters import FaceParameters

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Picture = NDArray[np.uint8]

# The light ends softly: so much of the picture's width beyond the face, a standard deviation.
SOFT = 0.01


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("source")
    parser.add_argument("video", type=Path)
    parser.add_argument("--frames", type=int, help="only so many")
    parser.add_argument("--light", action="store_true", help="light as it suits each frame")
    parser.add_argument("--without-lids", action="store_true", help="the thesis' four actuators")
    options = parser.parse_args(arguments)
    follow = FollowOptions(lids=not options.without_lids, refine=False)
    with ExitStack() as stack:
        capture = stack.enter_context(open_source(options.source))
        size = capture.width, capture.height
        sink = stack.enter_context(open_sink(options.video, *size, capture.fps))
        area = TrackedFaceArea()
        for original, drawn in drawings(capture, follow, options.frames, stack):
            face = area(original) if options.light else None
            sink.write(drawn if face is None else relit(drawn, original, face))


def drawings(
    capture: Capture, options: FollowOptions, frames: int | None, stack: ExitStack
) -> Iterator[tuple[Picture, Picture]]:
    """Each source frame and the caller drawn as the tracker has them, who may not move before."""
    head, scene, last = generic_head(), None, None
    size, elapsed_s = (capture.width, capture.height), float(1 / capture.fps)
    follower = open_follower(options, head, size, FOLLOWED, elapsed_s, print)
    for index, frame in capture:
        if index == frames:
            return
        face = follow_frame(follower, frame)
        if scene is None:
            if face is None:
                raise UserError(f"{capture.name} begins without a face")
            fitted = follower.fitted
            call = call_parameters(capture, "thesis", fitted.camera.focal_px, index)
            model = build_model(head, fitted, face, frame, call, budget_for("thesis", None))
            scene = Scene(model, head)
            stack.callback(scene.close)
        last = face or last
        assert last is not None
        shown = FaceParameters(last.pose, last.eau)
        yield frame, scene.draw(PlayedFrame(index, shown, face is None), StageClock())


def relit(drawn: Picture, original: Picture, face: Mask) -> Picture:
    """`drawn` under the light of `original`, both (h, w, 3) BGR, where the `face` (h, w) is."""
    rows, columns = np.nonzero(face)
    height, width = face.shape
    places = np.stack([columns / width - 0.5, rows / height - 0.5, np.ones(len(rows))], 1)
    have, want = (_luma(picture)[face] for picture in (drawn, original))
    # More than the gain and offset of all channels alike needs no more than luma to be found.
    light = np.linalg.lstsq(np.column_stack([have, places]), want - have, rcond=None)[0]
    down, across = np.mgrid[:height, :width]
    slope = light[1] * (across / width - 0.5) + light[2] * (down / height - 0.5) + light[3]
    change = light[0] * drawn + slope[..., None]
    share = cv2.GaussianBlur(face.astype(np.float64), (0, 0), SOFT * width)[..., None]
    share[face] = 1.0
    return np.asarray(np.clip(np.rint(drawn + share * change), 0, 255), np.uint8)


def _luma(picture: Picture) -> Array:
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.float64)


if __name__ == "__main__":
    run(main)
