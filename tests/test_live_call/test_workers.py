"""The workers of a call: what ends them, and what they say of it."""

import asyncio
import socket
from contextlib import closing
from fractions import Fraction
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
from processes import LIMIT_S

from decoder.sinks.frame_sink import open_sink
from loopback.process_pair import free_port
from protocol.link.carriers import open_link_source
from protocol.link.interface import LinkOptions, MessageCallback, PacketSource
from protocol.relay.zenoh_relay import Relay, RelayOptions
from risorius.live_call import drawing_worker, sending_worker
from risorius.live_call.messages import (
    DrawingOptions,
    OwnMedia,
    Record,
    SendingOptions,
    Trouble,
)
from risorius.live_call.packets.traffic_meter import MeteredSource
from risorius.live_call.worker_connection import WorkerConnection
from risorius.live_call.worker_process import WorkerProcess
from runtime.child_process import start_fork_server
from runtime.object_stream import ObjectStream
from shared_model.errors import UserError


def test_a_mistake_of_the_user_is_told_and_what_comes_next_is_done() -> None:
    ours, theirs = map(ObjectStream, socket.socketpair())
    worker, done = WorkerConnection(theirs), list[Path | None]()

    def do(message: Record) -> None:
        done.append(message.path)
        if message.path is not None:
            raise UserError(f"cannot write {message.path}")

    for path in (Path("x.rzo"), None):
        ours.send(Record(path))
    ours.close()
    worker.obey(do)
    assert done == [Path("x.rzo"), None] and worker.is_over.is_set()


def test_a_mistake_is_told_to_the_page() -> None:
    ours, theirs = map(ObjectStream, socket.socketpair())
    worker = WorkerConnection(theirs)

    def do(message: Record) -> None:
        worker.is_over.set()
        raise UserError("no space left")

    ours.send(Record(None))
    worker.in_background(lambda: worker.obey(do))
    assert ours.receive() == Trouble("no space left")
    ours.close()


def test_any_other_error_ends_the_worker() -> None:
    ours, theirs = map(ObjectStream, socket.socketpair())
    worker = WorkerConnection(theirs)

    def do(message: Record) -> None:
        raise AttributeError

    ours.send(Record(None))
    with pytest.raises(AttributeError):
        worker.obey(do)
    assert worker.is_over.is_set()


def test_a_worker_that_does_not_run_yet_is_ended_while_the_fork_server_loads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "lingering.py").write_text("import time\ndef load(): time.sleep(9999)\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    start_fork_server("lingering", "load")
    loop = asyncio.new_event_loop()
    with closing(loop):
        worker = WorkerProcess("risorius.live_call.drawing_worker", None, lambda _: None, loop)
        worker.close()
        ending = Thread(target=worker.wait, daemon=True)
        ending.start()
        ending.join(LIMIT_S)
    assert not ending.is_alive()


def test_who_sends_waits_as_long_as_the_user_says(tmp_path: Path) -> None:
    clip = tmp_path / "clip.mkv"
    with open_sink(clip, 16, 16, Fraction(25)) as sink:
        sink.write(np.zeros((16, 16, 3), np.uint8))
    where = f"127.0.0.1:{free_port()}"
    link = LinkOptions("anna-a", connect=(where,), connect_timeout_s=0.2)
    options = SendingOptions(link, OwnMedia(str(clip), None, "off", 800.0, False))
    ours, theirs = map(ObjectStream, socket.socketpair())
    with closing(ours), pytest.raises(UserError, match=r"cannot reach .* within 0\.2 s"):
        sending_worker.run(WorkerConnection(theirs), options)


def test_who_draws_opens_no_other_link_once_the_call_is_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The other end would wait for whoever joins then."""
    address, opened = f"127.0.0.1:{free_port()}", list[PacketSource]()
    ours, theirs = map(ObjectStream, socket.socketpair())
    worker = WorkerConnection(theirs)

    def open_and_note(options: LinkOptions, say: MessageCallback) -> PacketSource:
        opened.append(open_link_source(options, say))
        return opened[-1]

    def draw_and_hang_up(*arguments: Any) -> MeteredSource:
        worker.is_over.set()
        return MeteredSource(*arguments)

    monkeypatch.setattr("risorius.live_call.drawing_worker.open_link_source", open_and_note)
    monkeypatch.setattr("risorius.live_call.drawing_worker.MeteredSource", draw_and_hang_up)
    link = LinkOptions("anna-b", connect=(address,), connect_timeout_s=60)
    with closing(ours), Relay(RelayOptions((f"tcp/{address}",))):
        drawing_worker.run(worker, DrawingOptions(link))
    assert len(opened) == 1
