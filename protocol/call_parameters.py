"""What stays the same throughout a call: profile, picture size, frame rate, camera."""

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from protocol.entropy.validation import as_float32, check_bool, check_int
from protocol.limits import (
    MAX_FOCAL_PX,
    MAX_FPS,
    MAX_FPS_TERM,
    MAX_FRAME_INDEX,
    MAX_FRAME_STEP,
    MAX_FRAMES_PER_PACKET,
    MAX_SIDE_PX,
    VOICE_NUMBERS,
    VOICES,
)
from protocol.sample_aspect import check_aspect, source_size
from shared_model.geometry import Camera

PROFILES = ("thesis", "default")
COLOUR_MATRICES = ("bt601", "bt709")


@dataclass(frozen=True, slots=True)
class CallParameters:
    """The parameters that stay the same throughout a call.

    profile: one of `PROFILES`.
    width, height: size of the pictures of the call, pixels.
    fps_numerator, fps_denominator: frame rate of the source, frames per second.
    focal_px: focal length, pixels; rounded to single precision.
    frames_per_packet: coded frames in one frame packet (default profile).
    start_frame: source frame of the first coded frame.
    frame_step: source frames from one coded frame to the next (default profile).
    has_eyelids: frame packets of the thesis profile carry the two eyelid actuators as well.
    colour_matrix: one of `COLOUR_MATRICES`, the matrix of the source's Y'CbCr; bt601 if the source
        states none or is RGB.
    voice: one of `VOICES`, the codec of the speech in the frame packets; off: the call is silent.
    sample_aspect: sample aspect ratio of the source, width of a pixel over its height, see
        `sample_aspect`.
    has_residual: frame packets carry a picture residual (default profile), see
        `protocol.picture_residual`.
    """

    profile: str
    width: int
    height: int
    fps_numerator: int
    fps_denominator: int
    focal_px: float
    frames_per_packet: int = 1
    start_frame: int = 0
    frame_step: int = 1
    has_eyelids: bool = False
    colour_matrix: str = "bt601"
    voice: str = "off"
    sample_aspect: Fraction = Fraction(1)
    has_residual: bool = False

    def __post_init__(self) -> None:
        if self.profile not in PROFILES:
            raise ValueError(f"profile is {self.profile!r}, expected one of {PROFILES}")
        if self.colour_matrix not in COLOUR_MATRICES:
            raise ValueError(
                f"colour matrix is {self.colour_matrix!r}, expected one of {COLOUR_MATRICES}"
            )
        if self.voice not in VOICES:
            raise ValueError(f"voice is {self.voice!r}, expected one of {VOICES}")
        check_aspect(self.sample_aspect)
        check_int("width", self.width, 1, MAX_SIDE_PX)
        check_int("height", self.height, 1, MAX_SIDE_PX)
        check_int("fps numerator", self.fps_numerator, 1, MAX_FPS_TERM)
        check_int("fps denominator", self.fps_denominator, 1, MAX_FPS_TERM)
        if not 1 / MAX_FPS <= self.fps <= MAX_FPS:
            raise ValueError(f"fps is {self.fps}, expected 1/{MAX_FPS}..{MAX_FPS}")
        check_int("frames per packet", self.frames_per_packet, 1, MAX_FRAMES_PER_PACKET)
        check_int("start frame", self.start_frame, 0, MAX_FRAME_INDEX)
        check_int("frame step", self.frame_step, 1, MAX_FRAME_STEP)
        check_bool("has_eyelids", self.has_eyelids)
        if self.has_eyelids and self.profile != "thesis":
            raise ValueError(
                f"eyelids are an option of the thesis profile, not of the {self.profile}"
            )
        check_bool("has_residual", self.has_residual)
        if self.has_residual and self.profile != "default":
            raise ValueError(f"the {self.profile} profile has no picture residual")
        focal = as_float32("focal length", self.focal_px)
        if not 1 <= focal <= MAX_FOCAL_PX:
            raise ValueError(f"focal length is {focal} px, expected 1..{MAX_FOCAL_PX}")
        object.__setattr__(self, "focal_px", focal)

    @property
    def fps(self) -> float:
        """Frame rate of the source, frames per second."""
        return self.fps_numerator / self.fps_denominator

    @property
    def exact_fps(self) -> Fraction:
        """Frame rate of the source, frames per second; the mean of one that varies."""
        return Fraction(self.fps_numerator, self.fps_denominator)

    @property
    def source_size(self) -> tuple[int, int]:
        """Width and height of the source picture, pixels."""
        return source_size(self.width, self.height, self.sample_aspect)

    @property
    def camera(self) -> Camera:
        """The camera of the source."""
        return Camera(self.width, self.height, self.focal_px)


def voice_of(number: Any) -> str:
    """The voice that a number stands for on the wire.  Raises `ValueError` if none does."""
    for voice, its_number in VOICE_NUMBERS.items():
        if type(number) is int and number == its_number:
            return voice
    numbers = ", ".join(map(str, sorted(VOICE_NUMBERS.values())))
    raise ValueError(f"voice is {number!r}, this program reads {numbers}")
