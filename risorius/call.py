"""The pictures of a call, as a program takes them."""

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple, Self

from decoder.call_pictures import CallPictures
from decoder.playout.call_source import CallSource
from protocol.endpoint import parse_endpoint
from protocol.errors import ProtocolError
from protocol.limits import DEFAULT_CALL
from protocol.link.interface import LinkOptions
from protocol.security.invitation import parse_invitation
from protocol.security.link_security import LinkSecurity
from shared_model.arrays import Picture
from shared_model.errors import UserError


class TimedPicture(NamedTuple):
    """A picture (height, width, 3) uint8 BGR, and its time in the source, seconds."""

    time_s: float
    picture: Picture


class Call:
    """A call that is decoded while it is iterated; a context manager that can be iterated once."""

    def __init__(self, options: CallSource) -> None:
        self._pictures = CallPictures(options, lambda: False)

    def __iter__(self) -> Iterator[TimedPicture]:
        """Each picture as soon as it is drawn, one for each frame of the source."""
        for frame in self._pictures:
            yield TimedPicture(float(frame.time_s), frame.picture)

    @property
    def fps(self) -> float:
        """Frames a second of the source, the mean if they vary; known from the first picture on."""
        return self._pictures.sender.fps

    @property
    def complete(self) -> bool:
        """Whether the call has come to its end."""
        return self._pictures.complete

    def close(self) -> None:
        """Free the renderer; close the call file or leave the network."""
        self._pictures.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def open_call(
    source: str | Path | BinaryIO | None,
    listen: tuple[str, ...],
    connect: tuple[str, ...],
    call: str | None,
    face: Path | None,
    invite: str | None,
    insecure: bool,
) -> Call:
    """See `risorius.open_call`."""
    link = {"listen": listen, "connect": connect, "call": call, "invite": invite}
    if source is not None and (named := [name for name, value in link.items() if value]):
        raise UserError(f"{named[0]} does not go with a call file; leave out {named[0]}")
    path = Path(source) if isinstance(source, str) else source
    place = None if path is not None else _link(listen, connect, call, invite, insecure)
    return Call(CallSource(path, place, face))


def _link(
    listen: tuple[str, ...],
    connect: tuple[str, ...],
    call: str | None,
    invite: str | None,
    insecure: bool,
) -> LinkOptions:
    """The link, with name, key and, if none is given, place of the invitation."""
    if invite is not None:
        try:
            invitation = parse_invitation(invite)
        except ProtocolError as error:
            raise UserError(str(error)) from error
        if call not in (None, invitation.call):
            raise UserError(f"the invitation is to call {invitation.call!r}; leave out call")
        if not listen and not connect:
            connect = (invitation.address,)
        security = LinkSecurity(invitation.key)
        return LinkOptions(invitation.call, listen, connect, security=security)
    places = map(parse_endpoint, listen + connect)
    if not insecure and not all(place.is_loopback for place in places):
        raise UserError("no invitation to this call: give invite, or insecure=True")
    return LinkOptions(call or DEFAULT_CALL, listen, connect)
