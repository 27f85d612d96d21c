"""A one-way call on a page while it is decoded, or while it is sent."""

import fcntl
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import BinaryIO, Self, cast

from decoder.call_pictures import DrawnFrame
from decoder.playout.playout import PlayoutFrame
from protocol.call_parameters import CallParameters
from protocol.model_packet import ModelPacket
from risorius.call_page.face_message import FaceMessage, ModelMessage, face_values
from risorius.call_page.messages import PictureMessage, Stream
from risorius.call_page.numbered_models import NumberedModels
from risorius.call_page.page_thread import PageThread
from risorius.page.users_browser import open_browser
from shared_model.arrays import Samples

# An interrupted program ends within about this time.
NAP_S = 0.1
# As much of the call may wait for a program that shows it: an encoder must not wait for that.
PIPE_BYTES = 1 << 20


class CallView:
    """Shows a call on a page; a context manager and a `FaceObserver`.

    A page that can draws the faces; for others pictures are drawn here.

    announce: called with the page's address.
    name: of the call, as the page's title.
    port: TCP port on this host; 0: any free one.
    is_recorded: the call is read from a file: it is shown at the source's own rate, and begins when
        somebody looks.  paced: shown at that rate; a call over a link comes at it.
    stop: whether the user has asked to stop.
    """

    def __init__(
        self,
        announce: Callable[[str], None],
        name: str,
        port: int,
        is_recorded: bool,
        paced: bool,
        stop: Callable[[], bool],
    ) -> None:
        self._name, self._paced, self._stop = name, paced, stop
        self._start_s: float | None = None
        self._page, self._has_faces = PageThread(port), False
        self._models = NumberedModels(
            lambda number, packet: self._page.show_model(ModelMessage(Stream.OTHER, number, packet))
        )
        self._tell("waiting for the call", over="Waiting for the call …")
        announce(self._page.address)
        open_browser(self._page.address)
        if is_recorded:
            self._page.tell("tape")
            self._page.wait_for_page(stop)

    def show(self, frame: DrawnFrame, sender: CallParameters) -> None:
        """Show one picture, at its time if the call is paced, if somebody needs it."""
        time_s = self._wait_for(frame.index, sender)
        if self.wants_pictures:
            self._page.show(frame.index, time_s, frame.picture, frame.frozen, frame.lost)

    @property
    def wants_pictures(self) -> bool:
        """See `FaceObserver`."""
        return self._page.needs_pictures or not self._has_faces

    def see_model(self, model: ModelPacket) -> None:
        """See `FaceObserver`; pages do not draw a picture residual."""
        if model.call.has_residual:
            return
        self._models.number_of(model)
        if not self._has_faces:
            self._has_faces = True
            self._page.tell("faces")

    def see_frame(self, frame: PlayoutFrame, arrival_s: float) -> None:
        """See `FaceObserver`: pages draw the face, at its time if the call is paced."""
        if not self._has_faces:
            return
        time_s = self._wait_for(frame.index, frame.model.call)
        shown = PictureMessage(
            Stream.OTHER, frame.index, time_s, 1000 * time.time(), b"", frame.frozen, frame.lost
        )
        number, values = self._models.number_of(frame.model), face_values(frame.face)
        self._page.show_face(FaceMessage(shown, number, frame.presence, values))

    def play(self, time_s: float, rate_hz: int, samples: Samples) -> None:
        """Play the voice, see `decoder.pipeline.decode`."""
        self._page.play(time_s, rate_hz, samples)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self._page.close()

    def _wait_for(self, index: int, sender: CallParameters) -> float:
        """Wait for the time of a source frame if the call is paced; returns that in the source."""
        time_s = index / sender.fps
        if self._start_s is None:
            self._start_s = time.monotonic() - time_s
            self._tell(f"{sender.width}x{sender.height}, {sender.fps:.4g} pictures a second")
        if self._paced:
            self._sleep_until(self._start_s + time_s)
        return time_s

    def _tell(self, text: str, over: str = "") -> None:
        self._page.tell("state", name=self._name, text=text, over=over)

    def _sleep_until(self, due_s: float) -> None:
        while not self._stop() and (left_s := due_s - time.monotonic()) > 0:
            time.sleep(min(left_s, NAP_S))


class SentView:
    """A program that shows what an encoder sends; a context manager.

    It reads the call from `stream` and decodes it as the other end does.  port: of its page.
    """

    def __init__(self, port: int) -> None:
        program = (sys.executable, "-m", "risorius", "decode", "-", "--view", "-q")
        # A group of its own: a Ctrl-C ends the encoder, and with it the stream.
        self._process = subprocess.Popen(
            [*program, "--port", str(port)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            start_new_session=True,
        )
        if hasattr(fcntl, "F_SETPIPE_SZ"):
            with suppress(OSError):
                fcntl.fcntl(self.stream, fcntl.F_SETPIPE_SZ, PIPE_BYTES)

    @property
    def stream(self) -> BinaryIO:
        """Takes the call; see `encoder.options.EncodeOptions.monitor`."""
        assert self._process.stdin is not None
        return cast(BinaryIO, self._process.stdin)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        with suppress(OSError):
            self.stream.close()
        self._process.wait()
