"""Delivery over links that lose, repeat and reorder, with a clock of its own."""

import heapq
import random
from dataclasses import dataclass, field, replace

import pytest
from packets import MODEL

from protocol.link.delivery.receiver import DeliveryReceiver
from protocol.link.delivery.sender import DeliverySender
from protocol.link.interface import Arrival
from protocol.link.messages import Piece, is_message, parse_message
from protocol.model_packet import ModelPacket
from protocol.packets import (
    ControlKind,
    ControlPacket,
    FramePacket,
    LayerPacket,
    PacketKind,
    is_end,
    packet_kind,
    parse_packet,
    serialise,
)

STEP_S, PACKET_S = 0.01, 0.32
MODEL_BYTES = serialise(replace(MODEL, sequence=0, texture=bytes(6000)))
END = serialise(ControlPacket(0, ControlKind.END, 100))


def ignore_peer(session: bytes) -> None:
    """The other end's session does not matter."""


def model_version(data: bytes) -> int:
    packet = parse_packet(data)
    assert isinstance(packet, ModelPacket)
    return packet.version


def frame(number: int) -> bytes:
    return serialise(FramePacket(number % 64, number.to_bytes(4, "big")))


@dataclass
class FakeLink:
    """One call between two ends over a wire with faults; cuts: (from, to) without a wire."""

    loss: float = 0.0
    delay_s: float = 0.05
    jitter_s: float = 0.0
    duplicates: float = 0.0
    rate_bps: float = 0.0
    cuts: tuple[tuple[float, float], ...] = ()
    lossless: bool = False
    seed: int = 1
    now_s: float = 0.0
    got: list[Arrival] = field(default_factory=list)
    sent_bytes: int = 0

    def __post_init__(self) -> None:
        self.random = random.Random(self.seed)
        self.flying: list[tuple[float, int, bool, bytes]] = []
        self.count, self.free_s = 0, {True: 0.0, False: 0.0}
        self.receiver = DeliveryReceiver(b"decoder1", ignore_peer)
        self.start_encoder(b"encoder1")

    def start_encoder(self, session: bytes) -> None:
        self.sender = DeliverySender(session, self.lossless, ignore_peer)

    def run(self, seconds: float) -> None:
        end_s = self.now_s + seconds
        while self.now_s < end_s and not self.ended:
            self.now_s += STEP_S
            while self.flying and self.flying[0][0] <= self.now_s:
                at_s, _, down, payload = heapq.heappop(self.flying)
                self.arrive(down, payload, at_s)
            self.got += self.receiver.due(self.now_s)
            self.put(True, self.sender.payloads(self.now_s))
            self.put(False, self.receiver.payloads(self.now_s))

    def arrive(self, down: bool, payload: bytes, at_s: float) -> None:
        if down:
            self.got += self.receiver.receive(payload, at_s)
            self.put(False, self.receiver.payloads(at_s))
        else:
            self.sender.receive(payload, at_s)
            self.put(True, self.sender.payloads(at_s))

    def put(self, down: bool, payloads: list[bytes]) -> None:
        for payload in payloads:
            self.sent_bytes += len(payload)
            sent_s = self.now_s
            if self.rate_bps:
                begin_s = max(self.now_s, self.free_s[down])
                sent_s = self.free_s[down] = begin_s + 8 * (len(payload) + 40) / self.rate_bps
            cut = any(begin <= self.now_s < end for begin, end in self.cuts)
            for _ in range(1 + (self.random.random() < self.duplicates)):
                if cut or self.random.random() < self.loss:
                    continue
                jitter_s = self.random.uniform(-self.jitter_s, self.jitter_s)
                self.count += 1
                arrival_s = sent_s + self.delay_s + jitter_s
                heapq.heappush(self.flying, (arrival_s, self.count, down, payload))

    def call(self, frames: int, first: int = 0) -> None:
        """Send a model and frame packets, once somebody is there."""
        for _ in range(100):
            if self.sender.peers:
                break
            self.run(0.2)
        if not first:
            self.sender.send(MODEL_BYTES)
        for number in range(first, first + frames):
            self.sender.send(frame(number))
            self.run(PACKET_S)

    def end(self) -> None:
        self.sender.send(END)
        self.run(30)

    @property
    def ended(self) -> bool:
        return bool(self.got) and is_end(self.got[-1].data)

    def of_kind(self, kind: PacketKind) -> list[Arrival]:
        return [arrival for arrival in self.got if packet_kind(arrival.data) is kind]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "faults",
    [
        {},
        {"loss": 0.05},
        {"loss": 0.25},
        {"jitter_s": 0.05, "duplicates": 0.3},
        {"loss": 0.1, "delay_s": 0.3, "rate_bps": 9600},
    ],
    ids=["clean", "5 %", "25 %", "jitter", "radio"],
)
def test_all_of_a_call_arrives_once_and_with_its_numbers(
    faults: dict[str, float], seed: int
) -> None:
    link = FakeLink(seed=seed, **faults)  # type: ignore[arg-type]
    link.call(25)
    link.end()
    assert link.ended and link.got[-1].number == 25
    assert [arrival.data for arrival in link.of_kind(PacketKind.MODEL)] == [MODEL_BYTES]
    frames = link.of_kind(PacketKind.FRAME)
    assert sorted(arrival.number or 0 for arrival in frames) == list(range(25))
    assert all(arrival.data == frame(arrival.number or 0) for arrival in frames)
    assert packet_kind(link.got[0].data) is PacketKind.MODEL


def test_a_lossless_call_arrives_whole_and_in_order() -> None:
    link = FakeLink(loss=0.25, lossless=True)
    link.call(40)
    link.end()
    assert [arrival.data for arrival in link.got] == [MODEL_BYTES, *map(frame, range(40)), END]


@pytest.mark.parametrize("lossless", [False, True])
def test_numbers_that_an_encoder_leaves_out_are_not_given_to_others(lossless: bool) -> None:
    """The thesis profile sends no samples while no face is there, and its time goes on."""
    link = FakeLink(lossless=lossless)
    link.call(10)
    link.call(10, first=17)
    link.end()
    frames = link.of_kind(PacketKind.FRAME)
    assert [arrival.number for arrival in frames] == [*range(10), *range(17, 27)]
    assert all(arrival.data == frame(arrival.number or 0) for arrival in frames)
    assert link.got[-1].number == 27


def test_numbers_go_on_after_a_long_cut() -> None:
    link = FakeLink(cuts=((10, 40),))
    link.call(150)
    link.end()
    numbers = [arrival.number or 0 for arrival in link.of_kind(PacketKind.FRAME)]
    assert numbers[-1] == 149 and len(set(numbers)) == len(numbers)
    assert all(a.data == frame(a.number or 0) for a in link.of_kind(PacketKind.FRAME))


def test_after_a_short_cut_the_missing_packets_come_late() -> None:
    link = FakeLink(cuts=((8, 9.5),))
    link.call(40)
    link.end()
    numbers = [arrival.number or 0 for arrival in link.of_kind(PacketKind.FRAME)]
    assert sorted(numbers) == list(range(40))
    assert numbers != sorted(numbers)


def test_an_encoder_that_is_started_again_is_a_session_of_its_own() -> None:
    link = FakeLink()
    link.call(5)
    link.start_encoder(b"encoder2")
    link.run(4)
    link.call(5)
    link.end()
    sessions = [(a.session, a.number) for a in link.of_kind(PacketKind.FRAME)]
    assert sessions == [(s, n) for s in range(2) for n in range(5)]


def test_a_second_encoder_is_told_that_the_call_has_one() -> None:
    link = FakeLink()
    link.call(3)
    other = DeliverySender(b"encoder2", False, ignore_peer)
    link.receiver.receive(other.hello(link.now_s), link.now_s)
    for payload in link.receiver.payloads(link.now_s):
        other.receive(payload, link.now_s)
    assert other.is_busy(link.now_s) and not other.peers


def test_a_decoder_that_joins_late_gets_the_model_and_the_newest_frames() -> None:
    link = FakeLink()
    link.call(10)
    link.receiver = DeliveryReceiver(b"decoder2", ignore_peer)
    link.got.clear()
    link.call(5, first=10)
    link.end()
    assert link.got[0].data == MODEL_BYTES
    assert [arrival.number for arrival in link.of_kind(PacketKind.FRAME)][-1] == 14


def test_the_link_is_measured() -> None:
    fast, slow = FakeLink(), FakeLink(delay_s=0.3, rate_bps=9600)
    for link in (fast, slow):
        link.run(5)
    assert (fast.sender.quality.rate_bps or 0) > 64_000
    assert 5_000 < (slow.sender.quality.rate_bps or 0) < 15_000
    assert 0.6 < (slow.sender.quality.round_trip_s or 0) < 1


def test_a_decoder_that_says_good_bye_is_gone_at_once_and_a_silent_one_later() -> None:
    link = FakeLink(cuts=((6, 100),))
    link.run(5)
    assert len(link.sender.peers) == 1
    link.run(20)
    assert not link.sender.peers
    other = FakeLink()
    other.run(5)
    farewell = other.receiver.bye()
    assert farewell is not None
    other.sender.receive(farewell, other.now_s)
    assert not other.sender.peers


@pytest.mark.parametrize("faults", [{}, {"loss": 0.25}, {"rate_bps": 9600, "delay_s": 0.3}])
def test_no_frame_packet_of_an_update_comes_before_the_update(faults: dict[str, float]) -> None:
    link = FakeLink(**faults)  # type: ignore[arg-type]
    link.call(8)
    link.run(8)
    update = replace(MODEL, sequence=10, version=1, version_count=2, texture=bytes(1500))
    link.sender.send(serialise(update))
    link.call(6, first=8)
    link.end()
    order = [a.number for a in link.got if packet_kind(a.data) is PacketKind.FRAME]
    place = [a.data for a in link.got].index(serialise(update))
    before = [a.number or 0 for a in link.got[:place] if packet_kind(a.data) is PacketKind.FRAME]
    assert max(before) < 10 and sorted(n or 0 for n in order) == list(range(14))


def test_frame_packets_do_not_wait_for_ever_for_an_update() -> None:
    link = FakeLink()
    link.call(3)
    link.sender.send(serialise(replace(MODEL, sequence=3, version=1, version_count=2)))
    link.cuts = ((link.now_s - 1, link.now_s + 3.5),)
    link.call(12, first=3)
    link.end()
    assert max(a.number or 0 for a in link.of_kind(PacketKind.FRAME)) == 14


@pytest.mark.parametrize("loss", [0.0, 0.25])
@pytest.mark.parametrize("held", range(1, 6))
def test_a_model_that_gets_pictures_while_a_decoder_has_part_of_it_arrives(
    held: int, loss: float
) -> None:
    link = FakeLink()
    link.call(3)
    link.run(3)
    update = replace(MODEL, sequence=4, version=1, version_count=2, texture=bytes(2000))
    link.sender.send(serialise(replace(update, background=b"")))
    link.sender.send(serialise(LayerPacket(1, 0, bytes(400))))
    # The decoder gets some of its pieces, and then nothing until its frame packets are sent.
    for payload in link.sender.payloads(link.now_s)[:held]:
        link.got += link.receiver.receive(payload, link.now_s)
    link.loss, link.cuts = loss, ((link.now_s, link.now_s + 6),)
    link.call(20, first=3)
    link.call(40, first=23)
    link.call(40, first=63)
    models = [arrival.data for arrival in link.of_kind(PacketKind.MODEL)]
    assert [model_version(data) for data in models] == [0, 1]
    link.end()
    assert link.ended


def test_pieces_that_are_for_others_are_reported_less_and_less_often() -> None:
    link = FakeLink()
    pieces = list[bytes]()
    arrive = link.arrive

    def note(down: bool, payload: bytes, at_s: float) -> None:
        if down and is_message(payload) and isinstance(parse_message(payload), Piece):
            pieces.append(payload)
        arrive(down, payload, at_s)

    link.arrive = note  # type: ignore[method-assign]
    link.sender.send(MODEL_BYTES)
    link.run(2.0)
    assert link.of_kind(PacketKind.MODEL) and len(pieces) > 10
    reports, now_s = list[float](), link.now_s
    for count in range(200):
        link.receiver.receive(pieces[count % len(pieces)], now_s + 0.01 * count)
        if link.receiver.payloads(now_s + 0.01 * count):
            reports.append(0.01 * count)
    # At once, if the last report has been lost.
    assert reports[0] < 0.1 and len(reports) < 8
    assert reports[-1] - reports[-2] > 1.0


def test_control_packets_arrive_in_order_however_many_come_at_once() -> None:
    link = FakeLink(rate_bps=9600, delay_s=0.3, loss=0.1)
    link.call(3)
    link.sender.send(
        serialise(replace(MODEL, sequence=10, version=1, version_count=2, texture=bytes(9000)))
    )
    kinds = (ControlKind.FACE_LOST, ControlKind.FACE_FOUND)
    controls = [serialise(ControlPacket(0, kinds[n % 2], n)) for n in range(20)]
    for packet in controls:
        link.sender.send(packet)
        link.run(0.1)
    link.end()
    assert [arrival.data for arrival in link.of_kind(PacketKind.CONTROL)] == [*controls, END]


def test_pieces_stay_on_their_way_to_a_decoder_that_another_one_is_ahead_of() -> None:
    sender = DeliverySender(b"encoder1", False, ignore_peer)
    ends = [DeliveryReceiver(b"%d-decode" % number, ignore_peer) for number in range(2)]
    got = [list[bytes](), list[bytes]()]
    sender.send(MODEL_BYTES)
    for step in range(400):
        now_s = STEP_S * step
        for payload in sender.payloads(now_s):
            for number, end in enumerate(ends):
                is_piece = is_message(payload) and isinstance(parse_message(payload), Piece)
                if number == 0 or not is_piece or now_s > 1.0:
                    got[number] += [arrival.data for arrival in end.receive(payload, now_s)]
        if now_s <= 1.0:
            assert not got[1]
        for end in ends:
            for payload in end.payloads(now_s):
                sender.receive(payload, now_s)
    assert got == [[MODEL_BYTES], [MODEL_BYTES]]
