"""What a live call leaves out where time is short, in this order.

| level | leaves out, besides all above |
| --- | --- |
| FULL | nothing |
| HALF_THE_FRAMES | every second frame: it gets a face between those of its neighbours |
| NO_IMAGE_FIT | fits to rendered pixels and of layers; frames are not fitted again |
| HALF_RESOLUTION | half the rows and columns of the face, all but one iteration of its texel fit |

`encoder.calls.overload` chooses the level.
"""

from enum import IntEnum

from encoder.learning.person_model import FRAME_FIT_ITERATIONS


class WorkLevel(IntEnum):
    """How much a call leaves out, see the table above."""

    FULL = 0
    HALF_THE_FRAMES = 1
    NO_IMAGE_FIT = 2
    HALF_RESOLUTION = 3

    @property
    def fits_image(self) -> bool:
        """Whether faces are fitted to rendered pixels, and layers are fitted at all."""
        return self < WorkLevel.NO_IMAGE_FIT

    @property
    def texel_iterations(self) -> int:
        """Iterations of the texel fit, at most."""
        return 1 if self.halves_resolution else FRAME_FIT_ITERATIONS

    @property
    def halves_resolution(self) -> bool:
        """Whether faces are fitted at half the resolution."""
        return self >= WorkLevel.HALF_RESOLUTION

    @property
    def halves_frames(self) -> bool:
        """Whether every second frame is not looked at."""
        return self >= WorkLevel.HALF_THE_FRAMES

    @property
    def label(self) -> str:
        """Its name in a report."""
        return self.name.lower()
