"""What a call both ways is asked for."""

from dataclasses import dataclass
from pathlib import Path

from risorius.live_call.call_place import CallPlace
from shared_model.arrays import Picture


@dataclass(frozen=True, slots=True)
class CallOptions:
    """A call both ways.

    place: where the other end is.  timeout_s: how long to try to connect.
    camera, microphone, voice, bitrate, low_delay: see `SendingOptions`.
    face, face_on: see `SendingOptions`.
    port: TCP port of the page; 0: any free one.
    folder: where recordings go.
    person: name of who is here, as the other end shows it; empty: none.
    share: TCP port of the page by which browsers elsewhere watch this end, which listens; None:
        there is none.
    """

    place: CallPlace
    timeout_s: float
    camera: str
    microphone: str | None
    voice: str
    bitrate: float
    low_delay: bool
    face: Picture | None
    face_on: bool
    port: int
    folder: Path
    person: str = ""
    share: int | None = None
