"""Play-out with layers between frames, before their model, or damaged."""

from dataclasses import replace

import numpy as np
import pytest
from layer_streams import (
    BASE,
    FIRST,
    ITEMS,
    KNOWN,
    LEARNED,
    PACKED,
    STREAM,
    WHOLE,
    expected,
    frames,
    learned_layers,
    pieces,
)

from decoder.playout.playout import Playout, PlayoutFrame
from protocol.errors import ProtocolError
from protocol.frames.transform_coding import parse_transform
from protocol.model_packet import ModelPacket
from protocol.packets import (
    ControlKind,
    ControlPacket,
    LayerPacket,
    parse_packet,
    serialise,
)

LAYERS = pieces(STREAM, [6, 31, 90])


def play(playout: Playout, packets: list[bytes]) -> list[tuple[PlayoutFrame, ModelPacket]]:
    found = []
    for data in packets:
        for frame in playout.receive(parse_packet(data)):
            assert playout.model is not None
            found.append((frame, playout.model))
    return found


def test_frames_are_decoded_between_layers() -> None:
    sent, layers = frames(6), list(map(serialise, LAYERS))
    mixed = [serialise(BASE), *sent[:2], *layers[:2], *sent[2:4], *layers[2:], *sent[4:]]
    played, plain = play(Playout(), mixed), play(Playout(), [serialise(BASE), *sent])
    for (one, _), (other, _) in zip(played, plain, strict=True):
        assert one.index == other.index
        np.testing.assert_array_equal(one.face.eau, other.face.eau)
        np.testing.assert_array_equal(one.face.modes, other.face.modes)
    models = [model for _, model in played]
    assert models[0] == BASE and models[-1].texture == ITEMS[0]
    assert parse_transform(models[-1].profile_data).modes == ITEMS[2:]
    # Every layer counts from the next frame on.
    assert len({model.profile_data for model in models}) > 1


def test_layers_before_their_model_are_buffered() -> None:
    playout = Playout()
    assert play(playout, [*map(serialise, LAYERS), serialise(FIRST)]) == []
    assert playout.model == expected(len(ITEMS))


def test_layers_of_an_update_wait_for_it() -> None:
    older = replace(BASE, version=2, version_count=3, texture=b"older")
    update = replace(BASE, sequence=3, call=replace(BASE.call, start_frame=1 + 2 * PACKED))
    playout = Playout()
    sent = [serialise(older), *frames(2), *map(serialise, LAYERS), serialise(update)]
    sent += [frames(3)[2], *frames(2, first=3)]
    textures = [model.texture for _, model in play(playout, sent)]
    assert textures == [b"older"] * (1 + 2 * PACKED) + [ITEMS[0]] * (1 + PACKED)
    # What comes late for a model that is no more changes nothing.
    assert play(playout, [serialise(LayerPacket(2, 0, b"\xff\xff\xff\xff"))]) == []


def following() -> ModelPacket:
    """An update in use from the third frame packet on."""
    return replace(
        BASE,
        sequence=2,
        version=BASE.version + 1,
        version_count=BASE.version_count + 1,
        call=replace(BASE.call, start_frame=1 + PACKED),
    )


def test_after_an_update_no_frame_has_coefficients_of_the_modes_before() -> None:
    """Neither a face held while it is lost, nor one between the last sample and the next."""
    update = following()
    lost = serialise(ControlPacket(0, ControlKind.FACE_LOST, 1 + PACKED))
    for control in ([lost], []):
        sent = [serialise(BASE), *frames(2), *control, serialise(update), *frames(3, first=2)]
        held = [frame for frame, model in play(Playout(), sent) if model.version == update.version]
        own = [frame for frame, _ in play(Playout(), [serialise(update), *frames(3, first=2)])]
        assert len(held) == 1 + 2 * PACKED
        for frame, alone in zip(held, own[-len(held) :], strict=True):
            modes = np.zeros(0) if control else alone.face.modes
            np.testing.assert_array_equal(frame.face.modes, modes)


def test_an_update_without_a_background_keeps_the_one_before_it() -> None:
    start = replace(BASE.call, start_frame=1 + PACKED)
    layer = BASE.version + 1
    update = replace(
        BASE, sequence=2, version=layer, version_count=layer + 1, call=start, background=b""
    )
    sent = [serialise(BASE), *frames(2), serialise(update), *frames(2, first=2)]
    shown = [model for _, model in play(Playout(), sent)]
    assert shown[-1] == replace(update, background=BASE.background)
    own = replace(update, background=b"its own")
    sent[3] = serialise(own)
    assert [model for _, model in play(Playout(), sent)][-1] == own


def test_a_late_joiner_takes_a_missing_background_from_a_later_model_packet() -> None:
    update = replace(
        BASE, version=BASE.version + 1, version_count=BASE.version_count + 1, background=b""
    )
    for later in (BASE, replace(update, background=BASE.background)):
        sent = [serialise(update), *frames(2), serialise(later), serialise(BASE)]
        shown = [model for _, model in play(Playout(), [*sent, *frames(2, first=2)])]
        assert shown[0] == update
        assert shown[-1] == replace(update, background=BASE.background)


def test_reserved_modes_take_effect_from_the_next_frame_on() -> None:
    model = replace(WHOLE, call=BASE.call, sequence=0)
    sent, playout = frames(3, model=model), Playout()
    first, second = map(serialise, learned_layers(*LEARNED))
    shown = play(playout, [serialise(model), sent[0], first, sent[1], second, sent[2]])
    modes = [parse_transform(model.profile_data).modes for _, model in shown]
    assert modes[0] == (*KNOWN, *[b""] * 3) and modes[1] == (*KNOWN, LEARNED[0], b"", b"")
    assert modes[-1] == (*KNOWN, *LEARNED, b"")
    assert all(len(frame.face.modes) == 5 for frame, _ in shown)


def test_a_damaged_layer_affects_no_frame() -> None:
    playout, sent = Playout(), frames(3)
    play(playout, [serialise(BASE), *sent[:2]])
    with pytest.raises(ProtocolError, match="bad number"):
        play(playout, [serialise(LayerPacket(BASE.version, 0, b"\xff\xff\xff\xff"))])
    assert [frame.index for frame, _ in play(playout, sent[2:])] == list(
        range(1 + PACKED, 1 + 2 * PACKED)
    )
    assert playout.model == BASE


@pytest.mark.parametrize("late", [False, True])
def test_an_update_is_activated_even_if_its_layers_are_damaged(late: bool) -> None:
    update = following()
    layer = serialise(LayerPacket(update.version, 0, b"\xff\xff\xff\xff"))
    playout = Playout()
    play(playout, [serialise(BASE), *frames(2)])
    first, second = (serialise(update), layer) if late else (layer, serialise(update))
    play(playout, [first])
    with pytest.raises(ProtocolError, match="bad number"):
        play(playout, [second])
    shown = play(playout, frames(3, first=2))
    assert [model for _, model in shown] == [update] * (1 + 2 * PACKED)


def test_a_model_is_drawn_even_if_its_first_layers_are_damaged() -> None:
    playout = Playout()
    play(playout, [serialise(LayerPacket(BASE.version, 0, b"\xff\xff\xff\xff"))])
    with pytest.raises(ProtocolError):
        play(playout, [serialise(BASE)])
    assert len(play(playout, frames(2))) == 1 + PACKED
