"""The queue between network and decoder."""

from dataclasses import replace

from packets import MODEL

from protocol.link.receive_queue import MAX_WAITING_FRAMES, QUEUE_OVERHEAD_BYTES, ReceiveQueue
from protocol.packets import FramePacket, LayerPacket, serialise

MODEL_BYTES = serialise(MODEL)


def frame(number: int) -> bytes:
    """A frame packet that says which it is."""
    return serialise(FramePacket(number % 64, number.to_bytes(10, "big")))


def taken(queue: ReceiveQueue) -> list[bytes]:
    """All that is in the queue."""
    return list(iter(lambda: queue.take(0), None))


def test_the_model_comes_before_frames_that_were_there_first() -> None:
    arrivals = ReceiveQueue()
    for number in range(3):
        arrivals.put(frame(number))
    assert taken(arrivals) == []
    arrivals.put(MODEL_BYTES)
    arrivals.put(frame(3))
    assert taken(arrivals) == [MODEL_BYTES, *map(frame, range(4))]


def test_only_the_newest_frames_wait() -> None:
    arrivals = ReceiveQueue()
    for number in range(MAX_WAITING_FRAMES + 7):
        arrivals.put(frame(number))
    arrivals.put(MODEL_BYTES)
    assert taken(arrivals) == [MODEL_BYTES, *map(frame, range(7, MAX_WAITING_FRAMES + 7))]


def test_the_same_model_is_handed_out_once() -> None:
    arrivals = ReceiveQueue()
    other = serialise(replace(MODEL, sequence=6))
    for packet in (MODEL_BYTES, MODEL_BYTES, other, MODEL_BYTES):
        arrivals.put(packet)
    assert taken(arrivals) == [MODEL_BYTES, other]


def test_layers_neither_wait_for_the_model_nor_release_frames() -> None:
    arrivals, layer = ReceiveQueue(), serialise(LayerPacket(0, 3, b"piece"))
    for packet in (frame(0), layer, MODEL_BYTES, layer):
        arrivals.put(packet)
    assert taken(arrivals) == [layer, MODEL_BYTES, frame(0), layer]


def test_the_queue_does_not_grow_beyond_its_limit() -> None:
    arrivals = ReceiveQueue(limit_bytes=len(MODEL_BYTES) + 10 * (11 + QUEUE_OVERHEAD_BYTES))
    arrivals.put(MODEL_BYTES)
    for number in range(100):
        arrivals.put(frame(number))
    held = taken(arrivals)
    assert held == [MODEL_BYTES, *map(frame, range(9))]
    arrivals.put(frame(100))
    assert taken(arrivals) == [frame(100)]


def test_an_empty_packet_is_passed_on_for_the_parser_to_refuse() -> None:
    arrivals = ReceiveQueue()
    arrivals.put(MODEL_BYTES)
    arrivals.put(b"")
    assert taken(arrivals) == [MODEL_BYTES, b""]


def test_waking_makes_a_wait_return() -> None:
    arrivals = ReceiveQueue()
    arrivals.wake()
    assert arrivals.take(None) is None
