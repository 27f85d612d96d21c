"""Planes of wavelet coefficients as bytes: which order, and by what probabilities.

A plane's coarsest subband comes first, then the details level by level.  In each band flags say
which tiles hold anything, then come the coefficients of those; see `protocol.surroundings`.  Of a
mode the coarsest subband is coded as the others are, of stills it is predicted from its neighbours.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from protocol.adaptive import AdaptiveIntegers
from protocol.entropy import WHOLE, RangeDecoder
from protocol.foresee import Site, networks
from protocol.messages import ProtocolError
from protocol.surroundings import (
    SMALL_BAND,
    SOURCES,
    TILE,
    Surroundings,
    Turn,
    box,
    by_tile,
    doubled,
    fitted,
)
from protocol.values import BitCoder, code_bits
from protocol.wavelet import LEVELS, inverse_transform

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Shape = tuple[int, int]

STILL, TEXTURE, MODE = range(3)
COARSE = 3
# Sizes are coded step by step up to this one, what is above by Elias' gamma code; and which output
# of the network foretells each step.
UNARY = 60
STEP_OUTPUTS = (0, 1, 2, 3, 3, 4, 4, 4, 4, *[5] * (UNARY - 9))
MAX_LENGTH = 14
# Coefficients of a size lie a little nearer to zero than its middle.
TOWARDS_ZERO = 0.05


@dataclass(frozen=True, slots=True)
class Pyramid:
    """A plane's integers: the coarsest subband, and three details a level, the coarsest first."""

    coarse: Integers
    details: list[list[Integers]]

    def band(self, site: Site) -> Integers:
        """The band of this level and orientation."""
        return self.details[site.level - 1][site.orientation] if site.level else self.coarse


class Band(Protocol):
    """One band as it is coded: an encoder knows it, a decoder reads it."""

    def flags(self, zeros: Integers, turn: Turn) -> Integers:
        """(n,) 0 or 1 for tiles, 0 with probability zeros (n,) / 65536."""
        ...

    def sizes(self, zeros: Integers, turn: Turn) -> Integers:
        """(n,) sizes of coefficients; zeros (n, SIZE_OUTPUTS) see `foresee.Networks`."""
        ...

    def signs(self, zeros: Integers, turn: Turn) -> Integers:
        """(n,) 0, or 1 for a negative one, of the coefficients that are not zero."""
        ...


class Bands(Protocol):
    """The bands of one plane."""

    @property
    def pyramid(self) -> Pyramid:
        """Of these shapes."""
        ...

    def coarse(self, integers: AdaptiveIntegers, context: int) -> Integers:
        """The coarsest subband, predicted from its neighbours."""
        ...

    def band(self, site: Site) -> Band:
        """The next band."""
        ...


@dataclass(slots=True)
class Series:
    """Pictures of one kind and size, coded one after the other; each foretells the next.

    kind: STILL, TEXTURE or MODE.
    """

    kind: int
    pictures: int = 0
    _last: list[Pyramid] = field(default_factory=list)
    _totals: list[Pyramid] = field(default_factory=list)

    def copy(self) -> "Series":
        """What can go on by itself."""
        return replace(self)

    def code(self, planes: Sequence[Bands]) -> list[Pyramid]:
        """Code a picture: luma, then colours at half its size.

        Raises `ValueError` if its size is not that of the pictures before.
        """
        integers = AdaptiveIntegers(2)
        coded: list[Pyramid] = []
        for plane, bands in enumerate(planes):
            coded.append(self._plane(plane, bands, coded, integers))
        sizes = [_map(np.abs, pyramid) for pyramid in coded]
        if self.pictures:
            sizes = [_map(np.add, *pair) for pair in zip(self._totals, sizes, strict=True)]
        self._last, self._totals = coded, sizes
        self.pictures += 1
        return coded

    def _plane(
        self, plane: int, bands: Bands, before: Sequence[Pyramid], integers: AdaptiveIntegers
    ) -> Pyramid:
        site = Site(self.kind, plane, 0, COARSE, self.pictures)
        if self.kind == MODE:
            sources = self._sources(site, bands.pyramid.coarse.shape, [], [], before)
            coarse = self._band(bands.band(site), site, sources)
        else:
            coarse = bands.coarse(integers, int(plane > 0))
        details: list[list[Integers]] = []
        parents: list[Integers] = []
        for level, blanks in enumerate(bands.pyramid.details, 1):
            done: list[Integers] = []
            for orientation, empty in enumerate(blanks):
                site = Site(self.kind, plane, level, orientation, self.pictures)
                sources = self._sources(site, empty.shape, parents, done, before)
                done.append(self._band(bands.band(site), site, sources))
            details.append(done)
            parents = [np.abs(band) for band in done]
        return Pyramid(coarse, details)

    def _sources(
        self,
        site: Site,
        shape: Shape,
        parents: list[Integers],
        done: list[Integers],
        before: Sequence[Pyramid],
    ) -> Integers:
        """(SOURCES, h, w) sizes that go with a band."""
        sources = np.zeros((len(SOURCES), *shape), np.int64)
        if parents:
            own = parents[site.orientation]
            others = sum(
                fitted(p, own.shape) for i, p in enumerate(parents) if i != site.orientation
            )
            for index, sizes in enumerate((own, box(own) - own, others)):
                sources[index] = doubled(np.asarray(sizes), shape)
        for index, band in enumerate(reversed(done)):
            sources[3 + index] = fitted(np.abs(band), shape)
        if self.pictures:
            last = self._last[site.plane].band(site)
            if last.shape != shape:
                raise ValueError("pictures of one series differ in size")
            sources[5], sources[6] = self._totals[site.plane].band(site), last
        if site.plane and site.level > 1:
            sources[7] = fitted(before[0].band(replace(site, level=site.level - 1)), shape)
        if site.plane > 1:
            sources[8] = before[1].band(site)
        return sources

    def _band(self, band: Band, site: Site, sources: Integers) -> Integers:
        shape = sources.shape[1:]
        if not shape[0] * shape[1]:
            return np.zeros(shape, np.int64)
        flags = self._flags(band, site, by_tile(np.abs(sources)))
        active = np.repeat(np.repeat(flags, TILE, 0), TILE, 1)[: shape[0], : shape[1]]
        busy = np.repeat(np.repeat(box(flags), TILE, 0), TILE, 1)
        result = np.zeros(shape, np.int64)
        around = Surroundings(sources, active > 0, busy[: shape[0], : shape[1]])
        for turn in around.turns():
            values = band.sizes(self._sizes(around, site, turn), turn)
            some = values > 0
            if some.any():
                signed = turn.of(some)
                negative = band.signs(self._signs(around, site, signed), signed)
                values[some] *= 1 - 2 * negative
            around.learn(turn, values)
            result[turn.rows, turn.columns] = values
        return result

    def _flags(self, band: Band, site: Site, sources: Integers) -> Integers:
        """Which tiles of a band hold anything."""
        grid = sources.shape[1:]
        if grid[0] * grid[1] * TILE**2 <= SMALL_BAND:
            return np.ones(grid, np.int64)
        flags = np.zeros(grid, np.int64)
        around = Surroundings(sources, np.ones(grid, bool), flags)
        for turn in around.turns():
            found = band.flags(self._tiles(around, site, turn), turn)
            around.learn(turn, found)
            flags[turn.rows, turn.columns] = found
        return flags

    def _tiles(self, around: Surroundings, site: Site, turn: Turn) -> Integers:
        return networks().tiles.zeros(around.around_sizes(turn), site, turn)[:, 0]

    def _sizes(self, around: Surroundings, site: Site, turn: Turn) -> Integers:
        return networks().sizes.zeros(around.around_sizes(turn), site, turn)

    def _signs(self, around: Surroundings, site: Site, turn: Turn) -> Integers:
        return networks().signs.zeros(around.around_signs(turn), site, turn)[:, 0]


def blank(shape: Shape) -> Pyramid:
    """Zeros in the shapes that `wavelet.transform` makes of a plane."""
    levels: list[list[Integers]] = []
    height, width = shape
    for _ in range(LEVELS):
        low, high = (-(-height // 2), -(-width // 2)), (height // 2, width // 2)
        shapes = ((low[0], high[1]), (high[0], low[1]), high)
        levels.append([np.zeros(each, np.int64) for each in shapes])
        height, width = low
    return Pyramid(np.zeros((height, width), np.int64), levels[::-1])


def _map(function: Callable[..., Integers], *pyramids: Pyramid) -> Pyramid:
    """A function of the bands of pyramids, band by band."""
    coarse = function(*(pyramid.coarse for pyramid in pyramids))
    levels = zip(*(pyramid.details for pyramid in pyramids), strict=True)
    details = [[function(*bands) for bands in zip(*level, strict=True)] for level in levels]
    return Pyramid(coarse, details)


def code_coarse(
    coder: BitCoder, integers: AdaptiveIntegers, context: int, coarse: Integers
) -> Integers:
    """The coarsest subband of a still, each value predicted from the plane through its neighbours.

    A decoder ignores the values of `coarse`.  Returns the values coded.
    """
    height, width = coarse.shape
    known = np.zeros((height + 1, width + 1), dtype=np.int64)
    for i in range(height):
        for j in range(width):
            around = known[i, j + 1], known[i + 1, j], known[i, j]
            predicted = sum(around[:2]) - around[2] if i and j else sum(around)
            rest = integers.code(coder, context, int(coarse[i, j] - predicted))
            known[i + 1, j + 1] = predicted + rest
    return known[1:, 1:]


def code_bits_each(coder: BitCoder, bits: Integers, zeros: Integers) -> Integers:
    """Bits (n,), each 0 with probability zeros (n,) / 65536; a decoder ignores them.

    Returns the bits coded.
    """
    pairs = zip(bits.tolist(), zeros.tolist(), strict=True)
    return np.array([coder.code_bit(bit, zero) for bit, zero in pairs], np.int64)


def code_sizes(coder: BitCoder, sizes: Integers, zeros: Integers) -> Integers:
    """Sizes (n,) of coefficients; zeros (n, SIZE_OUTPUTS) of them as `foresee.Networks` has them.

    A decoder ignores `sizes`.  Returns the sizes coded.
    Raises `ValueError` if a decoder reads one that no encoder writes.
    """
    pairs = zip(sizes.tolist(), zeros.tolist(), strict=True)
    return np.array([_code_size(coder, size, zero) for size, zero in pairs], np.int64)


def _code_size(coder: BitCoder, size: int, zeros: list[int]) -> int:
    reached = 0
    while reached < UNARY and coder.code_bit(int(size > reached), zeros[STEP_OUTPUTS[reached]]):
        reached += 1
    return reached if reached < UNARY else UNARY + _code_excess(coder, size - UNARY)


def _code_excess(coder: BitCoder, excess: int) -> int:
    """Elias' gamma code of `excess` >= 0."""
    size, length = excess + 1, 0
    while coder.code_bit(int(size >> length > 1), WHOLE // 2):
        length += 1
        if length > MAX_LENGTH:
            raise ValueError("a value is too large")
    return (1 << length | code_bits(coder, size, length)) - 1


@dataclass(frozen=True, slots=True)
class _Reading:
    """The bands of one plane as a decoder reads them."""

    coder: RangeDecoder
    pyramid: Pyramid

    def coarse(self, integers: AdaptiveIntegers, context: int) -> Integers:
        return code_coarse(self.coder, integers, context, self.pyramid.coarse)

    def band(self, site: Site) -> "_ReadingBand":
        return _ReadingBand(self.coder)


@dataclass(frozen=True, slots=True)
class _ReadingBand:
    coder: RangeDecoder

    def flags(self, zeros: Integers, turn: Turn) -> Integers:
        return code_bits_each(self.coder, np.zeros(len(zeros), np.int64), zeros)

    def sizes(self, zeros: Integers, turn: Turn) -> Integers:
        return code_sizes(self.coder, np.zeros(len(zeros), np.int64), zeros)

    def signs(self, zeros: Integers, turn: Turn) -> Integers:
        return code_bits_each(self.coder, np.zeros(len(zeros), np.int64), zeros)


def read(series: Series, data: bytes, shapes: Sequence[Shape]) -> list[Pyramid]:
    """The planes of `shapes` that `data` holds.  Raises `ProtocolError` if it holds none."""
    coder = RangeDecoder(data)
    try:
        pyramids = series.code([_Reading(coder, blank(shape)) for shape in shapes])
    except ValueError as error:
        raise ProtocolError(f"picture: {error}") from error
    if coder.surplus:
        raise ProtocolError(f"picture: {coder.surplus} bytes too many")
    return pyramids


def restored(pyramid: Pyramid, step: float) -> Array:
    """The plane that integers stand for, in steps of `step`."""
    details = [
        [step * (band - TOWARDS_ZERO * np.sign(band)) for band in level]
        for level in pyramid.details
    ]
    return inverse_transform((pyramid.coarse * step).astype(np.float64), details)
