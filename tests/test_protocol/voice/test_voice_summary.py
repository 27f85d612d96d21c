"""The summary of a call file tells its voice from its faces."""

from dataclasses import replace
from pathlib import Path

import pytest
from packets import CALL, MODEL

from protocol.call_file import CallWriter
from protocol.packets import ControlKind, ControlPacket, FramePacket, Packet, serialise
from protocol.summary import CallSummary, summarise
from protocol.voice.voice_block import VoiceBlock, join_payload

FACE = bytes([128] * 10)
SPOKEN = VoiceBlock((b"abc0", b"def@"))


def summary_of(path: Path, voice: str, payloads: list[bytes]) -> CallSummary:
    model = replace(MODEL, call=replace(CALL, voice=voice), sequence=0)
    frames = [FramePacket(number, payload) for number, payload in enumerate(payloads)]
    packets: list[Packet] = [model, *frames, ControlPacket(0, ControlKind.END, 9)]
    with CallWriter(path) as sink:
        for packet in packets:
            sink.send(serialise(packet))
    return summarise(path)


def test_a_summary_tells_the_voice_from_the_faces(tmp_path: Path) -> None:
    alone = replace(SPOKEN, has_face=False)
    payloads = [
        join_payload("700C", SPOKEN, FACE),
        join_payload("700C", VoiceBlock(), FACE),
        join_payload("700C", alone, b""),
    ]
    found = summary_of(tmp_path / "voice.rzo", "700C", payloads)
    silent = summary_of(tmp_path / "silent.rzo", "off", [FACE, FACE])
    assert (found.voice, silent.voice) == ("700C", "off")
    assert (found.voice_bytes, silent.voice_bytes) == (8 + 1 + 8, 0)
    assert found.frame_packets == silent.frame_packets == 2
    assert found.frame_bytes == silent.frame_bytes == 20
    assert found.frame_bps == silent.frame_bps
    assert found.record_bps == pytest.approx(silent.record_bps)
    assert found.voice_bps == pytest.approx(8 * 17 * found.frame_bps / (8 * 20))
    parts = found.model_bytes, found.frame_bytes, found.voice_bytes, found.control_bytes
    assert sum(parts) + found.container_bytes == found.file_bytes


def test_a_voice_block_that_is_damaged_is_a_damaged_packet(tmp_path: Path) -> None:
    payloads = [join_payload("700C", SPOKEN, FACE), b"\x08a"]
    found = summary_of(tmp_path / "call.rzo", "700C", payloads)
    assert (found.damaged_packets, found.frame_packets) == (1, 1)
