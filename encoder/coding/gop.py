"""GOP structure: temporal decimation, and the number of coded frames in a packet."""

from dataclasses import dataclass, replace
from fractions import Fraction
from math import floor

from protocol.limits import MAX_FRAME_STEP

# Source frames in a packet, approximately: the delay of its first frame, and a third of the frames
# that a lost packet may damage.
FRAMES_PER_PACKET = 8


@dataclass(frozen=True, slots=True)
class GopStructure:
    """How the frames of a source are grouped.

    frame_step: source frames from one coded frame to the next.
    frames_per_packet: coded frames in a packet.
    """

    frame_step: int = 1
    frames_per_packet: int = FRAMES_PER_PACKET

    def coded_fps(self, source_fps: Fraction) -> Fraction:
        """Coded frames per second."""
        return source_fps / self.frame_step

    def with_low_delay(self) -> "GopStructure":
        """The same with half as many frames in a packet: their heads take a larger share."""
        return replace(self, frames_per_packet=max(1, self.frames_per_packet // 2))


def gop_for_fps(source_fps: Fraction, target_fps: float | None) -> GopStructure:
    """The structure whose coded rate is nearest to `target_fps`; every frame is coded for None.

    The coded rate is the source's divided by an integer.  A packet spans about `FRAMES_PER_PACKET`
    source frames at any rate.
    """
    if target_fps is None or target_fps >= source_fps:
        return GopStructure()
    fewer = floor(min(float(source_fps) / target_fps, MAX_FRAME_STEP))
    step = min((fewer, fewer + 1), key=lambda k: abs(float(source_fps) / k - target_fps))
    step = min(step, MAX_FRAME_STEP)
    return GopStructure(step, max(1, round(FRAMES_PER_PACKET / step)))
