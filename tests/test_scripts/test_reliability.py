"""The measurement of calls over a bad wire: what it sends, and what it makes of the logs."""

from pathlib import Path

import pytest
from layer_streams import write_call

from loopback.bad_wire import Faults
from loopback.network_namespace import obstacle
from loopback.simulated_link import sent_packets
from protocol.packets import is_end
from scripts.reliability.__main__ import make_call, measure
from scripts.reliability.ends import lengthened
from scripts.reliability.figures import back_after_s, percentile, ways_ms
from scripts.reliability.rows import Row

COUNT = 8


@pytest.fixture(scope="module")
def call(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("calls") / "call.rzo"
    write_call(path, COUNT)
    return path


def test_a_lengthened_call_goes_on_with_its_numbers(call: Path) -> None:
    sent = sent_packets(call)
    assert list(lengthened(sent, 0.0)) == sent
    longer = list(lengthened(sent, 10.0))
    numbers = [each.number or 0 for each in longer[1:-1]]
    assert numbers == list(range(len(numbers))) and longer[-2].sent_s >= 10.0
    assert [each.data[0] % 64 for each in longer[1:-1]] == [n % 64 for n in numbers]
    assert is_end(longer[-1].data)


def test_times_and_returns_are_read_from_the_logs() -> None:
    packet = "0000"
    sender = [{"what": "sent", "t": float(n), "number": n} for n in range(4)]
    receiver = [
        {"what": "came", "t": n + 0.1, "number": n, "session": 0, "data": packet} for n in (0, 2, 3)
    ]
    ways = ways_ms(sender, receiver)
    assert ways[1] is None and ways[0] == pytest.approx(100)
    assert percentile(ways, 0.5) == pytest.approx(100) and percentile(ways, 0.95) == float("inf")
    assert back_after_s(receiver, 0.5) == pytest.approx(1.6)
    again = [{**receiver[0], "t": 5.0, "session": 1}]
    assert back_after_s([*receiver, *again], 4.0) == pytest.approx(1.0)


@pytest.mark.skipif(obstacle() is not None, reason=f"no wire: {obstacle()}")
def test_a_short_call_is_measured(call: Path, tmp_path: Path) -> None:
    row = Row("lossy", Faults(loss=0.05, delay_ms=20), least_s=2.5)
    figures = measure(row, call, Path("none.mkv"), tmp_path, make_call(row, call, tmp_path, 1), [])
    assert figures["exit_codes"] == [0, 0]
    assert None not in figures["ways_ms"] and len(figures["ways_ms"]) >= COUNT
    assert min(figures["ways_ms"]) >= 20
