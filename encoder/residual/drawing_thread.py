"""Draws a live call in a thread, packet by packet as they are seen.

What a packet says of the model is decoded as soon as it is seen, before a picture needs it.
"""

from contextlib import closing
from io import BytesIO
from threading import Condition, Thread

from encoder.residual.draw_call import DrawCall
from protocol.call_file import MAGIC
from protocol.call_records import RecordWriter
from protocol.picture_residual.drawn_picture import DrawnPicture
from shared_model.errors import UserError


class DrawingThread:
    """The pictures of a call whose packets come one by one.

    draw: runs in the thread; its stream waits for packets that have not been seen.
    """

    def __init__(self, draw: DrawCall) -> None:
        self._draw, self._records = draw, RecordWriter()
        self._changed = Condition()
        self._stream = _GrowingStream(self._changed)
        self._stream.append(MAGIC)
        # The frames that `pictures` waits for, and the first that it may be asked for later.
        self._wanted, self._first_wanted = range(0), 0
        self._drawn = dict[int, DrawnPicture]()
        self._error: Exception | None = None
        self._has_ended = False
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def see(self, packet: bytes, first_wanted: int = 0) -> None:
        """Take the next packet of the call.

        first_wanted: no picture of an earlier frame will be asked for.
        """
        with self._changed:
            self._first_wanted = max(self._first_wanted, first_wanted)
            self._stream.append(self._records.record(packet))

    def pictures(self, wanted: range) -> list[DrawnPicture]:
        """The pictures of frames that the packets seen so far have; waits for them.

        Raises `UserError` if they cannot be drawn.
        """
        with self._changed:
            self._wanted = wanted
            self._changed.notify_all()
            try:
                self._changed.wait_for(lambda: self._is_whole() or self._is_stuck())
            finally:
                self._wanted = range(0)
            if self._error is not None:
                raise self._error
            found = [self._drawn[index] for index in wanted if index in self._drawn]
            self._drawn = {i: each for i, each in self._drawn.items() if i >= wanted.stop}
        if len(found) < len(wanted):
            raise UserError("the call cannot be drawn as far as it is known")
        return found

    def close(self) -> None:
        """Free what draws."""
        self._stream.end()
        self._thread.join()

    def _is_whole(self) -> bool:
        return all(index in self._drawn for index in self._wanted)

    def _is_stuck(self) -> bool:
        """Whether nothing is drawn until further packets are seen, if ever."""
        return self._has_ended or self._stream.is_starved

    def _wants(self, index: int) -> bool:
        """Whether to draw a frame; waits until somebody asks for it or nobody can."""
        with self._changed:
            # Those after the wanted ones, which a packet about the face may have brought, are
            # drawn, too: the picture of the frame before is there only then.
            self._changed.wait_for(
                lambda: self._wanted or index < self._first_wanted or self._stream.has_ended
            )
            is_asked_for = bool(self._wanted) and index >= self._wanted.start
            return is_asked_for and not self._stream.has_ended

    def _run(self) -> None:
        try:
            with closing(self._draw(self._stream, self._wants)) as drawn:
                for each in drawn:
                    with self._changed:
                        self._drawn[each.index] = each
                        self._changed.notify_all()
        except Exception as error:  # for whoever asks for pictures
            self._error = error
        finally:
            with self._changed:
                self._has_ended = True
                self._changed.notify_all()


class _GrowingStream(BytesIO):
    """Holds what has been appended and not been read; whoever reads waits for more.

    changed: held, and told, whenever it changes.
    is_starved: somebody waits for more.  has_ended: nothing more is read.
    """

    def __init__(self, changed: Condition) -> None:
        super().__init__()
        self._changed = changed
        self.is_starved = self.has_ended = False

    def append(self, data: bytes) -> None:
        """Add to its end."""
        with self._changed:
            rest = super().read()
            self.seek(0)
            self.truncate()
            self.write(rest + data)
            self.seek(0)
            self.is_starved = False
            self._changed.notify_all()

    def end(self) -> None:
        """Let whoever reads find its end."""
        with self._changed:
            self.has_ended = True
            self._changed.notify_all()

    def read(self, size: int | None = -1, /) -> bytes:
        """As of a pipe: what is there, as soon as there is something."""
        with self._changed:
            while not self.has_ended:
                if data := super().read(size):
                    return data
                self.is_starved = True
                self._changed.notify_all()
                self._changed.wait_for(lambda: not self.is_starved or self.has_ended)
            return b""
