"""What a reader does to find records again after damage."""

import io
import sys
from types import FrameType

import pytest

from protocol import call_records
from protocol.call_records import DamagedRecord, RecordReader


def test_searches_in_a_file_of_damaged_records_take_bounded_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(call_records, "SEARCH_WORK", 16 * 1024, raising=False)
    count, calls = 300, 0
    reader = RecordReader(io.BytesIO(count * bytes([2, 0, 1])), 0)

    def note(frame: FrameType, event: str, argument: object) -> None:
        nonlocal calls
        calls += event == "call"

    sys.setprofile(note)
    try:
        for _ in range(count):
            with pytest.raises(DamagedRecord):
                reader.read()
    finally:
        sys.setprofile(None)
    assert reader.read() is None
    assert calls < 300 * count
