"""What pages of a relay say, and what is said to them."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from links import MODEL_BYTES, free_endpoint
from processes import until

from protocol.link.carriers import open_link_sink
from protocol.link.delivery.receiver import DeliveryReceiver
from protocol.link.interface import LinkOptions
from protocol.link.link_protection import PlainProtection
from protocol.link.link_sink import LinkSink
from protocol.link.messages import Hello, is_hello, parse_message
from protocol.relay.zenoh_relay import Relay, RelayOptions, WatchedCall, calls_at_relay
from protocol.security.link_security import LinkSecurity

# Payloads, and the pages that they are for.
Heard = list[tuple[bytes, str]]
SESSIONS = {"one": b"decoder1", "two": b"decoder2"}


@contextmanager
def watched() -> Iterator[tuple[WatchedCall, Heard, LinkSink, str]]:
    """A call that is watched at a relay, and what comes there."""
    endpoint, heard = free_endpoint(), Heard()
    options = LinkOptions("anna", connect=(endpoint,), security=LinkSecurity(None))
    with ExitStack() as stack:
        relay = stack.enter_context(Relay(RelayOptions((endpoint,))))
        call = relay.watch("anna", lambda payload, page: heard.append((payload, page)))
        stack.callback(call.close)
        yield call, heard, stack.enter_context(open_link_sink(options)), endpoint


def guard_of(page: str) -> PlainProtection:
    return PlainProtection(SESSIONS[page], is_encoder=False)


def hellos(heard: Heard, page: str) -> list[tuple[Hello, str]]:
    """The HELLO messages that a page can read, each with the page that it was for."""
    found = [(guard_of(page).unprotect(payload), meant) for payload, meant in list(heard)]
    parsed = [(parse_message(data), meant) for data, meant in found if data and is_hello(data)]
    return [(message, meant) for message, meant in parsed if isinstance(message, Hello)]


def test_an_answer_to_one_page_goes_to_that_page_alone() -> None:
    with watched() as (call, heard, _, endpoint):
        ends = {page: DeliveryReceiver(session, print) for page, session in SESSIONS.items()}

        def is_answered(page: str) -> bool:
            call.send(guard_of(page).protect(ends[page].hello(0.0)), page)
            return any(hello.echo == SESSIONS[page] for hello, _ in hellos(heard, page))

        for page in SESSIONS:
            until(lambda page=page: is_answered(page))  # type: ignore[misc]
        answers = [(hello.echo, meant) for hello, meant in hellos(heard, "one") if any(hello.echo)]
        assert {(SESSIONS[page], page) for page in SESSIONS} == set(answers)
        # Pages are no calls of their own.
        assert [each.name for each in calls_at_relay(endpoint, None)] == ["anna"]


def test_pieces_and_frames_go_to_all_pages() -> None:
    with watched() as (call, heard, sink, _):
        guard = guard_of("one")
        end = DeliveryReceiver(SESSIONS["one"], guard.on_peer)
        got, now_s, taken = list[bytes](), 0.0, 0

        def has_model() -> bool:
            nonlocal now_s, taken
            now_s += 0.3
            for payload, _ in heard[taken:]:
                if data := guard.unprotect(payload):
                    got.extend(arrival.data for arrival in end.receive(data, now_s))
            taken = len(heard)
            for data in end.payloads(now_s):
                call.send(guard.protect(data), "one")
            return MODEL_BYTES in got

        sink.send(MODEL_BYTES)
        until(has_model)
        assert any(not meant for _, meant in heard)
