"""What is said of a call in the terminal while its two directions come and go."""

from dataclasses import replace

import pytest

pytest.importorskip("aiohttp", reason="needs aiohttp: pip install '.[call]'")

from protocol.link.interface import LinkOptions, Reachability
from risorius.call_page.page_clock import PageClock
from risorius.call_page.page_server import PageServer
from risorius.live_call.call_status import CallStatus
from risorius.live_call.messages import Presence, Receiving, Sending, Traffic

TRAFFIC = Traffic(0, 0, 1.0)
LINKED = Sending(TRAFFIC, Reachability.HAS_PEER, 0.0, None, "")
ALONE = replace(LINKED, reach=Reachability.NO_PEER)
HERE = Receiving(TRAFFIC, Presence.HERE, 0.0, 0.32)
LEFT = replace(HERE, presence=Presence.LEFT)


def test_whoever_has_left_is_calling_only_when_they_come_again() -> None:
    said = list[str]()
    link = LinkOptions("anna", listen=("tcp/127.0.0.1:1",))
    status = CallStatus(PageServer(), PageClock(), link, said.append)
    for sending, receiving in (
        (ALONE, None),
        (LINKED, HERE),
        # The other end is gone in one direction after the other.
        (LINKED, LEFT),
        (ALONE, LEFT),
        (LINKED, LEFT),
    ):
        status.sending, status.receiving = sending, receiving
        status.has_picture = receiving is HERE
        status.tell()
    assert said == ["anna: is here", "anna: has left", "anna: is calling"]
