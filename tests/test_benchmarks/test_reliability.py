"""The measurement of calls over a bad wire: what it sends, and what it makes of the logs."""

from pathlib import Path
from tempfile import mkdtemp

import cv2
import numpy as np
import pytest
from layer_streams import write_call
from processes import until

from benchmarks.bad_wire.network_namespace import obstacle
from benchmarks.bad_wire.wire import Faults
from benchmarks.reliability.__main__ import make_call, measure
from benchmarks.reliability.clips import CODEC, long_enough
from benchmarks.reliability.figures import back_after_s, percentile, ways_ms
from benchmarks.reliability.rows import Row
from benchmarks.reliability.tables import markdown_lines, replaced
from encoder.capture.video_source import open_source

COUNT = 8


@pytest.fixture(scope="module")
def call(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("calls") / "call.rzo"
    write_call(path, COUNT)
    return path


def test_a_clip_that_is_too_short_goes_forwards_and_backwards(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    pictures = list(rng.integers(0, 256, (4, 48, 64, 3), np.uint8))
    codec = cv2.VideoWriter.fourcc(*CODEC)
    writer = cv2.VideoWriter(str(tmp_path / "clip.mkv"), codec, 25, (64, 48))
    for picture in pictures:
        writer.write(picture)
    writer.release()
    assert long_enough(tmp_path / "clip.mkv", 4 / 25, tmp_path) == tmp_path / "clip.mkv"
    with open_source(str(long_enough(tmp_path / "clip.mkv", 0.4, tmp_path))) as capture:
        found = [picture for _, picture in capture]
    order = [0, 1, 2, 3, 2, 1, 0, 1, 2, 3]
    assert np.array_equal(found, [pictures[number] for number in order])


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
    row = Row("lossy", Faults(loss=0.05, delay_ms=20), sframe=True)
    ways_ms: list[float | None] = [None]

    def measure_one() -> None:
        nonlocal ways_ms
        logs = Path(mkdtemp(dir=tmp_path))
        figures = measure(row, call, None, logs, make_call(row, call, logs, 1), {})
        assert figures["exit_codes"] == [0, 0]
        ways_ms = figures["ways_ms"]
        assert len(ways_ms) == COUNT and any(ways_ms)
        assert min(filter(None, ways_ms)) >= 20

    # Ends that a busy host does not serve for seconds give a lost packet up.
    until(lambda: None not in ways_ms, measure_one)


def test_measured_rows_go_into_the_table_of_their_clip() -> None:
    page = "\n".join(
        [
            "one (25 frames a second):",
            *("", "| link | s |", "|---|---|", "| slow | 1 |", "| fast | 2 |", ""),
            "two (30 frames a second):",
            *("", "| link | s |", "|---|---|", "| slow | 3 |", "", "| column | |"),
        ]
    )
    lines = markdown_lines([["slow", 4], ["cut", None]])
    found = replaced(page, "two", lines).split("\n")
    assert found[:11] == page.split("\n")[:11]
    assert found[11:] == ["| slow | 4 |", "| cut | - |", "", "| column | |"]
    with pytest.raises(ValueError, match="no table of three"):
        replaced(page, "three", lines)
