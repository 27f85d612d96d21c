"""Faces that hands hide in some frames of a sample: what hides them is not learned as the face.

A palm search takes 6 to 15 ms: some frames are searched, and those beside one that shows a hand.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from encoder.capture.face_crop import Crop, crop_window
from encoder.detection.hands import PALM_PX, HandFinder, window_around
from encoder.detection.ssd import Tile
from encoder.detection.tflite import find_hand_networks
from encoder.learning.face_sample import FaceSample
from runtime.parallel import parallel_map
from shared_model.arrays import Array, Picture

# The outlines (k, 2) of the hands in a frame, pixels.
Outlines = list[Array]

# Hands in more than this share of the frames belong to the person, as a cheek that is leant on one.
MAX_SHARE = 0.9
# Seconds of a live call from one search to the next, and how many times the usual residual energy
# is searched at once: the median of so many seconds.
SEARCH_INTERVAL_S, SUSPICIOUS_RATIO, USUAL_S = 1.0, 1.5, 3.0


class HandWatch:
    """Looks for hands near a face; without the networks there are none.

    The networks are loaded when they are first needed, and not taken along to another process.
    """

    def __init__(self) -> None:
        self._files = find_hand_networks()
        self._finder: HandFinder | None = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_finder": None}

    def find(self, picture: Picture, points: Array) -> Outlines:
        """Hands in a frame (h, w, 3) uint8 BGR near the face with these landmarks (468, >= 2)."""
        return self._search(picture, window_around(points))

    def hide(self, sample: FaceSample) -> FaceSample:
        """A sample with the hands in its crop hidden; the same object if there are none."""
        found = self._in_window(sample)
        return replace(sample, crop=sample.crop.hiding(found), window=None) if found else sample

    def _in_window(self, sample: FaceSample) -> Outlines:
        window = sample.window
        if window is None:
            return []
        whole = 0, 0, max(window.picture.shape[:2])
        return [window.to_frame_px(each) for each in self._search(window.picture, whole)]

    def _search(self, picture: Picture, window: Tile) -> Outlines:
        if self._files is None:
            return []
        self._finder = self._finder or HandFinder(self._files)
        return self._finder.find(picture, window)

    def find_in_series(
        self,
        pictures: Sequence[Picture],
        points: Sequence[Array],
        known: Mapping[bytes, Outlines],
    ) -> tuple[list[Outlines], dict[bytes, Outlines]]:
        """Hands in each frame of a series of which every second one is searched, and those beside
        one that shows a hand; and those of the frames that are known by now.

        known: of frames that have been searched before, by the bytes of their landmarks.
        """
        keys, found, searched = [each.tobytes() for each in points], dict[int, Outlines](), {}
        for number in (*range(0, len(keys), 2), *range(1, len(keys), 2)):
            key = keys[number]
            is_beside = number % 2 == 0 or found[number - 1] or found.get(number + 1)
            if key in known or is_beside:
                hands = known[key] if key in known else self.find(pictures[number], points[number])
                found[number] = searched[key] = hands
            else:
                found[number] = []
        return [found[number] for number in range(len(keys))], searched

    def find_all(
        self, pictures: Sequence[Picture], points: Sequence[Array], workers: int | None = None
    ) -> list[Outlines]:
        """Hands in each frame of a sample; none at all where they belong to the person.

        workers: see `parallel_map`.
        """
        pairs = zip(pictures, points, strict=True)
        return that_come_and_go(parallel_map(lambda pair: self.find(*pair), pairs, workers))


class HandSuspicion:
    """Which samples of a live call are searched for hands: a search takes longer than the rest of
    what is learned from a sample.

    The first is, one every `SEARCH_INTERVAL_S`, those that follow one with a hand, and those that
    the model explains much worse than it has explained the others when they came.
    """

    def __init__(self, samples_per_s: float) -> None:
        self._interval = round(SEARCH_INTERVAL_S * samples_per_s)
        self._until_search = 0
        self._energies = deque[float](maxlen=round(USUAL_S * samples_per_s))

    def is_due(self, energy: float) -> bool:
        """Whether to search a sample of which the model leaves this residual energy."""
        is_unusual = bool(self._energies) and energy > SUSPICIOUS_RATIO * np.median(self._energies)
        self._energies.append(energy)
        if self._until_search and not is_unusual:
            self._until_search -= 1
            return False
        return True

    def note(self, has_hands: bool) -> None:
        """Note what a search has found."""
        self._until_search = 0 if has_hands else self._interval - 1
        if has_hands:
            self._energies.pop()


def window_of(picture: Picture, points: Array) -> Crop:
    """What a frame shows around a face with these landmarks, see `FaceSample.window`."""
    return crop_window(picture, window_around(points), PALM_PX)


def that_come_and_go(hands: Sequence[Outlines]) -> list[Outlines]:
    """The hands of each frame, or none at all where nearly all frames show some."""
    shown = sum(map(bool, hands))
    return [[] for _ in hands] if shown > MAX_SHARE * len(hands) else list(hands)


def without_hands(hands: Sequence[Outlines]) -> list[int]:
    """Numbers of the frames in which there is no hand; see `that_come_and_go`."""
    return [number for number, outlines in enumerate(hands) if not outlines]


@dataclass(slots=True)
class SampleHands:
    """The hands in a sample of a recorded call, and in the frames beside it.

    numbers: of the frames of the sample, rising.  hands: in each.
    """

    watch: HandWatch
    numbers: Sequence[int]
    hands: Sequence[Outlines]
    _of: dict[int, Outlines] = field(init=False)

    def __post_init__(self) -> None:
        self._of = dict(zip(self.numbers, self.hands, strict=True))

    def in_frame(self, number: int, picture: Picture, points: Array) -> Outlines:
        """Hands in frame `number`, which is searched only beside a sampled frame with a hand."""
        if number in self._of:
            return self._of[number]
        after = int(np.searchsorted(self.numbers, number))
        beside = list(self.numbers[max(after - 1, 0) : after + 1])
        return self.watch.find(picture, points) if any(self._of[each] for each in beside) else []
