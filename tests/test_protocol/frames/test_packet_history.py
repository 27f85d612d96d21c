"""Packets that come late are decoded after all, and those after them again."""

import numpy as np
from predicted_frames import NOMINAL_FRAMES, packets, predictor

from protocol.frames.packet_history import KEPT_PACKETS, PacketHistory


def test_a_late_packet_makes_those_after_it_exact_again() -> None:
    call = packets(4, KEPT_PACKETS + 3)
    history, missing = PacketHistory(predictor(), NOMINAL_FRAMES), 2
    for number, (_, payload, frames) in enumerate(call[: missing + 2]):
        if number != missing:
            found = history.decode(number, payload)
            assert np.array_equal(found, frames) == (number < missing)
    newest = history.insert(missing, call[missing][1])
    assert newest is not None and np.array_equal(newest, call[missing + 1][2])
    assert history.insert(missing, call[missing][1]) is None
    for number, (_, payload, frames) in enumerate(call[missing + 2 :], start=missing + 2):
        assert np.array_equal(history.decode(number, payload), frames)
    # Packets older than those that are kept come too late.
    assert history.insert(0, call[0][1]) is None
