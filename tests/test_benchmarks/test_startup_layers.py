"""The table of a paced start: what is counted, and when it has come."""

import io

import pytest
from layer_streams import BASE, ITEMS, frames

from benchmarks.startup_layers import (
    LayeredCall,
    TableRow,
    arrival_times_s,
    markdown,
    unlayered_bytes,
)
from protocol.call_file import CallReader
from protocol.call_records import serialise_records
from protocol.packets import LayerPacket, serialise
from protocol.progressive_model import stream_item
from shared_model.errors import UserError

BITRATE = 4000.0
CALL = LayeredCall(
    serialise(BASE),
    tuple(
        serialise(LayerPacket(BASE.version, n, stream_item(data))) for n, data in enumerate(ITEMS)
    ),
    tuple(frames(4)),
)


def test_a_truncated_call_has_its_first_layers_and_all_frames() -> None:
    for count in range(len(ITEMS) + 1):
        packets = list(CallReader(io.BytesIO(CALL.truncated_to(count))))
        assert packets == [CALL.base, *CALL.layers[:count], *CALL.frames]


def test_bytes_are_those_of_the_model_in_a_call_file() -> None:
    assert CALL.bytes_until(0) == len(serialise_records([CALL.base]))
    every = len(serialise_records((CALL.base, *CALL.layers)))
    assert CALL.bytes_until(len(ITEMS)) == every
    assert CALL.model.items == ITEMS


def test_layers_arrive_one_after_the_other_and_no_faster_than_the_link() -> None:
    times = arrival_times_s(CALL, BITRATE)
    assert len(times) == 1 + len(ITEMS) and times == sorted(times)
    assert times[0] == 8 * CALL.bytes_until(0) / BITRATE
    for count, seconds in enumerate(times):
        assert seconds >= 8 * CALL.bytes_until(count) / BITRATE - 0.01


def test_a_call_without_frames_has_no_times() -> None:
    with pytest.raises(UserError, match="no frame packets"):
        arrival_times_s(LayeredCall(CALL.base, CALL.layers, ()), BITRATE)


def test_an_unlayered_model_has_the_final_pictures_only() -> None:
    coarse = len(BASE.texture) + len(BASE.background)
    assert unlayered_bytes(CALL) == len(CALL.base) - coarse + sum(map(len, ITEMS))


def test_the_table_has_a_row_for_each_number_of_layers() -> None:
    tables = {
        "a": [TableRow(0, 100, 0.5, 25.0), TableRow(5, 900, 2.0, 30.0)],
        "b": [TableRow(0, 90, 0.4, 24.0)],
    }
    lines = markdown(tables).splitlines()
    assert len(lines) == 4
    assert lines[2] == "| base layer | 100 | 0.5 | 25.0 | 90 | 0.4 | 24.0 |"
    assert lines[3].startswith("| + 3 modes | 900 | 2.0 | 30.0 |")
    assert {line.count("|") for line in lines} == {8}
