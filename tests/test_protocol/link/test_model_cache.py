"""The cache for late joiners has the models in use and to come."""

from dataclasses import replace

from packets import MODEL

from decoder.playout.playout import Playout
from protocol.frames.scalar_quantiser import sent_eaus
from protocol.link.delivery.model_cache import ModelCache
from protocol.packets import (
    ControlKind,
    ControlPacket,
    FramePacket,
    LayerPacket,
    parse_packet,
    serialise,
)


def model(layer: int, sequence: int, background: bytes = MODEL.background) -> bytes:
    numbered = replace(MODEL, version=layer, version_count=layer + 1, sequence=sequence)
    return serialise(replace(numbered, background=background))


def layer(of: int, number: int) -> bytes:
    return serialise(LayerPacket(of, number, b"piece"))


def frame(number: int) -> bytes:
    return serialise(
        FramePacket(number % 64, bytes([123] * (6 + len(sent_eaus(with_eyelids=False)))))
    )


def cached(packets: list[bytes]) -> tuple[bytes, ...]:
    found = ModelCache()
    for packet in packets:
        found.on_sent(packet)
    return found.packets


def test_the_first_model_is_cached_with_its_layers() -> None:
    control = serialise(ControlPacket(0, ControlKind.FACE_LOST, 3))
    sent = [model(0, 0), frame(0), layer(0, 0), control, frame(1), layer(0, 1)]
    assert cached([*sent, *map(frame, range(2, 70))]) == (sent[0], sent[2], sent[5])


def test_an_update_is_cached_with_the_model_in_use_until_it_is_activated() -> None:
    first, early, update, late = model(0, 0), layer(1, 0), model(1, 4), layer(1, 1)
    sent = [first, frame(0), early, update, frame(1), late, frame(2), frame(3)]
    assert cached(sent) == (first, early, update, late)
    assert cached([*sent, frame(4)]) == (early, update, late)
    assert cached([*sent, *map(frame, range(4, 140))]) == (early, update, late)


def test_an_update_without_a_background_gets_the_one_before_once_it_is_in_use() -> None:
    bare, grown = model(1, 2, b""), layer(1, 0)
    sent = [model(0, 0, b"still"), frame(0), bare, grown, frame(1)]
    assert bare in cached(sent)
    sent += [frame(2), model(2, 4, b"")]
    assert cached(sent) == (model(1, 2, b"still"), grown, model(2, 4, b""))
    assert cached([*sent, frame(3), frame(4)]) == (model(2, 4, b"still"),)
    newer = [*sent, frame(3), frame(4), model(3, 6, b"newer"), *map(frame, (5, 6))]
    assert cached(newer) == (model(3, 6, b"newer"),)
    assert cached([*newer, model(4, 8, b""), frame(7), frame(8)]) == (model(4, 8, b"newer"),)


def test_a_late_joiner_decodes_every_frame_by_the_newest_model() -> None:
    sent = [model(0, 0), *map(frame, range(8)), model(1, 10), *map(frame, range(8, 72))]
    sent += [model(2, 75 % 64), *map(frame, range(72, 100))]
    playout, shown = Playout(), set[int]()
    for packet in (*cached(sent), frame(100), frame(101), frame(102)):
        for _ in playout.receive(parse_packet(packet)):
            assert playout.model is not None
            shown.add(playout.model.version)
    assert shown == {2}
