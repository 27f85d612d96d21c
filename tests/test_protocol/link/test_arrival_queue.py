"""What waits to be taken: frame packets may be left out, nothing else is."""

import pytest
from links import END, MODEL_BYTES, frame

from protocol.link.delivery import arrival_queue
from protocol.link.delivery.arrival_queue import ARRIVAL_OVERHEAD_BYTES, ArrivalQueue
from protocol.link.delivery.receiver import DeliveryReceiver
from protocol.link.interface import Arrival
from shared_model.errors import UserError

FRAME = Arrival(frame(0), 0.0)
ROOM = 10 * (len(FRAME.data) + ARRIVAL_OVERHEAD_BYTES)


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Room for ten frame packets, and as much again for what may not be left out."""
    monkeypatch.setattr(arrival_queue, "MAX_FRAME_BYTES", ROOM)
    monkeypatch.setattr(arrival_queue, "MAX_BYTES", 2 * ROOM)


def queue_of(repeats_frames: bool) -> ArrivalQueue:
    delivery = DeliveryReceiver(bytes(8), lambda session: None)
    delivery.repeats_frames = repeats_frames
    return ArrivalQueue(delivery)


def taken(queue: ArrivalQueue) -> list[bytes]:
    found = list[bytes]()
    while (arrival := queue.take(0.0)) is not None:
        found.append(arrival.data)
    return found


def test_what_is_not_taken_leaves_frames_out_but_no_model_and_no_end() -> None:
    queue = queue_of(repeats_frames=False)
    for _ in range(12):
        queue.put(FRAME)
    for packet in (MODEL_BYTES, END):
        queue.put(Arrival(packet, 0.0))
    assert taken(queue) == [FRAME.data] * 10 + [MODEL_BYTES, END]
    queue.put(FRAME)
    assert taken(queue) == [FRAME.data], "there is room again"


def test_what_has_been_acknowledged_ends_the_link_when_too_much_waits() -> None:
    queue = queue_of(repeats_frames=True)
    for _ in range(20):
        queue.put(FRAME)
    with pytest.raises(UserError, match="this end is too slow") as caught:
        queue.put(FRAME)
    assert caught.value.exit_code == 4
    assert len(taken(queue)) == 20
