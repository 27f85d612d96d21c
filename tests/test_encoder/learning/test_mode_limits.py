"""How modes of a live call follow the bytes that its models may have."""

import pytest

from encoder.learning.incremental_modes import USUAL_LIMITS
from protocol.limits import MAX_LAYER_BYTES


def test_more_bytes_make_more_and_finer_modes_fewer_change_nothing() -> None:
    threefold = USUAL_LIMITS.scaled(3)
    hundred_kb = USUAL_LIMITS.scaled(9.94)
    assert hundred_kb.mode_bytes < MAX_LAYER_BYTES
    assert threefold.bytes_per_s == pytest.approx(3.95 * USUAL_LIMITS.bytes_per_s, rel=0.01)
    assert threefold.mode_bytes == pytest.approx(3.95 * USUAL_LIMITS.mode_bytes, rel=0.01)
    # Eight steps of the quantiser are an octave.
    assert USUAL_LIMITS.step - threefold.step == pytest.approx(11.9, abs=0.05)
    assert threefold.least_share == pytest.approx(USUAL_LIMITS.least_share / 3.95, rel=0.01)
    assert USUAL_LIMITS.scaled(1) == USUAL_LIMITS.scaled(0.5) == USUAL_LIMITS
