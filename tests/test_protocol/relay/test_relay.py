"""A relay with certificates: who gets in, and what each may do there."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import zenoh
from links import MODEL_BYTES, WAIT_S
from processes import until

from loopback.process_pair import free_port
from protocol.link import link_end
from protocol.link.carriers import open_link_sink, open_link_source
from protocol.link.interface import LinkOptions, Reachability
from protocol.link.messages import Role
from protocol.link.presence import call_keys, parse_presence, serialise_presence
from protocol.link.zenoh_session import zenoh_config
from protocol.relay.zenoh_relay import Relay, RelayOptions, calls_at_relay
from protocol.security.authority import (
    RELAY_KEYS,
    PeerRole,
    create_authority,
    invite_peer,
    read_peers,
    revoke_peer,
)
from protocol.security.key_file import read_key_file
from protocol.security.link_security import KeyFile, LinkSecurity, tls_settings
from shared_model.errors import UserError

PEERS = {
    "anna": ("one", PeerRole.CALLER),
    "bob": ("one", PeerRole.VIEWER),
    "carl": ("two", PeerRole.CALLER),
    "dora": ("two", PeerRole.VIEWER),
    "eve": ("one", PeerRole.VIEWER),
}
Received = list[tuple[str, str]]


def authority(folder: Path) -> dict[str, KeyFile]:
    """Key files of all `PEERS`, and of the relay."""
    create_authority(folder, ["127.0.0.1"], datetime.now(UTC))
    for name, (call, role) in PEERS.items():
        keys = invite_peer(folder, name, call, role, datetime.now(UTC))
        (folder / f"{name}.keys").write_bytes(keys)
    files = {name: read_key_file(folder / f"{name}.keys") for name in PEERS}
    return files | {"relay": read_key_file(folder / RELAY_KEYS)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("relay") / "keys"


@pytest.fixture(scope="module")
def keys(folder: Path) -> dict[str, KeyFile]:
    files = authority(folder)
    revoke_peer(folder, "eve")
    return files


@pytest.fixture(scope="module", params=["tls", "quic"])
def endpoint(
    request: pytest.FixtureRequest, folder: Path, keys: dict[str, KeyFile]
) -> Iterator[str]:
    """Where a relay listens that knows `PEERS`."""
    place = f"{request.param}/127.0.0.1:{free_port()}"
    options = RelayOptions((place,), keys=keys["relay"], peers=read_peers(folder))
    with Relay(options):
        yield place


def session(endpoint: str, keys: KeyFile | None, timeout_s: float = WAIT_S) -> zenoh.Session:
    """Of a client that shows `keys`, which knows no rules."""
    settings: dict[str, Any] = {
        "mode": "client",
        "scouting/multicast/enabled": False,
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": round(1000 * timeout_s),
    }
    if keys is not None:
        settings["transport/link/tls"] = tls_settings(keys)
    return zenoh.open(zenoh_config(settings))


def collector(received: Received, who: str) -> Callable[[zenoh.Sample], None]:
    return lambda sample: received.append((who, sample.payload.to_string()))


def test_only_the_caller_publishes_and_only_the_invited_subscribe(
    stack: ExitStack, endpoint: str, keys: dict[str, KeyFile]
) -> None:
    received: Received = []
    peers = {name: stack.enter_context(session(endpoint, keys[name])) for name in PEERS}
    for name, peer in peers.items():
        for call in ("one", "two"):
            # A peer's own subscription hears what it publishes itself; nobody publishes in both.
            for direction in "du":
                key = f"{direction}/{call}"
                peer.declare_subscriber(key, collector(received, f"{name} {key}"))
        peer.declare_subscriber("**", collector(received, f"{name} **"))

    def all_publish() -> None:
        for name, peer in peers.items():
            for key in ("d/one", "u/one", "d/two", "u/two"):
                peer.put(key, name)

    def heard() -> set[tuple[str, str]]:
        """Of others."""
        return {(who, what) for who, what in received if not who.startswith(f"{what} ")}

    expected = {
        ("bob d/one", "anna"),
        ("anna u/one", "bob"),
        ("dora d/two", "carl"),
        ("carl u/two", "dora"),
    }
    until(lambda: heard() >= expected, all_publish)
    # Zenoh gives what comes for one subscription of a session to all that match.
    assert {pair for pair in heard() if not pair[0].endswith("**")} == expected
    assert not any(who.startswith("eve") or what == "eve" for who, what in heard())


def test_who_shows_no_certificate_or_another_authoritys_does_not_get_in(
    endpoint: str, keys: dict[str, KeyFile], tmp_path: Path
) -> None:
    others = authority(tmp_path / "others")
    mixed = KeyFile(keys["anna"].authority, others["anna"].certificate, others["anna"].private_key)
    for shown in (others["anna"], mixed, None):
        with pytest.raises(zenoh.ZError), session(endpoint, shown, 1) as intruder:
            # With TLS 1.3 a client may take a refused connection for an open one for a moment.
            until(lambda: not list(intruder.info.routers_zid()))
            raise zenoh.ZError("refused")


def test_a_caller_is_not_fooled_by_a_relay_of_another_authority(
    keys: dict[str, KeyFile], tmp_path: Path
) -> None:
    others = authority(tmp_path / "others")
    place = f"tls/127.0.0.1:{free_port()}"
    options = RelayOptions((place,), keys=others["relay"], peers=())
    with Relay(options), pytest.raises(zenoh.ZError):
        session(place, keys["anna"], 1)


def test_a_relay_says_that_it_is_there_to_those_who_may_ask(
    stack: ExitStack, endpoint: str, keys: dict[str, KeyFile]
) -> None:
    answers = list[str]()

    def ask(name: str) -> Callable[[], None]:
        """What repeats the question of a peer."""
        peer = stack.enter_context(session(endpoint, keys[name]))
        role = Role.ENCODER if name == "anna" else Role.DECODER

        def note(sample: zenoh.Sample) -> None:
            if sample.attachment is not None:
                assert parse_presence(sample.payload.to_bytes()) == (Role.RELAY, "")
                answers.append(name)

        peer.declare_subscriber(call_keys("one", role is Role.ENCODER)[1], note)
        return partial(peer.put, "w", serialise_presence(role, "one"))

    ask("eve")()
    for name in ("anna", "bob"):
        until(partial(lambda name: name in answers, name), ask(name))
    assert "eve" not in answers


def test_who_was_revoked_or_has_the_other_ends_certificate_is_told(
    stack: ExitStack,
    endpoint: str,
    keys: dict[str, KeyFile],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    invited = stack.enter_context(open_link_sink(options_of(endpoint, keys["anna"])))
    invited.send(MODEL_BYTES)
    until(lambda: invited.reachability is Reachability.NO_PEER, lambda: invited.send(MODEL_BYTES))
    with pytest.raises(UserError, match=r"^no decoder came within 0\.1 s$"):
        invited.wait_for_peer(0.1)
    said: dict[str, list[str]] = {name: [] for name in ("eve", "anna", "dora")}
    sources = [
        stack.enter_context(open_link_source(options_of(endpoint, keys[name]), lines.append))
        for name, lines in said.items()
    ]

    def listen() -> None:
        for source in sources:
            assert source.receive(0) is None

    listen()
    assert {len(lines) for lines in said.values()} == {1}, "an answer may still be on its way"
    monkeypatch.setattr(link_end, "UNREAD_S", 0.0)
    until(lambda: all(len(lines) > 1 for lines in said.values()), listen)
    assert {line for lines in said.values() for line in lines[1:]} == {
        "the relay refuses this certificate: it was revoked, or is for another call or for the"
        " other end of this one"
    }
    refused = stack.enter_context(open_link_sink(options_of(endpoint, keys["bob"])))
    with pytest.raises(UserError, match=r"no decoder came within 0\.1 s; the relay refuses"):
        refused.wait_for_peer(0.1)


def options_of(endpoint: str, keys: KeyFile) -> LinkOptions:
    security = LinkSecurity(key_file=keys)
    return LinkOptions("one", connect=(endpoint,), connect_timeout_s=WAIT_S, security=security)


def test_a_relay_lists_its_calls(stack: ExitStack) -> None:
    place = f"tcp/127.0.0.1:{free_port()}"
    stack.enter_context(Relay(RelayOptions((place,))))
    assert calls_at_relay(place, None, WAIT_S) == []
    encoder, *decoders = [stack.enter_context(session(place, None)) for _ in range(3)]
    held = [encoder.declare_subscriber("u/anna", lambda sample: None)]
    held += [each.declare_subscriber("d/anna", lambda sample: None) for each in decoders]
    until(
        lambda: (
            [(c.name, c.encoders, c.decoders) for c in calls_at_relay(place, None, WAIT_S)]
            == [("anna", 1, 2)]
        ),
        lambda: None,
    )


def test_with_certificates_it_lists_them_to_its_owner_alone(
    stack: ExitStack, endpoint: str, keys: dict[str, KeyFile]
) -> None:
    anna = stack.enter_context(session(endpoint, keys["anna"]))
    held = anna.declare_subscriber("u/one", lambda sample: None)
    until(lambda: "one" in [c.name for c in calls_at_relay(endpoint, keys["relay"], WAIT_S)])
    assert calls_at_relay(endpoint, keys["bob"], WAIT_S) == []
    held.undeclare()  # type: ignore[no-untyped-call]


def test_where_no_relay_is_there_is_one_line() -> None:
    place = f"tcp/127.0.0.1:{free_port()}"
    with pytest.raises(UserError, match=r"nobody listens there$") as caught:
        calls_at_relay(place, None, timeout_s=0.2)
    assert caught.value.exit_code == 4
    with Relay(RelayOptions((place,))), pytest.raises(UserError, match="port is in use"):
        Relay(RelayOptions((place,)))


def test_an_end_that_listens_is_no_relay() -> None:
    place = f"tcp/127.0.0.1:{free_port()}"
    settings = {"mode": "peer", "scouting/multicast/enabled": False, "listen/endpoints": [place]}
    with zenoh.open(zenoh_config(settings)), pytest.raises(UserError, match="is no relay"):
        calls_at_relay(place, None, timeout_s=WAIT_S)


def test_two_relays_pass_a_call_on(stack: ExitStack) -> None:
    received: Received = []
    one, two = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    stack.enter_context(Relay(RelayOptions((two,), (one,))))
    stack.enter_context(Relay(RelayOptions((one,))))
    caller, viewer = (stack.enter_context(session(place, None)) for place in (one, two))
    held = viewer.declare_subscriber("d/anna", collector(received, "viewer"))
    until(lambda: bool(received), lambda: caller.put("d/anna", "a frame"))
    assert received[0] == ("viewer", "a frame")
    held.undeclare()  # type: ignore[no-untyped-call]
