"""What a live call leaves out where time is short, in this order.

| level | leaves out, besides all above | ms of a frame |
| --- | --- | --- |
| FULL | nothing | 16.5 |
| NO_IMAGE_FIT | fits to rendered pixels and of layers; frames are not fitted again | 13.9 |
| ONE_ITERATION | all but one iteration of the texel fit | 13.2 |
| HALF_THE_FRAMES | every second frame: it gets a face between those of its neighbours | 7.4 |
| HALF_RESOLUTION | half the rows and columns of the face's picture and of its texels | 6.8 |

Times are of the mean source frame of a paced call of 640x480 pixels, networks and the learning
process beside it included (docs/measurements.md).  `encoder.calls.overload` chooses the
level.
"""

from enum import IntEnum

from encoder.learning.person_model import FRAME_FIT_ITERATIONS


class WorkLevel(IntEnum):
    """How much a call leaves out, see the table above."""

    FULL = 0
    NO_IMAGE_FIT = 1
    ONE_ITERATION = 2
    HALF_THE_FRAMES = 3
    HALF_RESOLUTION = 4

    @property
    def fits_image(self) -> bool:
        """Whether faces are fitted to rendered pixels, and layers are fitted at all."""
        return self < WorkLevel.NO_IMAGE_FIT

    @property
    def texel_iterations(self) -> int:
        """Iterations of the texel fit, at most."""
        return FRAME_FIT_ITERATIONS if self < WorkLevel.ONE_ITERATION else 1

    @property
    def halves_resolution(self) -> bool:
        """Whether faces are fitted at half the resolution."""
        return self >= WorkLevel.HALF_RESOLUTION

    @property
    def label(self) -> str:
        """Its name in a report."""
        return self.name.lower()

    def omits(self, frames_to_last: int) -> bool:
        """Whether a frame is left out, so many coded frames before the last of its packet.

        That one never is: what is left out lies between two frames of one packet, or follows upon
        the last of the packet before.
        """
        return self >= WorkLevel.HALF_THE_FRAMES and frames_to_last % 2 == 1
