"""Every byte of a call is accounted for, and put down to the parameters that it moved."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from packets import CALL, MODEL

from encoder.coding.rate_control import RateTarget, code_call
from encoder.coding.rdo_quantiser import code_packet
from protocol.bit_accounting import (
    DAMAGED,
    GROUPS,
    OVERHEAD,
    BitAccounting,
    component_bits,
    group_shares,
)
from protocol.call_file import MAGIC, CallWriter
from protocol.call_records import serialise_records
from protocol.errors import ProtocolError
from protocol.frames.frame_transform import (
    GEOMETRY_SIZE,
    UNIT_CODE_OF_ONE,
    FrameTransform,
    with_reserved_modes,
)
from protocol.frames.temporal_prediction import PREDICTION_KINDS, FramePredictor
from protocol.frames.transform_coding import serialise_transform
from protocol.limits import MAX_IMAGE_BYTES, MAX_LAYER_BYTES
from protocol.model_packet import ModelPacket
from protocol.packets import ControlKind, ControlPacket, FramePacket, LayerPacket, Packet, serialise
from protocol.progressive_model import stream_item
from protocol.summary import summarise
from risorius.commands.info import summary_table
from shared_model.parameters import EAU_INDEX

DEFAULT = replace(CALL, profile="default", frames_per_packet=8)
FRAMES = 81
# What each component moves: pose, a lid, a mode.
MOVED = (0, 6 + EAU_INDEX["lid_left"], GEOMETRY_SIZE)


def components() -> FrameTransform:
    d = GEOMETRY_SIZE + 1
    basis = np.zeros((len(MOVED), d), np.int8)
    basis[np.arange(len(MOVED)), MOVED] = 127
    return FrameTransform(
        (b"mode",),
        np.full(d, UNIT_CODE_OF_ONE, np.uint8),
        np.zeros(d, np.int64),
        basis,
        np.zeros(len(MOVED), np.int8),
        np.full((len(MOVED), PREDICTION_KINDS), 28, np.uint8),
    )


FIRST = replace(MODEL, call=DEFAULT, sequence=0, profile_data=serialise_transform(components()))


def extensible_call() -> tuple[ModelPacket, list[bytes]]:
    """A model with two spare modes, and frame packets that begin to use the first of them."""
    roomy = with_reserved_modes(components(), 2)
    predictor, sent = FramePredictor(roomy.scale_codes, roomy.reserved_modes), []
    values = np.random.default_rng(3).normal(size=(8, 8, len(roomy.basis))) * 4
    values[:4, :, -2] = values[..., -1] = 0
    for number, frames in enumerate(values):
        packet = code_packet(predictor, number, 8, frames, 4)
        predictor.anchor = packet.frames[-1]
        sent.append(packet.payload)
    extension = serialise_transform(roomy)
    return replace(MODEL, call=DEFAULT, sequence=0, extensible=True, profile_data=extension), sent


def payloads(sizes: tuple[float, ...]) -> list[bytes]:
    """Frame packets of components that wander by the given sizes, units a frame."""
    rng = np.random.default_rng(3)
    values = np.cumsum(rng.normal(size=(FRAMES, len(MOVED))) * sizes, axis=0)
    packets = code_call(values, components().scale_codes, RateTarget(4000, 25, 8))
    return [packet.payload for packet in packets]


def accounts(frames: list[bytes]) -> BitAccounting:
    accounts = BitAccounting()
    accounts.add(FIRST)
    for number, payload in enumerate(frames):
        accounts.add(FramePacket(number % 64, payload))
    return accounts


def test_groups_add_up_to_the_frame_packets() -> None:
    sent = payloads((3.0, 1.0, 1.0))
    groups = accounts(sent).groups
    assert sum(groups.values()) == pytest.approx(sum(map(len, sent)))
    assert set(groups) == {*GROUPS, OVERHEAD}
    assert min(groups.values()) >= 0


@pytest.mark.parametrize(("moving", "group"), [*enumerate(("pose", "lids", "modes"))])
def test_bits_go_to_the_group_that_moves(moving: int, group: str) -> None:
    sizes = np.full(len(MOVED), 0.05)
    sizes[moving] = 4.0
    groups = accounts(payloads(tuple(sizes))).groups
    assert max(groups, key=lambda name: groups[name]) == group
    assert groups["expression"] == groups["gaze"] == 0


def test_ideal_lengths_are_those_spent() -> None:
    predictor, spent = FramePredictor(components().scale_codes), 0.0
    sent = payloads((3.0, 1.0, 1.0))
    for number, payload in enumerate(sent):
        spent += component_bits(predictor, number % 64, 8, payload).sum()
    total = 8 * sum(map(len, sent))
    # Five bits of quality and half a byte lost to rounding in each packet.
    assert total - 12 * len(sent) < spent < total


def test_a_component_is_shared_by_harm() -> None:
    mixed = components()
    mixed.basis[0, :] = 0
    mixed.basis[0, 0], mixed.basis[0, GEOMETRY_SIZE] = 60, 120
    shares = group_shares(mixed)
    assert shares.sum(1) == pytest.approx(1)
    shares_of = dict(zip(GROUPS, shares[0].tolist(), strict=True))
    assert shares_of == pytest.approx(dict.fromkeys(GROUPS, 0) | {"pose": 0.2, "modes": 0.8})


def test_an_update_of_the_model_is_read_from_its_own_packet_on() -> None:
    sent = payloads((3.0, 1.0, 1.0))
    update = replace(FIRST, version=1, version_count=2, sequence=len(sent))
    whole = BitAccounting()
    whole.add(FIRST)
    for number, payload in enumerate(sent[:-1]):
        whole.add(FramePacket(number, payload))
    # Told a packet ahead, and once more for those who join late.
    whole.add(update)
    whole.add(FramePacket(len(sent) - 1, sent[-1]))
    for number, payload in enumerate(sent, len(sent)):
        whole.add(FramePacket(number % 64, payload))
        whole.add(update)
    once = accounts(sent).groups
    assert whole.groups == pytest.approx({name: 2 * count for name, count in once.items()})


def test_frames_from_the_middle_are_read_with_their_own_model() -> None:
    """The first has number 40 of its model, which an update follows from 50 on."""
    found = BitAccounting()
    found.add(FIRST)
    found.add(ControlPacket(0, ControlKind.JOINED, 313))
    other = replace(components(), scale_codes=np.zeros((len(MOVED), PREDICTION_KINDS), np.uint8))
    update = replace(FIRST, sequence=50, version=1, version_count=2)
    found.add(replace(update, profile_data=serialise_transform(other)))
    found.add(FramePacket(42, payloads((3.0, 1.0, 1.0))[0]))
    assert DAMAGED not in found.groups and found.groups["pose"] > 0


def test_parts_of_the_model_add_up() -> None:
    packet = replace(MODEL, call=DEFAULT, profile_data=serialise_transform(components()))
    parts = accounts([]).model_parts
    assert sum(parts.values()) == len(serialise(packet)) - 1
    assert (parts["background"], parts["modes"]) == (len(MODEL.background), len(b"mode"))


def test_layers_are_counted_by_item() -> None:
    packet = replace(MODEL, call=DEFAULT, profile_data=serialise_transform(components()))
    found = BitAccounting()
    found.add(replace(packet, progressive=True))
    before = found.model_parts
    stream = stream_item(b"texture") + stream_item(b"still") + stream_item(b"mode one")
    layers = [LayerPacket(0, 0, stream[:10]), LayerPacket(0, 1, stream[10:])]
    for layer in layers:
        found.add(layer)
    parts = {name: count - before[name] for name, count in found.model_parts.items()}
    assert (parts["texture"], parts["background"], parts["modes"]) == (7, 5, 8)
    assert sum(parts.values()) == sum(len(serialise(layer)) - 1 for layer in layers)


def test_reserved_modes_in_layers_are_counted_as_modes() -> None:
    model, _ = extensible_call()
    found = BitAccounting()
    found.add(model)
    before = found.model_parts
    layers = [
        LayerPacket(0, 0, stream_item(b"") * 2 + stream_item(b"learned")),
        LayerPacket(0, 1, stream_item(b"more")),
    ]
    for layer in layers:
        found.add(layer)
    parts = {name: count - before[name] for name, count in found.model_parts.items()}
    assert (parts["modes"], parts["texture"], parts["background"]) == (11, 0, 0)
    assert sum(parts.values()) == sum(len(serialise(layer)) - 1 for layer in layers)


def test_frames_are_parsed_with_and_without_unused_components() -> None:
    model, sent = extensible_call()
    halves = []
    found = BitAccounting()
    found.add(model)
    for number, payload in enumerate(sent):
        found.add(FramePacket(number, payload))
        if number % 4 == 3:
            halves.append(found.groups)
    assert DAMAGED not in halves[1] and sum(halves[1].values()) == pytest.approx(
        sum(map(len, sent))
    )
    # One mode at first, then two that move as much.
    assert halves[1]["modes"] > 2.5 * halves[0]["modes"]


def test_layers_alone_are_counted_and_damaged_ones_refused() -> None:
    found = BitAccounting()
    found.add(LayerPacket(0, 0, b"\x05ab"))
    assert found.model_parts == {"shape": 2, "texture": 2}
    with pytest.raises(ProtocolError):
        found.add(LayerPacket(1, 0, b"\xff\xff\xff\xff"))


def test_packets_before_damaged_layers_are_counted(tmp_path: Path) -> None:
    model = replace(
        MODEL, call=DEFAULT, profile_data=serialise_transform(components()), progressive=True
    )
    pieces = [b"\x05ab", b"\xff" * 9, b"cde"]
    packets: list[Packet] = [model, *(LayerPacket(0, i, data) for i, data in enumerate(pieces))]
    packets += [replace(model, version=1, version_count=2), FramePacket(0, bytes(4))]
    path = tmp_path / "call.rzo"
    path.write_bytes(MAGIC + serialise_records(serialise(packet) for packet in packets))
    summary = summarise(path)
    assert summary.damaged_packets == 2 and summary.model_packets == 2
    assert sum(summary.model_parts.values()) == summary.model_bytes
    assert sum(summary.groups.values()) == pytest.approx(summary.frame_bytes) == 4


def test_layers_of_any_number_of_updates_are_counted() -> None:
    packet = replace(MODEL, call=DEFAULT, profile_data=serialise_transform(components()))
    found, sizes = BitAccounting(), 0
    stream = stream_item(bytes(MAX_IMAGE_BYTES)) + stream_item(bytes(7)) + stream_item(b"mode one")
    pieces = [stream[i : i + MAX_LAYER_BYTES] for i in range(0, len(stream), MAX_LAYER_BYTES)]
    for model in range(5):
        packets: list[Packet] = [LayerPacket(model, i, data) for i, data in enumerate(pieces)]
        packets.insert(3, replace(packet, version=model, version_count=model + 1, progressive=True))
        for one in packets:
            found.add(one)
            sizes += len(serialise(one)) - 1
    parts = found.model_parts
    assert parts["texture"] == 5 * (len(MODEL.texture) + MAX_IMAGE_BYTES)
    assert parts["modes"] == 5 * (len(b"mode") + len(b"mode one"))
    assert sum(parts.values()) == sizes


def test_sizes_of_packets_are_stated() -> None:
    size = accounts([bytes(n) for n in (1, 2, 3, 10)]).packet_size
    assert size is not None
    assert (size.mean, size.largest) == (4, 10) and 3 < size.p95 < 10
    assert BitAccounting().packet_size is None


def test_packets_that_cannot_be_decoded_are_damaged() -> None:
    no_model = BitAccounting()
    no_model.add(FramePacket(0, bytes(7)))
    assert no_model.groups == {DAMAGED: 7}
    no_components = BitAccounting()
    no_components.add(replace(MODEL, call=DEFAULT))
    no_components.add(FramePacket(0, bytes(5)))
    assert no_components.groups == {DAMAGED: 5}
    assert accounts([bytes(1000)]).groups == {DAMAGED: 1000}


def test_a_damaged_transform_is_a_protocol_error() -> None:
    with pytest.raises(ProtocolError, match="transform"):
        BitAccounting().add(replace(MODEL, profile_data=b"?"))


def test_a_summary_splits_a_call_of_the_default_profile(tmp_path: Path) -> None:
    path, sent = tmp_path / "call.rzo", payloads((3.0, 1.0, 1.0))
    with CallWriter(path) as writer:
        writer.send(serialise(FIRST))
        for number, payload in enumerate(sent):
            writer.send(serialise(FramePacket(number % 64, payload)))
        writer.send(serialise(ControlPacket(0, ControlKind.END, FRAMES)))
    summary = summarise(path)
    assert sum(summary.groups.values()) == pytest.approx(summary.frame_bytes)
    assert sum(summary.group_bits.values()) == pytest.approx(8 * summary.frame_bytes / FRAMES)
    assert sum(summary.model_parts.values()) == summary.model_bytes
    text = summary_table(summary)
    assert all(f"\n{group} " in text for group in (*GROUPS, OVERHEAD))


def test_the_thesis_profile_spends_a_byte_on_each_value() -> None:
    thesis = BitAccounting()
    thesis.add(MODEL)
    thesis.add(FramePacket(0, bytes(10)))
    assert thesis.groups == {"pose": 6, "expression": 4}
    with_lids = BitAccounting()
    with_lids.add(replace(MODEL, call=replace(CALL, has_eyelids=True)))
    with_lids.add(FramePacket(0, bytes(12)))
    assert with_lids.groups == pytest.approx({"pose": 6, "expression": 4, "lids": 2})
