"""What the processes of a call say to each other, over pairs of sockets.

`serve` of a process gets its options first.  Times are `time.monotonic` of this host, in seconds,
unless they are said to be others.
"""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from protocol.link.interface import LinkOptions

if TYPE_CHECKING:
    from shared_model.arrays import Picture

# What stands for the camera or the microphone of the page.
BROWSER = "browser"


@dataclass(frozen=True, slots=True)
class OwnMedia:
    """What this end gives.

    camera: video file, camera index or URL, or `BROWSER`.
    microphone: `CAMERA_SOUND`: the sound of the file; `BROWSER`; a device of the host; None: none.
    voice: one of `VOICES`.
    face: (h, w, 3) uint8 BGR with the face that is shown instead when that is switched on; None:
        there is none.  face_on: it is on from the beginning.
    """

    camera: str
    microphone: str | None
    voice: str
    bitrate: float
    low_delay: bool
    face: "Picture | None" = None
    face_on: bool = False


@dataclass(frozen=True, slots=True)
class SendingOptions:
    """What is sent, and where to; the worker's pipe gets the call as well.

    link: of this direction of the call.
    """

    link: LinkOptions
    media: OwnMedia


CAMERA_SOUND = "camera"
# What an end does before it can look for a face, for the user.
WARMING_UP = "warming up"


@dataclass(frozen=True, slots=True)
class DrawingOptions:
    """What is drawn.

    link: of the direction that is drawn; None: the call comes from the worker's pipe.
    fps: pictures a second that are drawn, about; None: all.
    """

    link: LinkOptions | None
    fps: float | None = None


@dataclass(frozen=True, slots=True)
class CameraPicture:
    """A picture of the page's camera, a JPEG file."""

    time_s: float
    jpeg: bytes


@dataclass(frozen=True, slots=True)
class MicrophoneSound:
    """Sound of the page's microphone, int16 mono; time_s: of its first sample."""

    time_s: float
    rate_hz: int
    samples: bytes


class Device(StrEnum):
    """What can be switched off; FACE: another one."""

    CAMERA = "camera"
    MICROPHONE = "microphone"
    FACE = "face"


@dataclass(frozen=True, slots=True)
class Switch:
    """Switch a device on or off."""

    device: Device
    on: bool


@dataclass(frozen=True, slots=True)
class Record:
    """Record into this call file from now on; None: stop recording."""

    path: Path | None


@dataclass(frozen=True, slots=True)
class Draw:
    """Draw pictures from now on, or leave that to the pages."""

    on: bool


@dataclass(frozen=True, slots=True)
class ShownModel:
    """A model of the call, for pages that draw faces; faces name their model by `number`."""

    number: int
    packet: bytes


@dataclass(frozen=True, slots=True)
class ShownFace:
    """The face of a source frame, for pages that draw it.

    index, time_s, made_ms, waited_ms, frozen, lost: as of `Drawn`.
    model: number of its model.  presence: how much of the person is shown, 0 to 1.
    values: see `risorius.call_page.face_message`.
    """

    index: int
    time_s: float
    made_ms: float
    waited_ms: int
    frozen: bool
    lost: bool
    model: int
    presence: float
    values: bytes


@dataclass(frozen=True, slots=True)
class Drawn:
    """A picture that has been drawn, a JPEG file.

    index, time_s: of its source frame, in the call.  made_ms: when it was drawn, ms since 1970.
    waited_ms: until then, from the arrival of its packet.
    frozen: it repeats an older face; lost: since nothing has come.
    """

    index: int
    time_s: float
    made_ms: float
    waited_ms: int
    frozen: bool
    lost: bool
    jpeg: bytes


@dataclass(frozen=True, slots=True)
class Heard:
    """Sound that has been decoded, int16 mono; time_s: of its first sample, in the call."""

    time_s: float
    rate_hz: int
    samples: bytes


@dataclass(frozen=True, slots=True)
class Traffic:
    """What went over the link since the message before.

    payload_bytes, packets: packets of the call.  seconds: since then.
    """

    payload_bytes: int
    packets: int
    seconds: float


@dataclass(frozen=True, slots=True)
class Sending:
    """How sending goes.

    reach: whom packets reach, a `protocol.link.interface.Reachability`.
    loss, round_trip_s: see `LinkQuality`.
    face: what has been sent of the face, in words.
    begun_s: when source frame 0 was taken; None: not yet.  fps: of the camera.
    """

    traffic: Traffic
    reach: str
    loss: float
    round_trip_s: float | None
    face: str
    begun_s: float | None = None
    fps: float = 0.0


class Presence(StrEnum):
    """The other end, as far as its packets tell."""

    AWAITED = "awaited"
    HERE = "here"  # packets come
    SILENT = "silent"  # none has come for a while
    LEFT = "left"


@dataclass(frozen=True, slots=True)
class Receiving:
    """How receiving goes.

    lost: share of the packets that did not come in time, of late.  packet_s: time that a packet
    covers.
    is_camera_off: the other person has switched the camera off.
    """

    traffic: Traffic
    presence: Presence
    lost: float
    packet_s: float
    is_camera_off: bool = False


@dataclass(frozen=True, slots=True)
class Recording:
    """What this direction is recorded into from now on.

    path: the call file; None: it is not recorded.  reason: why it is not any more; "": as asked.
    """

    path: Path | None
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Strangers:
    """Packets have come that are not of this call, or were changed on the way."""


@dataclass(frozen=True, slots=True)
class Trouble:
    """A line for the user.  exit_code: None: the call goes on; else it cannot."""

    text: str
    exit_code: int | None = None


ToSender = CameraPicture | MicrophoneSound | Switch | Record
ToDrawer = Record | Draw
FromWorker = (
    Drawn | ShownModel | ShownFace | Heard | Sending | Receiving | Recording | Strangers | Trouble
)
