"""Frames of a call in which nobody is there, told by the segmentation network.

A face that is not found may be turned away or behind a hand: then the person is still there.
"""

from encoder.detection.segmentation import PersonSegmenter
from encoder.detection.tflite import find_segmentation_network
from encoder.learning.frame_sampler import UniformSubsampler
from shared_model.arrays import Picture

# A picture of which people have less than this share shows nobody.
EMPTY_SHARE = 0.01
# Of frames without a face every so many is looked at.
LOOK_INTERVAL = 3
# Frames without anybody that are kept, and up to twice as many.
KEPT_FRAMES = 4


class AbsenceWatch:
    """Looks at the frames of a call that show no face.

    empty: the frames in which nobody is there.
    Without the segmentation network there are none.
    """

    def __init__(self) -> None:
        self.empty: set[int] = set()
        self._path = find_segmentation_network()
        self._segmenter: PersonSegmenter | None = None
        self._kept = UniformSubsampler[Picture](KEPT_FRAMES)
        self._looked_at, self._is_empty = -LOOK_INTERVAL, False

    @property
    def pictures(self) -> list[Picture]:
        """Some of the frames in which nobody is there."""
        return [picture for _, picture in self._kept.frames]

    def take(self, index: int, picture: Picture) -> None:
        """Take frame `index` (h, w, 3) uint8 BGR, which shows no face."""
        if self._path is None:
            return
        if index - self._looked_at >= LOOK_INTERVAL:
            self._looked_at = index
            self._segmenter = self._segmenter or PersonSegmenter(self._path)
            self._is_empty = float(self._segmenter.share(picture).mean()) < EMPTY_SHARE
        if self._is_empty:
            self._kept.offer(len(self.empty), lambda: picture)
            self.empty.add(index)
