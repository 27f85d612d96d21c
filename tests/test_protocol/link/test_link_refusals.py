"""Links that cannot be made, or are gone: one line says why."""

import socket
from contextlib import ExitStack, suppress
from dataclasses import replace
from threading import Event, Thread

import pytest
from links import END, WAIT_S, connecting, free_endpoint, listening
from processes import until

from protocol.link.carriers import open_link_sink, open_link_source
from protocol.link.connection import Connector
from protocol.link.endpoints import Failure
from protocol.relay.zenoh_relay import Relay, RelayOptions
from shared_model.errors import UserError


@pytest.fixture
def over_after_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    """The time to connect is over when a connection could not be opened, however long that took."""
    failed, note = Event(), Connector.on_failed

    def on_failed(self: Connector, connection: int, failure: Failure) -> None:
        note(self, connection, failure)
        failed.set()

    monkeypatch.setattr(Connector, "on_failed", on_failed)
    monkeypatch.setattr("protocol.link.link_end.monotonic", lambda: float(failed.is_set()))
    monkeypatch.setattr("protocol.link.zenoh_link.REFUSAL_S", WAIT_S)


def test_a_port_in_use_is_said_in_one_line() -> None:
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        endpoint = f"tcp/127.0.0.1:{holder.getsockname()[1]}"
        with pytest.raises(UserError, match="port is in use") as caught:
            open_link_source(listening(endpoint))
    assert caught.value.exit_code == 4


def test_an_address_of_someone_else_is_said_in_one_line() -> None:
    with pytest.raises(UserError, match=r"cannot listen on tcp/192\.0\.2\.1:7447: ") as caught:
        open_link_source(listening("tcp/192.0.2.1:7447"))
    assert caught.value.exit_code == 4
    assert ".rs" not in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.usefixtures("over_after_a_failure")
@pytest.mark.parametrize("scheme", ["tcp", "udp"])
def test_nobody_listening_is_said_when_the_time_is_over(scheme: str) -> None:
    where = free_endpoint(scheme)
    with pytest.raises(UserError) as caught:
        open_link_sink(replace(connecting(where), connect_timeout_s=0.2))
    assert str(caught.value) == f"cannot reach {where} within 0.2 s: nobody listens there"
    assert caught.value.exit_code == 4


@pytest.mark.usefixtures("over_after_a_failure")
def test_somebody_who_speaks_another_protocol_is_told_from_nobody() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()

        def hang_up() -> None:
            with suppress(OSError):
                while True:
                    other.accept()[0].close()

        Thread(target=hang_up, daemon=True).start()
        where = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(UserError, match="does not speak this protocol"):
            open_link_sink(replace(connecting(where), connect_timeout_s=0.5))
        other.shutdown(socket.SHUT_RDWR)


def test_a_name_that_is_not_known_is_said_at_once() -> None:
    with pytest.raises(UserError) as caught:
        open_link_source(connecting("nobody.invalid:7447"))
    assert str(caught.value) == "cannot reach nobody.invalid:7447: its name is not known"
    assert caught.value.exit_code == 4


@pytest.mark.parametrize("scheme", ["tcp", "udp"])
def test_who_is_there_for_another_call_is_named(stack: ExitStack, scheme: str) -> None:
    where, said = free_endpoint(scheme), list[str]()
    stack.enter_context(open_link_source(replace(listening(where), call="other")))
    sink = stack.enter_context(open_link_sink(connecting(where), said.append))

    def give_up() -> UserError:
        with pytest.raises(UserError, match="no decoder came within 0 s") as caught:
            sink.wait_for_peer(0)
        return caught.value

    until(lambda: len(said) > 1, give_up)
    assert said[1:] == ["somebody is there, but for call 'other'"]
    error = give_up()
    assert said[1] in str(error) and error.exit_code == 4


def test_nobody_there_yet_is_not_somebody_for_another_call(stack: ExitStack, endpoint: str) -> None:
    stack.enter_context(Relay(RelayOptions((endpoint,))))
    sink = stack.enter_context(open_link_sink(connecting(endpoint)))
    with pytest.raises(UserError, match=r"^no decoder came within 0\.8 s$"):
        sink.wait_for_peer(0.8)


def test_sending_after_closing_is_a_failed_link(endpoint: str) -> None:
    sink = open_link_sink(listening(endpoint))
    sink.close()
    sink.close()
    with pytest.raises(UserError, match="link has failed") as caught:
        sink.send(END)
    assert caught.value.exit_code == 4
