"""When the packets of a call arrive over a link that loses some and repeats them, in seconds."""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from decoder.playout.playout import Playout
from decoder.sound.voice_separator import VoiceSeparator
from protocol.call_file import CallReader
from protocol.errors import ProtocolError
from protocol.limits import SEQUENCE_MODULUS
from protocol.link.interface import Arrival
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, parse_packet

# When a receiver asks for a packet after the time at which it was expected, how often it asks
# again, and when it gives up.
ASK_S, ASK_AGAIN_S, GIVE_UP_S = 0.06, 0.13, 2.0


@dataclass(frozen=True, slots=True)
class SimulatedLink:
    """What a link does to frame packets; all other packets are delivered.

    loss: share of the packets that are lost, each way; burst: mean number lost in a row.
    delay_s: one way; jitter_s: more, at most; duplicates: share of the packets that come twice.
    repeats: lost packets are asked for and sent again.
    """

    loss: float = 0.0
    burst: float = 1.0
    delay_s: float = 0.05
    jitter_s: float = 0.0
    duplicates: float = 0.0
    repeats: bool = True


@dataclass(frozen=True, slots=True)
class SentPacket:
    """A packet, when it is sent, and its number as in `Arrival`."""

    data: bytes
    sent_s: float
    number: int | None


def sent_packets(path: Path) -> list[SentPacket]:
    """The packets of a call file, as a live encoder sends them.  Raises `UserError`."""
    playout, voice = Playout(), VoiceSeparator()
    sent, now_s, number = list[SentPacket](), 0.0, 0
    with CallReader(path) as reader:
        for data in reader.undamaged(_fail):
            packet = parse_packet(data)
            face = voice.receive(packet)
            if face is not None:
                playout.receive(face)
            if isinstance(packet, FramePacket):
                # One without a face has a number like all others.
                following = number + (packet.sequence - number) % SEQUENCE_MODULUS + 1
                number = following if face is None else playout.next_number
                now_s = playout.time_s(number - 1)
                sent.append(SentPacket(data, now_s, number - 1))
            else:
                first = packet.sequence if isinstance(packet, ModelPacket) else number
                ahead = (first - number) % SEQUENCE_MODULUS
                sent.append(SentPacket(data, now_s, number + ahead))
    return sent


def _fail(error: ProtocolError) -> None:
    raise error


def arrivals(sent: Sequence[SentPacket], link: SimulatedLink, seed: int) -> list[Arrival]:
    """The arrivals in order of time; the same seed loses the same packets."""
    source = random.Random(seed)
    losses = _losses(link, source)
    found = list[Arrival]()
    for each in sent:
        is_frame = isinstance(parse_packet(each.data), FramePacket)
        for arrival_s in _times(each.sent_s, link, is_frame and next(losses), source):
            found.append(Arrival(each.data, arrival_s, 0, each.number))
    return sorted(found, key=lambda arrival: arrival.time_s)


def _losses(link: SimulatedLink, source: random.Random) -> Iterator[bool]:
    """Gilbert's model: whether each packet is lost."""
    is_lost = source.random() < link.loss
    while True:
        yield is_lost
        ends = 1 / link.burst
        begins = link.loss * ends / (1 - link.loss)
        if link.burst <= 1:
            is_lost = source.random() < link.loss
        elif is_lost:
            is_lost = source.random() >= ends
        else:
            is_lost = source.random() < begins


def _times(
    sent_s: float, link: SimulatedLink, is_lost: bool, source: random.Random
) -> Iterator[float]:
    """When a packet arrives: never, once or twice."""
    arrival_s = sent_s + link.delay_s + source.random() * link.jitter_s
    if not is_lost:
        yield arrival_s
        if source.random() < link.duplicates:
            yield arrival_s + source.random() * link.jitter_s
        return
    asked_s = ASK_S
    while link.repeats and asked_s < GIVE_UP_S:
        if source.random() >= link.loss and source.random() >= link.loss:
            yield arrival_s + asked_s + 2 * link.delay_s
            return
        asked_s += ASK_AGAIN_S
