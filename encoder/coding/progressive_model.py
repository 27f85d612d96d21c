"""Progressive transmission of a model: a base layer, then refining layers between frame packets."""

from dataclasses import dataclass, replace
from typing import Any

from numpy.typing import NDArray

from encoder.coding.background import Background
from encoder.picture_coding.image_budget import encode_picture_within
from protocol.frames.transform_coding import parse_transform, serialise_transform
from protocol.model_packet import ModelPacket
from protocol.packets import serialise
from protocol.pictures.probability_model import TEXTURE

# The most bytes of a base layer, and the share of its picture bytes that the texture takes.  The
# base layer of an update is sent last, after its other layers: its pictures are never shown.
BASE_LAYER_BYTES, UPDATE_BASE_LAYER_BYTES = 2000, 1200
TEXTURE_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class LayeredModel:
    """A model packet split for progressive transmission.

    base: the base layer.  items: of the refining layers, see `protocol.progressive_model`.
    """

    base: ModelPacket
    items: tuple[bytes, ...]


def split_into_layers(
    model: ModelPacket,
    mean: NDArray[Any],
    background: Background,
    base_bytes: int = BASE_LAYER_BYTES,
) -> LayeredModel:
    """Split a model packet of the default profile.

    mean: (n, n, 3) BGR 0..255, the decoded texture.  background: of the packet, which need not have
        it yet.
    base_bytes: of the base layer, unless geometry and tables alone are larger.
    """
    transform = parse_transform(model.profile_data)
    without_modes = replace(transform, modes=(b"",) * len(transform.modes))
    draft = replace(
        model,
        texture=b"",
        background=b"",
        profile_data=serialise_transform(without_modes),
        progressive=True,
    )
    # Byte strings beyond 255 have one more byte of length than empty ones.
    free_bytes = max(0, base_bytes - len(serialise(draft)) - 2)
    texture_bytes, texture = int(TEXTURE_SHARE * free_bytes), model.texture
    if not 0 < len(texture) <= texture_bytes:
        coarse_texture, _ = encode_picture_within(mean, texture_bytes, kind=TEXTURE)
        texture = _smaller(texture, coarse_texture)
    coarse_background = _smaller(
        model.background, background.encode_rough(free_bytes - len(texture))
    )
    base = replace(draft, texture=texture, background=coarse_background)
    pictures = ((model.texture, texture), (model.background, coarse_background))
    # An empty item keeps the picture of the base layer.
    items = [b"" if coarse == picture else picture for picture, coarse in pictures]
    modes = transform.modes[: len(transform.modes) - transform.reserved_modes]
    return LayeredModel(base, (*items, *modes))


def _smaller(picture: bytes, coarse: bytes) -> bytes:
    return picture if 0 < len(picture) <= len(coarse) else coarse
