"""What other relays may say of their calls, and a relay that is closed."""

import pytest
import zenoh

from loopback.process_pair import free_port
from protocol.errors import ProtocolError
from protocol.link.zenoh_session import zenoh_config
from protocol.relay.zenoh_relay import Relay, RelayOptions, calls_at_relay, subscriber_count
from shared_model.errors import UserError


@pytest.mark.parametrize(
    "answer", [b"", b"\xff", b"[]", b"3", b"{}", b'{"clients": 1, "peers": []}', b'{"clients": []}']
)
def test_what_another_relay_may_say_of_its_subscribers_is_an_error(answer: bytes) -> None:
    with pytest.raises(ProtocolError, match="its list of subscribers"):
        subscriber_count(answer)
    assert subscriber_count(b'{"clients": ["a", "b"], "peers": ["c"]}') == 3


def test_a_foreign_relay_is_one_line() -> None:
    place = f"tcp/127.0.0.1:{free_port()}"
    settings = {"mode": "router", "scouting/multicast/enabled": False, "listen/endpoints": [place]}
    with zenoh.open(zenoh_config(settings)) as router:
        key = f"@/{router.zid()}/router/subscriber/u/anna"
        router.declare_queryable(key, lambda query: query.reply(key, b"none of ours"))
        with pytest.raises(UserError, match=f"the calls at {place}: its list") as caught:
            calls_at_relay(place, None)
    assert caught.value.exit_code == 4


def test_a_relay_may_be_closed_twice() -> None:
    place = f"tcp/127.0.0.1:{free_port()}"
    with Relay(RelayOptions((place,))) as relay:
        relay.close()
        # Its port is free.
        Relay(RelayOptions((place,))).close()
