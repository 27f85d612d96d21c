"""docs/format.md: its examples and tables are those of the code and of the test vectors."""

import hashlib
import json
import re
from collections.abc import Callable
from fnmatch import fnmatch
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any

import msgpack  # type: ignore[import-untyped]
import numpy as np
import pytest
from vector_contents import VECTORS, expected, frames_of

from protocol.call_file import CallReader
from protocol.entropy.adaptive_models import AdaptiveBits, AdaptiveIntegers
from protocol.entropy.integer_codes import code_exp_golomb
from protocol.entropy.range_coder import RangeEncoder
from protocol.frames.scalar_quantiser import MAX_CODE, THESIS_TABLE
from protocol.frames.value_coding import (
    MEAN_MAGNITUDES,
    STOP_PROBABILITIES,
    ZERO_PROBABILITIES,
)
from protocol.model_packet import serialise_residual
from protocol.packets import ControlKind, PacketKind, max_packet_bytes
from protocol.picture_residual.tile_coding import (
    BAND,
    BAND_ODDS,
    CONTEXTS,
    FINE,
    FINE_ODDS,
    FLAG,
    FLAG_ODDS,
    MORE,
    MORE_ODDS,
    PLANE,
    PLANE_ODDS,
    REACH,
    REACH_ODDS,
    ZERO,
    ZERO_ODDS,
    initial_probabilities,
)
from protocol.pictures.probability_model import WEIGHT_ARRAYS, ProbabilityModels

PAGE = (Path(__file__).parents[2] / "docs" / "format.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"<!-- vector: (\S+) at (\d+) -->\n```hex\n(.*?)```", PAGE, re.DOTALL)
BYTE = re.compile(r"[0-9a-f]{2}")


def rows(heading: str) -> list[list[str]]:
    """The cells of the first table after a heading or a column's name, without its head."""
    lines = PAGE[PAGE.index(heading) :].splitlines()
    start = next(index for index, line in enumerate(lines) if line.startswith("|---"))
    cells = []
    for line in lines[start + 1 :]:
        if not line.startswith("|"):
            break
        cells.append([cell.strip().strip("`") for cell in line.strip("|").split("|")])
    return cells


def numbers(name: str) -> tuple[int, ...]:
    """The numbers of a block."""
    match = re.search(rf"<!-- table: {name} -->\n```text\n(.*?)```", PAGE, re.DOTALL)
    assert match is not None
    return tuple(map(int, match[1].split()))


def vector(name: str) -> bytes:
    return bytes.fromhex((VECTORS / name).read_text())


def coded(code: Callable[[RangeEncoder], object]) -> str:
    """The bytes of decisions, in hexadecimal digits."""
    coder = RangeEncoder()
    code(coder)
    return coder.finish().hex() or "none"


def code_bits(coder: RangeEncoder, bits: list[int], zeros: list[int]) -> None:
    for bit, zero in zip(bits, zeros, strict=True):
        coder.code_bit(bit, zero)


def code_integers(coder: RangeEncoder, values: list[int]) -> None:
    integers = AdaptiveIntegers(1)
    for value in values:
        integers.code(coder, 0, value)


def code_adaptive_bits(coder: RangeEncoder, bits: list[int]) -> None:
    contexts = AdaptiveBits(1)
    for bit in bits:
        contexts.code(coder, 0, bit)


DECISIONS: dict[str, Callable[[RangeEncoder], object]] = {
    "bits 1 0 1 with p0 = 32768 each": lambda coder: code_bits(coder, [1, 0, 1], [32768] * 3),
    "bit 1 with p0 = 65512": lambda coder: code_bits(coder, [1], [65512]),
    "20 bits 0 with p0 = 65512 each": lambda coder: code_bits(coder, [0] * 20, [65512] * 20),
    "bits 1 0 1 1 with p0 = 100, 60000, 32768, 65000": lambda coder: code_bits(
        coder, [1, 0, 1, 1], [100, 60000, 32768, 65000]
    ),
    "Exp-Golomb(14) of 3": lambda coder: code_exp_golomb(coder, 3, 14),
    "Exp-Golomb(14) of 20": lambda coder: code_exp_golomb(coder, 20, 14),
    "adaptive bits 0 0 1 0 0 0 in one context": lambda coder: code_adaptive_bits(
        coder, [0, 0, 1, 0, 0, 0]
    ),
    "adaptive integers 3, -1, 0 in one context": lambda coder: code_integers(coder, [3, -1, 0]),
    "adaptive integers 0, 0, 0, 5, -2 in one context": lambda coder: code_integers(
        coder, [0, 0, 0, 5, -2]
    ),
}


@pytest.mark.parametrize(("name", "offset", "text"), EXAMPLES)
def test_annotated_bytes_are_those_of_the_vector(name: str, offset: str, text: str) -> None:
    # Two blanks or more separate the bytes of a line from what they mean.
    digits = "".join(re.split(r"\s{2,}", line)[0] for line in text.splitlines())
    data, start = bytes.fromhex(digits), int(offset)
    assert vector(name)[start : start + len(data)] == data


def test_there_are_annotated_bytes() -> None:
    assert len(EXAMPLES) >= 6


def test_examples_of_the_range_coder_are_what_it_codes() -> None:
    found = {name: data for name, data in rows("| decisions | bytes |")}
    assert found == {name: coded(code) for name, code in DECISIONS.items()}


def test_the_example_of_a_residual_shape_is_what_is_coded() -> None:
    assert f"`{serialise_residual((1, -2, 3, 127, -128, 0)).hex()}`" in PAGE


def test_tables_of_residuals_are_those_of_the_code() -> None:
    assert numbers("zero") == ZERO_PROBABILITIES
    assert numbers("stop") == STOP_PROBABILITIES
    assert numbers("mean") == MEAN_MAGNITUDES


def test_the_table_of_the_thesis_profile_is_that_of_the_code() -> None:
    found = rows("## Thesis profile")
    assert [name for name, *_ in found] == [scale.name for scale in THESIS_TABLE]
    for scale, (_, unit, slope, reach, centre) in zip(THESIS_TABLE, found, strict=True):
        assert unit == scale.unit and float(centre) == scale.centre
        assert float(reach) == scale.range
        stated = scale.range / MAX_CODE if slope == "range / 127" else float(slope)
        assert stated == pytest.approx(scale.slope)


def test_kinds_events_and_limits_are_those_of_the_code() -> None:
    for name, bits, _, largest in rows("| kind | bits 7, 6 |"):
        kind = PacketKind[name.upper()]
        assert int(bits.replace(" ", ""), 2) == kind and int(largest) == max_packet_bytes(kind)
    assert {name: int(number) for name, number, _ in rows("| event | number |")} == {
        kind.name: kind.value for kind in ControlKind
    }


def test_keys_of_the_model_packet_are_those_of_the_vectors() -> None:
    keys = [key for key, *_ in rows("| key | value | meaning and limits |")]
    for number, _, _, last, _ in rows("| format number | profile |"):
        named = [vector(path.name) for path in VECTORS.glob("model*.hex")]
        packets = [data for data in named if data[1] == int(number)]
        assert packets
        for packet in packets:
            fields = msgpack.unpackb(packet[2:])
            assert list(fields) == keys[: keys.index(last[-1]) + 1]


def test_examples_of_frame_payloads_are_those_of_the_vectors() -> None:
    packets = json.loads((VECTORS / "frames_default.json").read_text())["packets"]
    payloads = (VECTORS / "frames_default.hex").read_text().split()
    for index, row in enumerate(rows("| payload | quality |")):
        payload, quality, intra, frames, residuals = row
        packet = packets[index]
        assert payload == payloads[index] and int(quality) == packet["quality"]
        assert bool(int(intra)) == packet["intra"] and int(frames) == len(packet["frames"])
        assert list(map(int, residuals.split())) == packet["residuals"][0][1]


def test_weights_are_those_of_the_page() -> None:
    digest = hashlib.sha256()
    shapes = {name: shape for name, *shape in rows("| network | features | classes | last |")}
    with np.load(Path(__file__).parents[2] / "protocol/data/probability_model.npz") as stored:
        for name in ProbabilityModels.__slots__:
            arrays = [stored[f"{name}_{part}"] for part in WEIGHT_ARRAYS]
            assert shapes[name] == [f"{len(array)}, {array.shape[1]}" for array in arrays]
            for array in arrays:
                digest.update(np.ascontiguousarray(array, "<i4").tobytes())
    assert digest.hexdigest() in PAGE


def test_every_vector_is_described_and_every_description_has_files() -> None:
    patterns = re.findall(r"`([a-z_*]+\.(?:hex|json|txt))`", PAGE[PAGE.index("## Test vectors") :])
    names = [path.name for path in VECTORS.iterdir()]
    assert [name for name in names if not any(fnmatch(name, each) for each in patterns)] == []
    assert [each for each in patterns if not any(fnmatch(name, each) for name in names)] == []


@pytest.mark.parametrize("name", ["call_default", "call_thesis"])
def test_calls_decode_to_what_is_stored(name: str) -> None:
    packets = list(CallReader(BytesIO(vector(f"{name}.hex"))))
    found, stored = expected(packets), json.loads((VECTORS / f"{name}.json").read_text())
    assert found["pictures"]["mask"] == stored["pictures"]["mask"]
    for picture in ("background", "texture"):
        assert found["pictures"][picture]["size"] == stored["pictures"][picture]["size"]
        np.testing.assert_allclose(
            found["pictures"][picture]["bgr"], stored["pictures"][picture]["bgr"], atol=2e-3
        )
    assert len(found["frames"]) == len(stored["frames"])
    for one, other in zip(found["frames"], stored["frames"], strict=True):
        assert_same_frame(one, other)


def test_a_call_with_layers_decodes_to_what_is_stored() -> None:
    packets = list(CallReader(BytesIO(vector("call_layers.hex"))))
    stored = json.loads((VECTORS / "call_layers.json").read_text())
    found, rows = expected(packets), "person_and_scene_and_changes"
    assert (found["layers"]["mask"], found["layers"]["fields"]) == (
        stored["layers"]["mask"],
        stored["layers"]["fields"],
    )
    for one, other in zip(found["layers"][rows], stored["layers"][rows], strict=True):
        np.testing.assert_allclose(one, other, atol=2e-3)
    for one, other in zip(found["frames"], stored["frames"], strict=True):
        assert_same_frame(one, other)
        assert len(one["layers"]) == 4


def test_a_call_with_residuals_decodes_to_what_is_stored() -> None:
    packets = list(CallReader(BytesIO(vector("call_residual.hex"))))
    stored = json.loads((VECTORS / "call_residual.json").read_text())["residuals"]
    found = expected(packets)["residuals"]
    for one, other in zip(found, stored, strict=True):
        np.testing.assert_allclose(one.pop("on_grey"), other.pop("on_grey"), atol=1)
        assert one == other and len(one["values"]) > 20


def test_contexts_of_the_residual_are_those_of_the_page() -> None:
    starts = {name: int(first) for name, first, *_ in rows("| kind of decision | first |")}
    assert starts == {
        "flag": FLAG,
        "fine": FINE,
        "plane": PLANE,
        "band": BAND,
        "reach": REACH,
        "zero": ZERO,
        "more": MORE,
    }
    terms = {name: numbers_in(text) for name, text in rows("| kind of decision | k |")}
    assert terms == {
        "flag": [*FLAG_ODDS],
        "fine": [*FINE_ODDS],
        "plane": [*PLANE_ODDS],
        "band": [*BAND_ODDS],
        "reach": [*chain.from_iterable(REACH_ODDS.values())],
        "zero": [*chain.from_iterable(ZERO_ODDS.values())],
        "more": [*chain.from_iterable(MORE_ODDS.values())],
    }
    assert len(initial_probabilities()) == CONTEXTS


def numbers_in(text: str) -> list[int]:
    return [int(number) for number in re.findall(r"-?\d+", text)]


def assert_same_frame(one: dict[str, Any], other: dict[str, Any]) -> None:
    assert (one["frame"], one["frozen"]) == (other["frame"], other["frozen"])
    for part in ("rotation", "translation_mm", "eau", "modes", "layers"):
        np.testing.assert_allclose(one.get(part, []), other.get(part, []), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("name", "reserved"), [("frames_default", 0), ("frames_reserved", 6)])
def test_frame_payloads_decode_to_what_is_stored(name: str, reserved: int) -> None:
    assert frames_of(name, reserved) == json.loads((VECTORS / f"{name}.json").read_text())
