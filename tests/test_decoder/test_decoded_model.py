"""Models are decoded beside the frames: each once, with what is known of those before."""

from collections.abc import Callable
from dataclasses import replace
from threading import Event, Timer
from typing import Any, cast

import pytest
from layer_streams import FIRST, WHOLE, learned_layers

from decoder.playout.received_models import ReceivedModels
from decoder.scene.decoded_model import KEPT_MODELS, DecodedModel, ModelLoader
from protocol.errors import ProtocolError
from protocol.model_packet import ModelPacket
from protocol.progressive_model import LayerBuffer

GiveWay = Callable[[], None]


def decoded_of(model: ModelPacket) -> DecodedModel:
    """Parts with nothing but the model."""
    nothing = cast(Any, None)
    return DecodedModel(model, nothing, nothing, nothing, nothing, nothing, nothing)


def with_a_mode(model: ModelPacket) -> ModelPacket:
    layers = LayerBuffer()
    for layer in learned_layers(b"mode"):
        layers.add(replace(layer, model_version=model.version))
    return layers.apply(model)


def update_of(model: ModelPacket, number: int = 1) -> ModelPacket:
    """The update `number` of a model."""
    version = model.version + number
    return replace(model, version=version, version_count=version + 1)


def test_each_model_is_decoded_once_after_the_newest_that_is_the_same() -> None:
    asked = list[tuple[ModelPacket, ModelPacket | None]]()

    def load(model: ModelPacket, before: DecodedModel | None, give_way: GiveWay) -> DecodedModel:
        asked.append((model, before.model if before else None))
        return decoded_of(model)

    call = replace(WHOLE.call, width=2 * WHOLE.call.width)
    longer, other = with_a_mode(WHOLE), replace(WHOLE, call=call)
    loader = ModelLoader(load)
    try:
        for model in (WHOLE, other, longer, WHOLE, longer):
            loader.request(model)
        assert [loader.get(model).model for model in (WHOLE, longer, other)] == [
            WHOLE,
            longer,
            other,
        ]
    finally:
        loader.close()
    assert [sum(model is each for model, _ in asked) for each in (WHOLE, longer, other)] == [1] * 3
    assert asked[0] == (WHOLE, None) and (longer, WHOLE) in asked


def test_the_model_in_use_is_kept_however_many_are_asked_for() -> None:
    asked = list[ModelPacket]()

    def load(model: ModelPacket, before: DecodedModel | None, give_way: GiveWay) -> DecodedModel:
        asked.append(model)
        return decoded_of(model)

    following = [update_of(WHOLE, number) for number in range(1, 3 * KEPT_MODELS)]
    loader = ModelLoader(load)
    try:
        for model in (WHOLE, *following):
            # Models that are decoded all at once, late, would each be newer than the one in use.
            loader.get(model)
            assert loader.get(WHOLE).model is WHOLE
        assert loader.get(following[-1]).model is following[-1]
    finally:
        loader.close()
    assert asked == [WHOLE, *following]


def test_further_layers_do_not_wait_for_another_model() -> None:
    has_more, update = Event(), update_of(WHOLE)

    def load(model: ModelPacket, before: DecodedModel | None, give_way: GiveWay) -> DecodedModel:
        if model.version == update.version:
            assert has_more.wait(60)
        return decoded_of(model)

    loader = ModelLoader(load)
    try:
        loader.get(WHOLE)
        following = loader.request(update)
        more_of_update = loader.request(with_a_mode(update))
        longer = with_a_mode(WHOLE)
        assert loader.get(longer).model is longer
        assert not following.done() and not more_of_update.done()
        has_more.set()
        assert more_of_update.result().model.version == update.version
        assert following.done()
    finally:
        has_more.set()
        loader.close()


def test_layers_do_not_wait_for_a_model_asked_for_before_them() -> None:
    """Those of a model that is decoded already."""
    may_begin, may_go_on = Event(), Event()
    update, longer = update_of(WHOLE), with_a_mode(WHOLE)

    def load(model: ModelPacket, before: DecodedModel | None, give_way: GiveWay) -> DecodedModel:
        assert (may_go_on if model is update else may_begin).wait(60)
        return decoded_of(model)

    loader = ModelLoader(load)
    try:
        whole, following, layers = map(loader.request, (WHOLE, update, longer))
        may_begin.set()
        assert whole.result().model is WHOLE and layers.result().model is longer
        assert not following.done()
        may_go_on.set()
        assert following.result().model is update
    finally:
        may_begin.set()
        may_go_on.set()
        loader.close()


def test_a_loader_that_is_closed_begins_nothing_more(caplog: pytest.LogCaptureFixture) -> None:
    has_begun, asked = Event(), list[ModelPacket]()

    def load(model: ModelPacket, before: DecodedModel | None, give_way: GiveWay) -> DecodedModel:
        asked.append(model)
        has_begun.set()
        assert is_closing.wait(60)
        return decoded_of(model)

    loader, is_closing = ModelLoader(load), Event()
    for model in (WHOLE, update_of(WHOLE), with_a_mode(WHOLE)):
        loader.request(model)
    assert has_begun.wait(60)
    Timer(0.1, is_closing.set).start()
    loader.close()
    assert asked == [WHOLE] and not caplog.records


def test_a_model_that_follows_gives_way_to_further_layers() -> None:
    is_asked, may_end, update = Event(), Event(), update_of(WHOLE)
    done = list[ModelPacket]()

    def load(model: ModelPacket, before: DecodedModel | None, give_way: GiveWay) -> DecodedModel:
        if model is update:
            assert is_asked.wait(60)
            give_way()
        elif model is longer:
            assert may_end.wait(60)
        done.append(model)
        return decoded_of(model)

    longer, loader = with_a_mode(WHOLE), ModelLoader(load)
    try:
        loader.get(WHOLE)
        following, layers = loader.request(update), loader.request(longer)
        is_asked.set()
        with pytest.raises(TimeoutError):
            following.result(0.1)
        may_end.set()
        assert layers.result().model is longer and following.result().model is update
    finally:
        is_asked.set()
        may_end.set()
        loader.close()
    assert done == [WHOLE, longer, update]


def test_a_model_that_others_wait_to_build_on_is_kept() -> None:
    asked, may_go_on, update = list[tuple[int, bool]](), Event(), update_of(WHOLE)

    def load(model: ModelPacket, before: DecodedModel | None, give_way: GiveWay) -> DecodedModel:
        asked.append((model.version, before is not None and before.model.version == model.version))
        assert may_go_on.wait(60)
        return decoded_of(model)

    loader = ModelLoader(load)
    try:
        # The same update, each time with other pictures of the model before.
        waiting = [loader.request(replace(update)) for _ in range(2 * KEPT_MODELS)]
        may_go_on.set()
        assert waiting[-1].result().model.version == update.version
    finally:
        may_go_on.set()
        loader.close()
    assert asked == [(update.version, False), *[(update.version, True)] * (2 * KEPT_MODELS - 1)]


def test_a_model_that_cannot_be_drawn_is_told_to_who_asks_and_left_out() -> None:
    def load(model: ModelPacket, before: DecodedModel | None, give_way: GiveWay) -> DecodedModel:
        if model is FIRST:
            raise ProtocolError("damaged")
        assert before is None
        return decoded_of(model)

    loader = ModelLoader(load)
    try:
        loader.request(FIRST)
        assert loader.get(WHOLE).model is WHOLE
        with pytest.raises(ProtocolError, match="damaged"):
            loader.get(FIRST)
    finally:
        loader.close()


def test_the_model_of_an_update_is_known_before_its_first_frame() -> None:
    versions, update = ReceivedModels(), replace(update_of(WHOLE), background=b"")
    versions.receive_model(WHOLE, 0)
    assert versions.next_model is None
    versions.receive_model(update, 3)
    following = versions.next_model
    assert following is not None and following.version == update.version
    assert following.background == WHOLE.background and following is versions.next_model
    versions.activate()
    assert versions.current is not None and versions.current.model is following
    assert versions.next_model is None
