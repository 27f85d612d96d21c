"""Pictures of the model packet as wavelet coefficients: textures, appearance modes, the still.

Biorthogonal 9/7 wavelets (Cohen, Daubechies & Feauveau 1992) by lifting, one step for all
subbands, and adaptive contexts: the size of a coefficient is foretold by its neighbours, by its
parent in the next coarser subband, and by the same place in the pictures coded before.  The last is
what an image codec lacks: all modes of a face are busy at the eyes and the mouth.

Integers come out of the bytes the same on any machine.  The transform back is floating point: it
makes colours, nothing that is predicted from.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from protocol.adaptive import AdaptiveBits, AdaptiveIntegers
from protocol.entropy import WHOLE, RangeDecoder, RangeEncoder
from protocol.messages import ProtocolError
from protocol.values import BitCoder

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Rows = list[list[int]]

LEVELS = 5
# Lifting steps of the 9/7 wavelets, and the gain that makes them nearly orthonormal.
_LIFT = (-1.586134342059924, -0.052980118572961, 0.882911075530934, 0.443506852043971)
_GAIN = 1.149604398860241
# A coefficient rounds down from this share of a step on; what is not zero lies nearer to it.
_ROUND_UP = 0.36
_TOWARDS_ZERO = 0.06

# Coefficients are coded in tiles, so that a flag tells of many that nothing happens.
TILE = 4
# Classes of a size: half octaves.
_CLASS = (0, 2, 3, 4, 4, 5, 5, 6, 6, 6, 6, 7)
_CLASSES = 8
_MOST_RUN = 8
_LARGE = 16
_UNLIKELY, _RARE = WHOLE * 7 // 10, WHOLE * 8 // 10


class SubbandCoder:
    """Codes pictures of one kind one after the other; each teaches the contexts of the next."""

    def __init__(self) -> None:
        self._tiles = AdaptiveBits(LEVELS * 2 * 3 * _CLASSES * 3, _RARE)
        self._nonzero = AdaptiveBits(_CLASSES * 4 * 3, _UNLIKELY)
        self._greater = AdaptiveBits(_MOST_RUN * _CLASSES * 3, _UNLIKELY)
        self._excess = AdaptiveIntegers(1)
        self._coarse = AdaptiveIntegers(2)
        self._before: dict[tuple[int, int, int], Integers] = {}

    def encode(self, planes: Sequence[Array], step: float) -> tuple[bytes, list[Array]]:
        """The bytes of planes (h, w) each, and what they decode to.  step: > 0, of the planes."""
        coder, decoded = RangeEncoder(), []
        for index, plane in enumerate(planes):
            coarse, details = transform(plane, LEVELS)
            pyramid = (
                np.rint(coarse / step).astype(np.int64),
                [[_quantised(band, step) for band in level] for level in details],
            )
            self._code_plane(coder, index, *pyramid)
            decoded.append(_restored(*pyramid, step))
        return coder.finish(), decoded

    def decode(self, data: bytes, shapes: Sequence[tuple[int, int]], step: float) -> list[Array]:
        """The planes of `shapes` that `data` holds.  Raises `ProtocolError` if it holds none."""
        coder, decoded = RangeDecoder(data), []
        try:
            for index, shape in enumerate(shapes):
                empty = transform(np.zeros(shape), LEVELS)
                coarse, details = (
                    empty[0].astype(np.int64),
                    [[band.astype(np.int64) for band in level] for level in empty[1]],
                )
                self._code_plane(coder, index, coarse, details)
                decoded.append(_restored(coarse, details, step))
        except ValueError as error:
            raise ProtocolError(f"picture: {error}") from error
        if coder.surplus:
            raise ProtocolError(f"picture: {coder.surplus} bytes too many")
        return decoded

    def _code_plane(
        self, coder: BitCoder, plane: int, coarse: Integers, details: list[list[Integers]]
    ) -> None:
        """Code a plane's integers; a decoder fills them in."""
        chroma = int(plane > 0)
        self._code_coarse(coder, chroma, coarse)
        parents: list[Integers | None] = [None] * 3
        for level, bands in enumerate(details):
            for turn, band in enumerate(bands):
                before = self._before.setdefault((plane, level, turn), np.zeros_like(band))
                if before.shape != band.shape:
                    raise ValueError("pictures of one series differ in size")
                self._code_band(coder, 2 * level + chroma, band, parents[turn], before)
                sizes = np.abs(band)
                before += sizes
                parents[turn] = sizes

    def _code_coarse(self, coder: BitCoder, context: int, coarse: Integers) -> None:
        """The coarsest subband, each value predicted from the plane through its neighbours."""
        height, width = coarse.shape
        known = np.zeros((height + 1, width + 1), dtype=np.int64)
        for i in range(height):
            for j in range(width):
                around = known[i, j + 1], known[i + 1, j], known[i, j]
                predicted = sum(around[:2]) - around[2] if i and j else sum(around)
                rest = self._coarse.code(coder, context, int(coarse[i, j] - predicted))
                coarse[i, j] = known[i + 1, j + 1] = predicted + rest

    def _code_band(
        self,
        coder: BitCoder,
        kind: int,
        band: Integers,
        parent: Integers | None,
        before: Integers,
    ) -> None:
        height, width = band.shape
        above = _doubled(parent, band.shape)
        foretold = _classes(_spread(before))
        contexts = 3 * _by_tile(foretold).max((1, 3)) + np.minimum(2, _by_tile(above).sum((1, 3)))
        whether = np.abs(_by_tile(band)).max((1, 3)).tolist()
        busy = [0] * (-(-width // TILE) + 1)
        sizes: Rows = [[0] * (width + 2) for _ in range(height + 1)]
        for row, in_row in enumerate(contexts.tolist()):
            for tile, context in enumerate(in_row):
                beside = kind * 3 + busy[tile] + busy[tile - 1]
                busy[tile] = self._tiles.code(
                    coder, beside * _CLASSES * 3 + context, int(whether[row][tile] > 0)
                )
                if busy[tile]:
                    window = _window(row, band.shape[0]), _window(tile, band.shape[1])
                    self._code_tile(coder, window, band, sizes, foretold, above)

    def _code_tile(
        self,
        coder: BitCoder,
        window: tuple[slice, slice],
        band: Integers,
        sizes: Rows,
        foretold: Integers,
        above: Integers,
    ) -> None:
        first = window[1].start
        contexts = foretold[window].tolist(), np.minimum(above[window], 2).tolist()
        values = band[window].tolist()
        for i, (row, classes, parents) in enumerate(
            zip(values, *contexts, strict=True), window[0].start
        ):
            upper, here = sizes[i], sizes[i + 1]
            for j, (value, kept, parent) in enumerate(
                zip(row, classes, parents, strict=True), first
            ):
                near = 2 * (here[j] + upper[j + 1]) + upper[j] + upper[j + 2]
                around = _CLASS[near] if near < len(_CLASS) else _CLASSES - 1
                context = (around * 4 + kept // 2) * 3 + parent
                if self._nonzero.code(coder, context, int(value != 0)):
                    coded = self._code_size(coder, 3 * around + parent, value)
                    band[i, j] = coded
                    here[j + 1] = abs(coded)

    def _code_size(self, coder: BitCoder, context: int, value: int) -> int:
        """A value that is not zero."""
        negative = coder.code_bit(int(value < 0), WHOLE // 2)
        size, reached = abs(value), 1
        while reached < _LARGE and self._greater.code(
            coder, context * _MOST_RUN + min(reached, _MOST_RUN) - 1, int(size > reached)
        ):
            reached += 1
        if reached == _LARGE:
            reached += abs(self._excess.code(coder, 0, size - reached))
        return -reached if negative else reached


def transform(plane: Array, levels: int) -> tuple[Array, list[list[Array]]]:
    """The coarsest subband, and the three details of each level, the coarsest level first."""
    details: list[list[Array]] = []
    coarse = np.asarray(plane, dtype=np.float64)
    for _ in range(levels):
        low, high = _split(coarse)
        (coarse, right), (down, both) = _split(low.T), _split(high.T)
        coarse = coarse.T
        details.append([right.T, down.T, both.T])
    return coarse, details[::-1]


def inverse_transform(coarse: Array, details: Sequence[Sequence[Array]]) -> Array:
    """The plane of which `transform` makes these."""
    for right, down, both in details:
        coarse = _join(_join(coarse.T, right.T).T, _join(down.T, both.T).T)
    return coarse


def _split(rows: Array) -> tuple[Array, Array]:
    even, odd = rows[0::2].copy(), rows[1::2].copy()
    if not len(odd):
        return even, odd
    for place, factor in enumerate(_LIFT):
        if place % 2:
            even += factor * (_earlier(odd, len(even)) + _later(odd, len(even)))
        else:
            odd += factor * (even[: len(odd)] + _next(even, len(odd)))
    return even * _GAIN, odd / _GAIN


def _join(low: Array, high: Array) -> Array:
    if not len(high):
        return low
    even, odd = low / _GAIN, high * _GAIN
    for place, factor in reversed(tuple(enumerate(_LIFT))):
        if place % 2:
            even -= factor * (_earlier(odd, len(even)) + _later(odd, len(even)))
        else:
            odd -= factor * (even[: len(odd)] + _next(even, len(odd)))
    rows = np.empty((len(even) + len(odd), even.shape[1]))
    rows[0::2], rows[1::2] = even, odd
    return rows


def _next(even: Array, count: int) -> Array:
    """For each odd row the even one after it, mirrored at the end."""
    return np.concatenate([even[1:], even[-1:]])[:count]


def _earlier(odd: Array, count: int) -> Array:
    """For each even row the odd one before it, mirrored at the start."""
    return np.concatenate([odd[:1], odd])[:count]


def _later(odd: Array, count: int) -> Array:
    """For each even row the odd one after it, mirrored at the end."""
    return np.concatenate([odd, odd[-1:]])[:count]


def _quantised(band: Array, step: float) -> Integers:
    return (np.sign(band) * np.floor(np.abs(band) / step + _ROUND_UP)).astype(np.int64)


def _restored(coarse: Integers, details: Sequence[Sequence[Integers]], step: float) -> Array:
    bands = [[step * (b - _TOWARDS_ZERO * np.sign(b)) for b in level] for level in details]
    return inverse_transform((coarse * step).astype(np.float64), bands)


def _doubled(parent: Integers | None, shape: tuple[int, ...]) -> Integers:
    """The size of each coefficient's parent."""
    if parent is None:
        return np.zeros(shape, dtype=np.int64)
    doubled = np.repeat(np.repeat(parent, 2, 0), 2, 1)
    short = [(0, max(0, want - have)) for want, have in zip(shape, doubled.shape, strict=True)]
    return np.asarray(np.pad(doubled, short)[: shape[0], : shape[1]])


def _window(tile: int, end: int) -> slice:
    """The rows or columns of a tile."""
    return slice(tile * TILE, min((tile + 1) * TILE, end))


def _by_tile(band: Integers) -> Integers:
    """A band by rows of tiles, rows within, columns of tiles, columns within; zeros at its ends."""
    whole = np.pad(band, [(0, -side % TILE) for side in band.shape])
    height, width = whole.shape
    return whole.reshape(height // TILE, TILE, width // TILE, TILE)


def _spread(before: Integers) -> Integers:
    """What pictures before had here and beside."""
    wide = np.pad(before, 1)
    beside = wide[:-2, 1:-1] + wide[2:, 1:-1] + wide[1:-1, :-2] + wide[1:-1, 2:]
    return np.asarray(2 * before + beside)


def _classes(sizes: Integers) -> Integers:
    return np.array(_CLASS, dtype=np.int64)[np.minimum(sizes, len(_CLASS) - 1)]
