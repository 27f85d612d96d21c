"""What a page of a call shows, compared with what the other end's camera has seen: PSNR."""

import base64
import time
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from benchmarks.browser import Browser
from encoder.capture.picture_size import reduced
from encoder.capture.video_source import open_source
from loopback.quality.video_quality import TrackedFaceMask, measure_pictures
from shared_model.arrays import Picture
from shared_model.errors import UserError

# From one picture that is taken of a page to the next.
INTERVAL_S = 1.0
# Width of the pictures by which the frames of the clip are found.
SMALL_PX = 48
# Takes the next picture that the page shows, and the index of its frame: `taken`.
TAKE = """
(() => {
  window.taken = null;
  const player = players[OTHER], tick = player.tick;
  player.tick = () => {
    const before = player.shown;
    tick.call(player);
    if (player.shown === before) return;
    player.tick = tick;
    window.taken = [player.index, player.canvas.toDataURL("image/png")];
  };
})()
"""

# A picture that a page has shown, and the index of its frame.
Seen = tuple[int, Picture]


def pictures_of(pages: Sequence[Browser], seconds: float) -> list[list[Seen]]:
    """What each page shows in so many seconds, a picture a second."""
    seen: list[list[Seen]] = [[] for _ in pages]
    end_s = time.monotonic() + seconds
    while (left_s := end_s - time.monotonic()) > 0:
        time.sleep(min(INTERVAL_S, left_s))
        for page, pictures in zip(pages, seen, strict=True):
            pictures.append(_taken(page))
    return seen


def _taken(page: Browser) -> Seen:
    page.value(TAKE)
    page.wait("taken")
    index, address = page.value("taken")
    data = np.frombuffer(base64.b64decode(address.partition(",")[2]), np.uint8)
    return int(index), np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)


def seen_quality(clip: Path, seen: Sequence[Seen]) -> dict[str, float | int | None]:
    """PSNR of luma of the pictures, dB, over the face and over all of it, means.

    The camera was the clip, over and over: which of its frames was the first is found by the
    pictures.  They have the size to which a call reduces what its camera gives.
    """
    with open_source(str(clip)) as source:
        frames = [reduced(picture) for _, picture in source]
    if not seen:
        raise UserError("the page has shown no picture")
    first = first_frame([_small(each) for each in frames], [(i, _small(p)) for i, p in seen])
    pairs = [(frames[(first + index) % len(frames)], picture) for index, picture in seen]
    quality = measure_pictures(pairs, TrackedFaceMask())
    return {
        "pictures": quality.frames,
        "face_psnr_db": quality.face_psnr_db,
        "picture_psnr_db": quality.full_psnr_db,
    }


def first_frame(frames: Sequence[Picture], seen: Sequence[Seen]) -> int:
    """Which of a clip's frames had index 0: that of the least squared error of all pictures.

    Clip and pictures have one size.
    """
    clip = np.array(frames, np.float32)

    def error(first: int) -> float:
        of = clip[[(first + index) % len(clip) for index, _ in seen]]
        return float(np.square(of - np.array([each for _, each in seen], np.float32)).mean())

    return min(range(len(clip)), key=error)


def _small(picture: Picture) -> Picture:
    height = max(1, round(SMALL_PX * picture.shape[0] / picture.shape[1]))
    small = cv2.resize(picture, (SMALL_PX, height), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)
