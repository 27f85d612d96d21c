"""A serial line between two devices of this host: two pseudo-terminals, and what joins them."""

import os
import select
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Thread


@contextmanager
def serial_line(damage: bytes | None = None) -> Iterator[tuple[str, str]]:
    """The paths of two devices; what is written to one can be read from the other.

    damage: comes first out of the second, as if from somewhere else.
    """
    pairs = [os.openpty() for _ in range(2)]
    for ours, theirs in pairs:
        tty.setraw(ours)
        tty.setraw(theirs)
    stop, wake = os.pipe()
    first, second = pairs[0][0], pairs[1][0]

    def join() -> None:
        if damage:
            os.write(second, damage)
        with suppress(OSError):
            while True:
                ready, _, _ = select.select([first, second, stop], [], [])
                if stop in ready:
                    return
                for one, other in ((first, second), (second, first)):
                    if one in ready:
                        os.write(other, os.read(one, 4096))

    thread = Thread(target=join, daemon=True)
    thread.start()
    try:
        yield os.ttyname(pairs[0][1]), os.ttyname(pairs[1][1])
    finally:
        os.write(wake, b"x")
        thread.join()
        for descriptor in (*pairs[0], *pairs[1], stop, wake):
            os.close(descriptor)
