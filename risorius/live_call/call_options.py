"""What a call both ways is asked for."""

from dataclasses import dataclass
from pathlib import Path

from protocol.link.interface import LinkOptions
from risorius.live_call.messages import OwnMedia


@dataclass(frozen=True, slots=True)
class CallOptions:
    """A call both ways.

    link: to the other end, by the call's name, which its two directions add to.
    invitation: what the page shows to hand over while nobody has called; None: nothing.
    port: TCP port of the page; 0: any free one.
    folder: where recordings go.
    person: name of who is here, as the other end shows it; empty: none.
    share: TCP port of the page by which browsers elsewhere watch this end, which listens; None:
        there is none.
    """

    link: LinkOptions
    invitation: str | None
    media: OwnMedia
    port: int
    folder: Path
    person: str = ""
    share: int | None = None
