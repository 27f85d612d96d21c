"""What the ends of a link and a relay do alike with Zenoh: settings, errors, and who is there."""

import _thread
import atexit
import json
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from queue import Empty, SimpleQueue
from time import monotonic, sleep
from typing import Any

import zenoh
from zenoh.handlers import Callback

from protocol.link.interface import POLL_S
from protocol.link.messages import Role
from protocol.link.presence import WHO_KEY, call_keys, parse_presence, serialise_presence
from protocol.link.zenoh_settings import OPEN_S

# The attachment that tells an answer who is there from payloads of a call.
PRESENCE_MARK = b"p"
# Time that an interrupted program waits for the session that is being opened.
OPENING_S = 0.5


def zenoh_config(settings: Mapping[str, Any]) -> zenoh.Config:
    """Zenoh's configuration of settings by their names in it."""
    config = zenoh.Config()
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    return config


def reason(error: zenoh.ZError) -> str:
    """Zenoh's message without the source location."""
    return re.sub(r"\s+at \S+\.rs:\d+\.?", "", str(error))


# One for each thread that may be in a function of Zenoh.
_RUNNING: set[object] = set()


def is_busy() -> bool:
    """Whether a thread may be in a function of Zenoh.

    Python aborts ("FATAL: exception not rethrown") if it returns while the interpreter is ending.
    """
    return bool(_RUNNING)


def wait_until_idle(limit_s: float) -> None:
    """Wait until no thread is in a function of Zenoh, in bounds."""
    end_s = monotonic() + limit_s
    while is_busy() and monotonic() < end_s:
        sleep(POLL_S / 10)


# Called after what ends the links that are still open, which was registered later.
atexit.register(wait_until_idle, OPEN_S)


def _start_thread(function: Callable[[], None]) -> None:
    def run() -> None:
        running = object()
        _RUNNING.add(running)
        try:
            function()
        finally:
            _RUNNING.discard(running)

    # `threading.Thread.start` may swallow an interrupt.
    _thread.start_new_thread(run, ())


class SessionThreads:
    """Threads in which sessions are opened and closed."""

    def __init__(self) -> None:
        self._busy = 0
        self._done: SimpleQueue[None] = SimpleQueue()

    def run(self, function: Callable[[], Any]) -> None:
        """Call a function in a thread of its own; Zenoh's errors are ignored."""
        work = [function]

        def call() -> None:
            try:
                # Nothing may hold a session once this is done: the thread would wait for Zenoh.
                with suppress(zenoh.ZError):
                    work.pop()()
            finally:
                self._done.put(None)

        while not self._done.empty():
            self._done.get()
            self._busy -= 1
        self._busy += 1
        _start_thread(call)

    def wait(self, limit_s: float) -> None:
        """Wait until all are done, in bounds."""
        end_s = monotonic() + limit_s
        while self._busy and monotonic() < end_s:
            with suppress(Empty):
                self._done.get(timeout=POLL_S / 2)
                self._busy -= 1


def open_session(config: zenoh.Config) -> zenoh.Session:
    """A session, opened in a thread of its own so that Ctrl-C takes effect.  Raises `ZError`."""
    results: list[zenoh.Session | zenoh.ZError] = []
    done: SimpleQueue[None] = SimpleQueue()

    def run() -> None:
        try:
            results.append(zenoh.open(config))
        except zenoh.ZError as error:
            results.append(error)
        done.put(None)

    _start_thread(run)
    try:
        while not results:
            with suppress(Empty):
                done.get(timeout=POLL_S)
    except BaseException:
        if not results:
            with suppress(Empty):
                done.get(timeout=OPENING_S)
        raise
    (result,) = results
    if isinstance(result, zenoh.ZError):
        raise result
    return result


def answer_who_is_there(session: zenoh.Session, role: Role, call: str) -> None:
    """Answer each question who is there, on the key that whoever asks subscribes to.

    role, call: what is answered; a relay has no call.  Runs in Zenoh's receiving threads.
    """

    def asked(sample: zenoh.Sample) -> None:
        found = parse_presence(sample.payload.to_bytes())
        if found is not None and found[0] is not Role.RELAY:
            _, key = call_keys(found[1], found[0] is Role.ENCODER)
            with suppress(zenoh.ZError):
                session.put(key, serialise_presence(role, call), attachment=PRESENCE_MARK)

    session.declare_subscriber(WHO_KEY, Callback(asked, indirect=False))
