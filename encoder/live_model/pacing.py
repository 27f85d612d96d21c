"""What a live call may wait for: all that depends on whether its source waits for the call.

A file that is read as fast as it is encoded waits for whatever is trained.  A camera does not, nor
does a file that is read at its own rate: there frames are coded with what is known by then.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import TypeVar

Refit = TypeVar("Refit")

# Versions that bring layers around the face, unless they are progressive: the first has those of
# its frame, the next those of people who have hardly moved yet, later ones have seen more.
LAYER_UPDATES = frozenset({0, 1, 2, 4, 6, 8})
# Modes come about a tenth of a second after the frames that show what is missing: a packet may wait
# so long after its last frame.
CODING_DELAY_S = 0.08
# Packets of the call's first seconds wait for their modes as long as the first packet was late for
# its frame, at most so long: nothing is shown later for it.
START_S, MAX_START_DELAY_S = 2.0, 0.3
# The lag behind a camera grows no larger: it drops the frames that are not fetched.
MAX_CAMERA_LAG_S = 0.3
# Of fewer coded frames a second, landmarks are found in each.
MIN_ALTERNATING_FPS = 20.0


@dataclass(frozen=True, slots=True)
class Pacing:
    """How a live call divides its time.

    in_real_time: frames do not wait for the learner, landmarks are found in every second frame, and
        a call that falls behind its source leaves work out, see `encoder.calls.overload`.
    max_lag_s: behind the source.
    delay_s: frames wait so long, in the source's time, after they have been seen: models are
        trained from those after them, too.
    coding_delay_s: a packet is coded so long after its last frame, see `packet_delay_s`.
    training_frames: to train from, and up to twice as many.
    mode_interval_s: between two updates of the modes, each of which changes the template of the
        texel fitter.
    mode_samples_per_s: frames a second that modes are learned from.
    lead_packets: from an update of the model to the first packet that needs it.
    mode_lead_packets: before an update's first packet, from which on modes are learned for it.
    updates: of the model, see `ModelSchedule`.
    layer_updates: numbers of the versions that bring layers, counted from the person's first.
    training_threads: None: as many as there are cores.
    """

    in_real_time: bool
    training_frames: int
    mode_interval_s: float
    mode_samples_per_s: float
    lead_packets: int
    mode_lead_packets: int
    updates: Mapping[float, float]
    layer_updates: frozenset[int]
    training_threads: int | None
    max_lag_s: float = inf
    delay_s: float = 0.0
    coding_delay_s: float = 0.0

    @property
    def learns_ahead(self) -> bool:
        """Whether models learn from frames that wait."""
        return self.in_real_time and self.delay_s > 0

    def frame_limit_s(self, fps: float) -> float:
        """How long a frame may take; infinite: any time."""
        return 1 / fps if self.in_real_time else inf

    def packet_delay_s(self, age_s: float, first_frame_s: float) -> float:
        """How long after its last frame a packet is coded.

        age_s: of the call at its first frame.  first_frame_s: how long the call's first one took.
        """
        is_start = self.in_real_time and self.delay_s == 0 and age_s < START_S
        at_start_s = min(first_frame_s, MAX_START_DELAY_S) if is_start else 0.0
        return max(self.coding_delay_s, at_start_s)

    def alternates_landmarks(self, coded_fps: float) -> bool:
        """Whether the landmarks of every second coded frame are not looked for."""
        return self.in_real_time and coded_fps >= MIN_ALTERNATING_FPS

    def may_start_learning(self, is_packet_full: bool) -> bool:
        """Whether modes may begin to be learned: at any frame, or once a packet."""
        return self.in_real_time or is_packet_full

    def fits_layers(self, waiting: int) -> bool:
        """Whether a frame's layers are fitted, `waiting` frames being in its packet.

        In real time those of every second frame are; where landmarks are found in each frame, not
        those of the one with which its packet is coded.
        """
        return not self.in_real_time or waiting % 2 == 0

    def refit(self, whole: Refit, modes_only: Refit) -> Refit:
        """How a waiting frame is fitted again with new modes, of the two ways."""
        return modes_only if self.in_real_time else whole

    def clock_to_wait_by(self, clock: Callable[[], float]) -> Callable[[], float] | None:
        """The clock by which the last frames wait their delay; None: nothing more would come."""
        return clock if self.in_real_time else None


# Frames wait for the learner, and a decoder need not have an update in time.
UNPACED = Pacing(
    in_real_time=False,
    training_frames=24,
    mode_interval_s=0.25,
    mode_samples_per_s=8.0,
    lead_packets=1,
    # Soon enough for the first of them to be used with the update; until then modes are for the
    # version in use.
    mode_lead_packets=1,
    # The first one is soon replaced.
    updates={1.0: 0.6, 5.0: 1.0, 12.0: 1.0, 25.0: 1.0, 45.0: 1.0},
    layer_updates=LAYER_UPDATES,
    training_threads=None,
)
# Fewer frames cost .02 dB on average of seven clips, and half the time.  What is learned beside the
# frames comes late: the sooner it begins the better, and it takes as long as several packets.  Half
# the samples of modes cost .1 dB where there is time, and bring 1.1 beside a busy loop (mean of
# three clips).  An update takes 2 to 4 s, and throws away the modes that were learned meanwhile:
# one at 1.5 s, when more has been seen, and none at 5 s is .6 dB better beside a busy loop, mean of
# three clips.  With layers every frame takes 20 to 30 ms longer, and the first update three times
# as long, and the face cannot wait for them.  More threads would take the cores from the frames.
REAL_TIME = Pacing(
    in_real_time=True,
    training_frames=8,
    mode_interval_s=0.1,
    mode_samples_per_s=4.0,
    lead_packets=4,
    mode_lead_packets=2,
    updates={1.5: 0.8, 12.0: 1.0, 25.0: 1.0, 45.0: 1.0},
    layer_updates=LAYER_UPDATES - {0, 1},
    training_threads=1,
)


def pacing_of(
    is_camera: bool, is_paced: bool, delay_s: float = 0.0, waits_for_modes: bool = False
) -> Pacing:
    """The pacing of a call from a camera, or from a file that may be read at its own rate.

    waits_for_modes: in real time a packet is coded `CODING_DELAY_S` after its last frame.
    """
    if not (is_camera or is_paced):
        return replace(UNPACED, delay_s=delay_s)
    return replace(
        REAL_TIME,
        max_lag_s=MAX_CAMERA_LAG_S if is_camera else inf,
        delay_s=delay_s,
        coding_delay_s=CODING_DELAY_S if waits_for_modes else 0.0,
    )
