"""Feeds changed bytes to a receiver: python -m benchmarks fuzz CALL [--tries N] [--seed N]

Takes the packets of a call file, messages of a link and the file itself, changes them, and gives
them to what reads them from outside: parsers, both ends of a link, a decoder's play-out and its
pictures, the reader of call files.  Prints for each of them how many were refused and taken, the
longest that one took, and by how much the process's memory has grown.  Anything but a
`ProtocolError` or a `UserError` ends it, with the bytes that did it.
"""

import argparse
import io
import random
import resource
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from benchmarks.command import run
from benchmarks.fuzz.mutation import mutated
from decoder.playout.receiver import Receiver
from decoder.scene.decoded_model import decoded_model
from loopback.report import Cell, table
from protocol.call_file import CallReader
from protocol.errors import ProtocolError
from protocol.limits import SEQUENCE_MODULUS
from protocol.link.delivery.receiver import DeliveryReceiver
from protocol.link.delivery.sender import DeliverySender
from protocol.link.interface import Arrival
from protocol.link.messages import (
    PIECE_BYTES,
    Bye,
    Channel,
    Hello,
    Holding,
    Message,
    Piece,
    Report,
    Role,
    Span,
    parse_message,
    peer_id,
    serialise_message,
)
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, PacketKind, packet_kind, parse_packet, serialise
from shared_model.errors import UserError

ENCODER, DECODER = b"encoder1", b"decoder1"
COLUMNS = ("read by", "tries", "refused", "taken", "longest ms", "memory MB")
# Packets of a call that are changed, and the shares of all tries.
MAX_PACKETS = 60
SHARES = {
    "packet parser": 0.45,
    "message parser": 0.22,
    "decoder's end of a link": 0.15,
    "encoder's end of a link": 0.15,
    "play-out": 0.01,
    "call file": 0.015,
    "texture of a model": 0.0025,
    "background of a model": 0.0025,
}
# An end of a link gets so many payloads before the next one takes its place.
PAYLOADS = 200


@dataclass(frozen=True, slots=True)
class Found:
    """What became of the tries of one reader.  longest_s: of one try."""

    tries: int
    refused: int
    longest_s: float
    grown_mb: float


def main(argv: Sequence[str]) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        prog="fuzz", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("call", type=Path, metavar="CALL")
    parser.add_argument("--tries", type=int, default=100_000, metavar="N")
    parser.add_argument("--seed", type=int, default=1, metavar="N")
    options = parser.parse_args(argv)
    found = fuzz(options.call, options.tries, options.seed)
    print(table(COLUMNS, [_cells(name, each) for name, each in found.items()]))


def _cells(name: str, found: Found) -> list[Cell]:
    taken, longest_ms = found.tries - found.refused, f"{1000 * found.longest_s:.0f}"
    return [name, found.tries, found.refused, taken, longest_ms, f"{found.grown_mb:.1f}"]


def fuzz(call: Path, tries: int, seed: int) -> dict[str, Found]:
    """What becomes of so many changed bytes, by who reads them.  Raises whatever is no error."""
    with CallReader(call) as reader:
        packets = list(reader)[:MAX_PACKETS]
    (model, *_) = [each for each in map(parse_packet, packets) if isinstance(each, ModelPacket)]
    messages = list(_messages(packets))
    link = [*messages, *(p for p in packets if packet_kind(p) is PacketKind.FRAME)]
    readers: dict[str, tuple[Sequence[bytes], Callable[[bytes], object]]] = {
        "packet parser": (packets, parse_packet),
        "message parser": (messages, parse_message),
        "decoder's end of a link": (link, _LinkEnd(_receiving_end)),
        "encoder's end of a link": (link, _LinkEnd(partial(_sending_end, packets))),
        "play-out": (packets, lambda data: _play(serialise(model), data)),
        "call file": ([call.read_bytes()], _read_file),
        "texture of a model": ([model.texture], lambda data: _draw(model, texture=data)),
        "background of a model": ([model.background], lambda data: _draw(model, background=data)),
    }
    source = random.Random(seed)
    return {
        name: _try(source, samples, read, round(SHARES[name] * tries))
        for name, (samples, read) in readers.items()
    }


def _try(
    source: random.Random, samples: Sequence[bytes], read: Callable[[bytes], object], tries: int
) -> Found:
    refused, longest_s, before = 0, 0.0, _memory_mb()
    for _ in range(tries):
        data, began_s = mutated(source, samples), time.thread_time()
        try:
            read(data)
        except (ProtocolError, UserError):
            refused += 1
        except Exception as error:
            error.add_note(f"bytes: {data.hex()}")
            raise
        longest_s = max(longest_s, time.thread_time() - began_s)
    return Found(tries, refused, longest_s, _memory_mb() - before)


def _memory_mb() -> float:
    """The most that the process has had so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _messages(packets: Sequence[bytes]) -> list[bytes]:
    """Messages of both ends, as they occur."""
    longest = max(packets, key=len)
    pieces = [
        Piece(channel, item, 7, len(longest), i, longest[PIECE_BYTES * i :][:PIECE_BYTES])
        for channel in Channel
        for item in range(2)
        for i in range(-(-len(longest) // PIECE_BYTES))
    ]
    spans = {"frames": 300, "ordered": Span(2, 3), "unordered": Span(0, 5)}
    holdings = (Holding(Channel.UNORDERED, 4, 5), Holding(Channel.ORDERED, 1, 1))
    others: list[Message] = [
        Hello(Role.ENCODER, ENCODER, DECODER, True, False, 7, 3, **spans),  # type: ignore[arg-type]
        Hello(Role.DECODER, DECODER, ENCODER, True, False, 9, 7),
        Report(peer_id(DECODER), 13, 300, 3, 0, holdings, (295, 297)),
        Bye(Role.DECODER, peer_id(DECODER)),
    ]
    return [serialise_message(each) for each in [*others, *others, *pieces]]


class _LinkEnd:
    """An end of a link that has met the other one, again and again a new one.

    make: the end at a time, seconds.
    """

    def __init__(self, make: Callable[[float], DeliveryReceiver | DeliverySender]) -> None:
        self._make, self._count, self._now_s = make, 0, 0.0
        self._end = make(self._now_s)

    def __call__(self, data: bytes) -> None:
        self._count += 1
        self._now_s += 0.05
        if self._count % PAYLOADS == 0:
            self._end = self._make(self._now_s)
        try:
            self._end.receive(data, self._now_s)
        finally:
            if isinstance(self._end, DeliveryReceiver):
                self._end.due(self._now_s)
            self._end.payloads(self._now_s)


def _receiving_end(now_s: float) -> DeliveryReceiver:
    """A decoder's end."""
    end = DeliveryReceiver(DECODER, lambda session: None)
    end.receive(serialise_message(Hello(Role.ENCODER, ENCODER, DECODER)), now_s)
    return end


def _sending_end(packets: Sequence[bytes], now_s: float) -> DeliverySender:
    """An encoder's end that sends a call."""
    end = DeliverySender(ENCODER, False, lambda session: None)
    end.receive(serialise_message(Hello(Role.DECODER, DECODER, ENCODER)), now_s)
    for packet in packets:
        end.send(packet)
    return end


def _play(model: bytes, data: bytes) -> None:
    receiver = Receiver()
    is_frame = isinstance(parse_packet(data), FramePacket)
    number = data[0] % SEQUENCE_MODULUS if is_frame else None
    for arrival in (Arrival(model, 0.0, 0, 0), Arrival(data, 0.1, 0, number)):
        receiver.receive(arrival)


def _read_file(data: bytes) -> None:
    errors = list[ProtocolError]()
    receiver = Receiver(on_damage=errors.append)
    with CallReader(io.BytesIO(data)) as reader:
        for packet in reader.undamaged(errors.append):
            receiver.receive(Arrival(packet, 0.0))
    if errors:
        raise errors[0]


def _draw(model: ModelPacket, **pictures: bytes) -> None:
    try:
        changed = replace(model, **pictures)  # type: ignore[arg-type]
    except ValueError as error:
        raise ProtocolError(str(error)) from error
    decoded_model(changed)


if __name__ == "__main__":
    run(main)
