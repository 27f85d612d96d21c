"""Compiles the decoder's loops at once, for an image or a machine that will decode."""

from contextlib import suppress

import numpy as np

from decoder.rendering.edge_strips import VERTEX_FLOATS, edge_strips, edges_of
from decoder.rendering.texture_colour import LocalColours
from protocol.errors import ProtocolError
from protocol.picture_residual.inverse_transform import ResidualPictures
from protocol.picture_residual.residual_block import (
    ResidualTiles,
    parse_tiles,
    tile_grid,
    tile_side,
)
from protocol.picture_residual.tile_coding import values_of_tile
from shared_model.surround import head_with_surround

# Width and height of the picture, side of the atlas, and frames that loops are compiled with.
SIZE, ATLAS_SIDE, FRAMES = (32, 16), 32, 2


def compile_loops() -> None:
    """Compile the loops of what is drawn, or load them where that has been done."""
    width, height = SIZE
    head = head_with_surround()
    mesh = edges_of(head)
    shown = np.zeros((len(head.vertices), 4), np.float32)
    strips = np.zeros((len(mesh.edges), 4, VERTEX_FLOATS), np.float32)
    edge_strips(np.eye(4), SIZE, head.vertices, mesh, shown, 0.5, strips)
    grey = np.full((ATLAS_SIDE, ATLAS_SIDE, 3), 128, np.uint8)
    LocalColours(grey).texture(np.zeros(grey.size, np.float32))
    with suppress(ProtocolError):
        parse_tiles(bytes(8), width, height, FRAMES)
    grid = tile_grid(width, height)
    values = np.ones((*grid, FRAMES, values_of_tile(tile_side(width, height))), np.int16)
    tiles = ResidualTiles(0, np.ones(grid, np.uint8), values)
    picture, face = np.zeros((height, width, 3), np.uint8), np.zeros((height, width), np.float32)
    ResidualPictures.from_tiles(tiles).add_to(picture, 0, face)
