"""A call both ways, as its page shows it: workers are started, spoken to, and listened to."""

import asyncio
import os
import signal
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Thread
from typing import Any

from encoder.sound.speech_encoder import speech_rate_hz
from protocol.endpoint import parse_endpoint
from protocol.link.direction import Direction, DirectionMessage
from protocol.link.interface import LinkOptions
from protocol.link.zenoh_direction import ZenohDirection
from protocol.relay.zenoh_relay import Relay, RelayOptions
from risorius.call_page.face_message import FaceMessage, ModelMessage
from risorius.call_page.messages import PictureMessage, SoundMessage, Stream
from risorius.call_page.page_clock import PageClock
from risorius.call_page.page_server import PageServer
from risorius.live_call.call_place import own_address
from risorius.live_call.call_status import CallStatus
from risorius.live_call.invitation_card import card, watch_address
from risorius.live_call.loading import go_on_loading
from risorius.live_call.messages import (
    BROWSER,
    CameraPicture,
    Device,
    Draw,
    DrawingOptions,
    Drawn,
    FromWorker,
    Heard,
    MicrophoneSound,
    OwnMedia,
    Presence,
    Receiving,
    Record,
    Recording,
    Sending,
    SendingOptions,
    ShownFace,
    ShownModel,
    Strangers,
    Switch,
    Trouble,
)
from risorius.live_call.worker_process import WorkerProcess
from risorius.page.users_browser import open_browser
from shared_model.errors import LINK_FAILED, UserError

# What the names of a call's two directions end with.
SUFFIXES = {Direction.A: "-a", Direction.B: "-b"}
# Pictures of oneself that are drawn each second, about: they only tell how one is seen.
SELF_FPS = 8.0
# Both ends have two connections here; others may watch along.
MAX_PEERS = 16
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


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


def run_call(
    options: CallOptions, announce: Callable[[str], None], tell: Callable[[str], None]
) -> None:
    """Hold a call until somebody hangs up here.

    announce: called with the page's address.
    tell: called with a line when the other end comes, is lost, or leaves, and once of strangers.
    Raises `UserError` if it cannot be held.
    """
    with ExitStack() as stack:
        link, watch = options.link, None
        if link.listen:
            relay = Relay(RelayOptions(link.listen, max_peers=MAX_PEERS))
            stack.enter_context(relay)
            link = replace(link, listen=(), connect=(own_address(link.listen[0]),))
            if options.share is not None:
                watch = _share(options, relay, options.share, stack)
                tell("no host can reach this one" if watch is None else f"watched at {watch}")
        asyncio.run(_LiveCall(options, link, watch, tell).run(announce))


def _share(options: CallOptions, relay: Relay, port: int, stack: ExitStack) -> str | None:
    """Let browsers elsewhere watch this end; the address of that page."""
    from risorius.watch.watch_server import WatchServer

    link = options.link
    server = stack.enter_context(WatchServer(relay, port))
    # Who listens sends in this direction.
    call = link.call + SUFFIXES[Direction.A]
    return watch_address(parse_endpoint(link.listen[0]), server.port, call, link.security.key)


class _LiveCall:
    """The workers of a call and its page; used in one event loop.

    link: by which both directions connect, also where the call listens.
    """

    def __init__(
        self,
        options: CallOptions,
        link: LinkOptions,
        watch: str | None,
        tell: Callable[[str], None],
    ) -> None:
        self._options, self._link, self._watch = options, link, watch
        self._page = PageServer(
            self._command, self._take_picture, self._take_sound, on_need=self._draw
        )
        self._draws = False  # pictures are needed
        self._clock = PageClock()
        self._over = asyncio.Event()
        self._failure: UserError | None = None
        self._status = CallStatus(self._page, self._clock, options.link, tell)
        self._workers: list[WorkerProcess] = []
        self._has_begun = False  # the workers know what to do
        self._ends: ZenohDirection | None = None
        self._running = 0  # counts how often the workers have been started
        self._recorded: dict[str, Path | None] = {}  # the call file of each side
        self._switches = {"mute": False, "camera-off": False, "face": options.media.face_on}

    async def run(self, announce: Callable[[str], None]) -> None:
        """Hold the call until it is over."""
        loop = asyncio.get_running_loop()
        for number in SIGNALS:
            loop.add_signal_handler(number, self._over.set)
        async with self._page:
            await self._page.open(self._options.port)
            try:
                announce(self._page.address)
                # In a thread that is not waited for: some browsers return when they are closed.
                Thread(target=open_browser, args=(self._page.address,), daemon=True).start()
                self._start_workers()
                ends = await asyncio.to_thread(self._open_ends, loop)
                with ends:
                    self._ends = ends
                    direction = await asyncio.to_thread(ends.settle)
                    if not self._over.is_set():
                        self._begin(direction)
                    self._page.tell("faces")
                    self._setup()
                    self._invite()
                    self._status.tell()
                    await self._over.wait()
            finally:
                for worker in self._workers:
                    worker.close()
                await asyncio.gather(*(asyncio.to_thread(worker.wait) for worker in self._workers))
        if self._failure is not None:
            raise self._failure

    def _open_ends(self, loop: asyncio.AbstractEventLoop) -> ZenohDirection:
        """What settles who sends in which direction."""

        def restart(direction: Direction) -> None:
            with suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(self._restart, direction)

        def tell_other(message: DirectionMessage) -> None:
            with suppress(RuntimeError):
                loop.call_soon_threadsafe(self._note_other, message)

        link, is_listening = self._link, bool(self._options.link.listen)
        where = link.connect[0], link.call, link.security, is_listening
        return ZenohDirection(*where, restart, self._options.person, tell_other)

    def _note_other(self, message: DirectionMessage) -> None:
        self._status.person, self._status.is_muted = message.person, message.is_muted
        self._tell()

    def _restart(self, direction: Direction) -> None:
        """Two ends that came at once had taken the same direction."""
        if not self._over.is_set() and self._has_begun:
            for worker in self._workers:
                worker.close()
            self._start_workers()
            self._begin(direction)

    def _start_workers(self) -> None:
        """Start the workers, which load what they need; they do nothing yet."""
        self._running += 1
        own_picture, monitor = os.pipe()
        try:
            self._other = self._worker("drawing_worker", None, self._receive_other)
            self._self = self._worker("drawing_worker", own_picture, self._receive_self)
            go_on_loading()
            self._sender = self._worker("sending_worker", monitor, self._receive_sending)
        finally:
            for descriptor in (own_picture, monitor):
                os.close(descriptor)

    def _begin(self, direction: Direction) -> None:
        """Let the workers send and receive."""
        ours, theirs = SUFFIXES[direction], SUFFIXES[direction.other]
        self._other.run(DrawingOptions(self._direction(theirs)))
        self._self.run(DrawingOptions(None, SELF_FPS))
        self._sender.run(SendingOptions(self._direction(ours), self._options.media))
        self._has_begun = True
        self._draw(self._draws)

    def _draw(self, is_needed: bool) -> None:
        """Let pictures be drawn here, where a page cannot, or leave that to the pages."""
        self._draws = is_needed
        for worker in (self._other, self._self) if self._workers else ():
            worker.send(Draw(is_needed))

    def _worker(
        self,
        module: str,
        pipe: int | None,
        receive: Callable[[FromWorker | None], None],
    ) -> WorkerProcess:
        """Start a worker; it is ended with the call."""
        loop, running = asyncio.get_running_loop(), self._running

        def take(message: FromWorker | None) -> None:
            # What a worker says that has been started again is of no interest.
            if running == self._running:
                receive(message)

        worker = WorkerProcess(f"risorius.live_call.{module}", pipe, take, loop)
        self._workers.append(worker)
        return worker

    def _direction(self, suffix: str) -> LinkOptions:
        return replace(self._link, call=self._link.call + suffix)

    def _setup(self) -> None:
        """Tell pages what they have and what they give."""
        media = self._options.media
        rate_hz = speech_rate_hz(media.voice) if media.voice != "off" else 0
        self._page.tell(
            "setup",
            call=self._link.call,
            camera=media.camera == BROWSER,
            microphone_hz=rate_hz if media.microphone == BROWSER else 0,
            has_voice=media.voice != "off" and media.microphone is not None,
            has_face=media.face is not None,
            **{name.replace("-", "_"): on for name, on in self._switches.items()},
            recording=any(self._recorded.values()),
        )

    def _invite(self) -> None:
        """Tell pages what to hand over."""
        if self._options.invitation is not None:
            self._page.tell("invitation", **card(self._options.invitation, self._watch))

    # What the workers say.

    def _receive_sending(self, message: FromWorker | None) -> None:
        if isinstance(message, Sending):
            self._status.sending = message
            self._tell()
        elif isinstance(message, Recording):
            self._note_recording("mine", message)
        else:
            self._receive(message)

    def _receive_other(self, message: FromWorker | None) -> None:
        if self._status.is_refused and isinstance(message, Drawn | ShownFace | Heard):
            # It is for somebody else.
            return
        if isinstance(message, Drawn | ShownFace | ShownModel):
            self._show(Stream.OTHER, message)
            if isinstance(message, ShownModel):
                return
            if not self._status.has_picture:
                self._status.has_picture = True
                self._tell()
        elif isinstance(message, Heard):
            sound = SoundMessage(
                Stream.VOICE, message.rate_hz, message.time_s, 0.0, message.samples
            )
            self._page.audience.play(sound)
        elif isinstance(message, Receiving):
            self._status.receiving = message
            if message.presence is Presence.LEFT:
                self._status.has_picture = False
            self._tell()
        elif isinstance(message, Recording):
            self._note_recording("other", message)
        else:
            self._receive(message)

    def _show(self, stream: Stream, message: Drawn | ShownFace | ShownModel) -> None:
        """Hand a picture, a face or a model on to the pages."""
        if isinstance(message, ShownModel):
            self._page.audience.show_model(ModelMessage(stream, message.number, message.packet))
        elif isinstance(message, ShownFace):
            shown = _picture(stream, message, b"")
            face = message.model, message.presence, message.values
            self._page.audience.show_face(FaceMessage(shown, *face))
        else:
            self._page.audience.show(_picture(stream, message, message.jpeg))

    def _tell(self) -> None:
        """Tell how the call goes; the ends part one after the other when it is over."""
        if not self._over.is_set():
            self._status.tell()

    def _receive_self(self, message: FromWorker | None) -> None:
        if isinstance(message, Drawn | ShownFace | ShownModel):
            self._show(Stream.SELF, message)
        elif message is not None:
            self._receive(message)

    def _note_recording(self, side: str, recording: Recording) -> None:
        self._recorded[side] = recording.path
        names = [path.name for path in self._recorded.values() if path is not None]
        if recording.reason:
            self._page.tell("trouble", text=recording.reason)
        elif names:
            self._page.tell("news", text=f"recording into {' and '.join(names)}")
        self._setup()

    def _receive(self, message: FromWorker | None) -> None:
        if message is None:
            # A worker that ends before the call is over has failed.
            if not self._over.is_set():
                self._fail("a part of the call has ended by itself", LINK_FAILED)
        elif isinstance(message, Strangers):
            self._status.tell_of_strangers()
        elif isinstance(message, Trouble):
            if message.exit_code is None:
                self._page.tell("trouble", text=message.text)
            else:
                self._fail(message.text, message.exit_code)

    def _fail(self, text: str, exit_code: int) -> None:
        self._failure = self._failure or UserError(text, exit_code)
        self._over.set()

    # What the pages say.

    def _take_picture(self, picture: PictureMessage) -> None:
        if self._options.media.camera == BROWSER:
            taken_s = self._clock.taken_s(picture.made_ms)
            self._sender.send(CameraPicture(taken_s, picture.jpeg))

    def _take_sound(self, sound: SoundMessage) -> None:
        if self._options.media.microphone == BROWSER:
            taken_s = self._clock.taken_s(sound.made_ms)
            self._sender.send(MicrophoneSound(taken_s, sound.rate_hz, sound.samples))

    def _command(self, command: dict[str, Any]) -> None:
        kind, on = command["kind"], command.get("on") is True
        if kind == "hang-up":
            self._over.set()
            return
        if kind in self._switches:
            self._switches[kind] = on
        if kind == "mute":
            self._sender.send(Switch(Device.MICROPHONE, not on))
            if self._ends is not None:
                self._ends.set_muted(on)
        elif kind == "camera-off":
            self._sender.send(Switch(Device.CAMERA, not on))
        elif kind == "face":
            self._sender.send(Switch(Device.FACE, on))
        elif kind == "record":
            self._record(on)
        self._setup()

    def _record(self, on: bool) -> None:
        """Let the workers begin or end a recording of both sides."""
        start = f"{self._link.call}-{time.strftime('%Y%m%d-%H%M%S')}"
        for worker, side in ((self._sender, "mine"), (self._other, "other")):
            worker.send(Record(self._options.folder / f"{start}-{side}.rzo" if on else None))


def _picture(stream: Stream, drawn: Drawn | ShownFace, jpeg: bytes) -> PictureMessage:
    state = drawn.frozen, drawn.lost, drawn.waited_ms
    return PictureMessage(stream, drawn.index, drawn.time_s, drawn.made_ms, jpeg, *state)
