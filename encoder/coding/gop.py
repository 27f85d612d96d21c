"""How often a frame of the default profile is coded, and how many of them a packet holds."""

from dataclasses import dataclass
from fractions import Fraction
from math import floor

from protocol.packets import MAX_FRAME_STEP

# Source frames in a packet, about: what its last frame waits for, and a third of what a lost packet
# can spoil.
FRAMES_PER_PACKET = 8


@dataclass(frozen=True, slots=True)
class Cadence:
    """Every how many source frames one is coded, and how many coded ones a packet holds."""

    frame_step: int = 1
    frames_per_packet: int = FRAMES_PER_PACKET

    def coded_fps(self, source_fps: Fraction) -> Fraction:
        """Coded frames per second of a source."""
        return source_fps / self.frame_step


def cadence_for(source_fps: Fraction, wanted_fps: float | None) -> Cadence:
    """The cadence that comes nearest to `wanted_fps` coded frames per second; None: every frame.

    Only every k-th frame can be coded, so the rate is the source's over a whole number.  Packets
    last as long as they do with every frame.
    """
    if wanted_fps is None or wanted_fps >= source_fps:
        return Cadence()
    fewer = floor(min(float(source_fps) / wanted_fps, MAX_FRAME_STEP))
    step = min((fewer, fewer + 1), key=lambda k: abs(float(source_fps) / k - wanted_fps))
    step = min(step, MAX_FRAME_STEP)
    return Cadence(step, max(1, round(FRAMES_PER_PACKET / step)))
