"""The speech of a call over a lossy link: in its place whatever the order, and after a restart."""

from collections.abc import Iterator
from dataclasses import replace

import pytest
from layer_streams import BASE, PACKED, frames

from benchmarks.simulated_link import SentPacket, SimulatedLink, arrivals
from decoder.playout.receiver import Receiver
from encoder.sound.voice_packer import VoicePacker
from protocol.link.interface import Arrival
from protocol.model_packet import ModelPacket
from protocol.packets import ControlKind, ControlPacket, FramePacket, parse_packet, serialise
from protocol.voice.voice_block import SPEECH_FRAMES_PER_SECOND

COUNT = 10
PACKET_S = PACKED / BASE.call.fps
FRAMES = 1 + (COUNT - 1) * PACKED


class Syllables:
    """A `SpeechSource` that is silent now and then; each frame says its number."""

    voice = "1200"

    def __init__(self) -> None:
        self._next = 0

    def take(self, end: int) -> list[bytes | None]:
        taken = [spoken(k) for k in range(self._next, end)]
        self._next = max(self._next, end)
        return taken


def spoken(number: int) -> bytes | None:
    return None if number % 23 > 17 else (2 * number).to_bytes(6)


def sent() -> list[SentPacket]:
    """The call as an encoder sends it, with the rest of its speech after the last face."""
    packer = VoicePacker(Syllables())
    first = replace(BASE, version=0, version_count=1)
    found = [SentPacket(serialise(packer.model(first)), 0.0, 0)]
    for number, data in enumerate(frames(COUNT, model=first)):
        packet = parse_packet(data)
        assert isinstance(packet, FramePacket)
        voiced = serialise(packer.packet(number, packet.payload))
        found.append(SentPacket(voiced, number * PACKET_S, number))
    rest = packer.last_packets(FRAMES + 4 * PACKED)
    end = serialise(ControlPacket(0, ControlKind.END, FRAMES))
    for number, each in enumerate(rest, COUNT):
        found.append(SentPacket(serialise(each), COUNT * PACKET_S, number))
    return [*found, SentPacket(end, COUNT * PACKET_S, COUNT + len(rest))]


def play(playout: Receiver, arriving: Iterator[Arrival]) -> int:
    """The number of pictures shown."""
    shown = 0
    for arrival in arriving:
        while (due_s := playout.release_s) is not None and due_s < arrival.time_s:
            shown += len(playout.poll(due_s))
        shown += len(playout.receive(arrival))
    return shown


def heard(playout: Receiver, first: int, end: int) -> list[bytes | None]:
    """Speech frames of the call; None: silent.  All must have been received."""
    found = [playout.speech.get(k) for k in range(first, end)]
    assert None not in found
    return [frame or None for frame in found]


@pytest.mark.parametrize("seed", range(3))
def test_speech_is_in_its_place_whatever_the_order_of_packets(seed: int) -> None:
    link = SimulatedLink(loss=0.2, jitter_s=0.3, duplicates=0.2)
    playout = Receiver()
    assert play(playout, iter(arrivals(sent(), link, seed))) == FRAMES
    count = SPEECH_FRAMES_PER_SECOND * FRAMES // round(BASE.call.fps)
    assert heard(playout, 0, count) == [spoken(k) for k in range(count)]


def test_packets_before_their_model_keep_their_speech() -> None:
    playout = Receiver()
    model, *packets = sent()
    early = [Arrival(each.data, each.sent_s, 0, each.number) for each in packets[:3]]
    assert play(playout, iter(early)) == 0
    assert play(playout, iter([Arrival(model.data, 1.0, 0, 0)])) == 1 + 2 * PACKED
    assert heard(playout, 0, 12) == [spoken(k) for k in range(12)]


def test_the_end_after_the_rest_of_the_speech_is_not_waited_for() -> None:
    playout = Receiver()
    assert play(playout, iter(arrivals(sent(), SimulatedLink(), 0))) == FRAMES
    assert playout.ended and playout.counts.lost == 0


def test_a_restarted_encoder_goes_on_speaking_where_the_call_would_be() -> None:
    playout = Receiver()
    again_s = 8.0
    order = [Arrival(e.data, e.sent_s, 0, e.number) for e in sent()[:6]]
    order += [Arrival(e.data, again_s + e.sent_s, 1, e.number) for e in sent()[:6]]
    play(playout, iter(order))
    first = round(again_s * SPEECH_FRAMES_PER_SECOND)
    assert heard(playout, 5, 15) == [spoken(k) for k in range(5, 15)]
    assert heard(playout, first, first + 18) == [spoken(k) for k in range(18)]
    assert playout.speech.known_until >= first + 18
    playout.speech.drop_before(first + 5)
    assert playout.speech.get(first + 4) is None and playout.speech.get(first + 5)


def test_a_restarted_encoder_with_another_codec_is_silent() -> None:
    playout = Receiver()
    order = [Arrival(e.data, e.sent_s, 0, e.number) for e in sent()[:4]]
    play(playout, iter(order))
    model = parse_packet(sent()[0].data)
    assert isinstance(model, ModelPacket)
    silent = serialise(replace(model, call=replace(model.call, voice="off")))
    packets = frames(2, model=replace(BASE, version=0, version_count=1))
    again = [Arrival(silent, 3.0, 1, 0)]
    again += [Arrival(data, 3.0 + k * PACKET_S, 1, k) for k, data in enumerate(packets)]
    assert play(playout, iter(again)) > 0
    assert playout.speech.get(3 * SPEECH_FRAMES_PER_SECOND + 1) is None


def test_speech_that_nobody_takes_is_forgotten() -> None:
    playout = Receiver(kept_speech_s=1)
    assert play(playout, iter(arrivals(sent(), SimulatedLink(), 0))) == FRAMES
    count = SPEECH_FRAMES_PER_SECOND * FRAMES // round(BASE.call.fps)
    kept = [k for k in range(count) if playout.speech.get(k) is not None]
    assert kept == list(range(count - SPEECH_FRAMES_PER_SECOND, count))


def test_the_last_words_before_a_pause_are_kept_until_it_ends() -> None:
    playout = Receiver(kept_speech_s=0)
    spoken_until = 3
    for each in sent()[: 1 + spoken_until]:
        play(playout, iter([Arrival(each.data, each.sent_s, 0, each.number)]))
    known = playout.speech.known_until
    assert playout.speech.get(known - 1) is None
    later = [Arrival(each.data, each.sent_s, 0, each.number) for each in sent()[-1:]]
    play(playout, iter(later))
    assert playout.speech.known_until == known
    assert playout.speech.get(known) == (spoken(known) or b"")


@pytest.mark.parametrize("is_numbered", [False, True], ids=["file", "link"])
def test_the_bytes_of_the_voice_are_counted_of_files_and_links(is_numbered: bool) -> None:
    playout, packets = Receiver(), sent()
    numbers = [each.number if is_numbered else None for each in packets]
    play(playout, (Arrival(p.data, p.sent_s, 0, n) for p, n in zip(packets, numbers, strict=True)))
    payloads = [
        each.data[1:] for each in packets if isinstance(parse_packet(each.data), FramePacket)
    ]
    silent = sum(len(data) - 1 for data in frames(COUNT, model=BASE))
    assert playout.counts.frame_bytes == sum(map(len, payloads))
    assert playout.counts.frame_bytes - playout.counts.voice_bytes == silent
