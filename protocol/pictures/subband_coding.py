"""Planes of wavelet coefficients as bytes: which order, and by what probabilities.

A plane's coarsest subband comes first, then the details level by level.  In each band flags say
which tiles hold anything, then come the coefficients of those; see `coefficient_context`.  Of a
mode the coarsest subband is coded as the others are, of stills it is predicted from its neighbours.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from protocol.entropy.adaptive_models import AdaptiveIntegers
from protocol.entropy.range_coder import RangeDecoder
from protocol.packets import ProtocolError
from protocol.pictures.coefficient_coding import code_bits_each, code_coarse, code_sizes
from protocol.pictures.coefficient_context import (
    SMALL_BAND,
    TILE,
    Source,
    Surroundings,
    Turn,
    box,
    by_tile,
    enlarged,
    fitted,
)
from protocol.pictures.probability_model import COARSE, MODE, Site, networks
from protocol.pictures.wavelet import LEVELS, inverse_transform

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Shape = tuple[int, int]

# Coefficients of a size lie a little nearer to zero than its middle.
TOWARDS_ZERO = 0.05


@dataclass(frozen=True, slots=True)
class Pyramid:
    """A plane's integers: the coarsest subband, and three details a level, the coarsest first."""

    coarse: Integers
    details: list[list[Integers]]

    def band(self, site: Site) -> Integers:
        """The band of this level and orientation."""
        return site.of(self.coarse, self.details)


class PlaneCoder(Protocol):
    """Codes one plane, in order: an encoder decides what comes, a decoder reads it."""

    @property
    def shape(self) -> Shape:
        """Of the plane."""
        ...

    def coarse(self, empty: Integers, integers: AdaptiveIntegers, context: int) -> Integers:
        """The coarsest subband of a still, in the shape of `empty`; see `code_coarse`."""
        ...

    def band(self, site: Site, sources: Integers) -> Integers:
        """Any other band, in the shape of sources (len(Source), h, w): what goes with it."""
        ...


@dataclass(slots=True)
class Series:
    """Pictures of one kind and size, coded one after the other; each foretells the next.

    kind: see `foresee.Site`.
    """

    kind: int
    pictures: int = 0
    _last: list[Pyramid] = field(default_factory=list)
    _totals: list[Pyramid] = field(default_factory=list)

    def copy(self) -> "Series":
        """What can go on by itself."""
        return replace(self)

    def expect(self, shapes: Sequence[Shape]) -> None:
        """Raise `ValueError` if planes of `shapes` are no further picture of this series."""
        known = [plane_shape(pyramid.details) for pyramid in self._last]
        if self.pictures and known != list(shapes):
            raise ValueError("pictures of one series differ in size")

    def code(self, planes: Sequence[PlaneCoder]) -> list[Pyramid]:
        """Code a picture: luma, then colours at half its size.

        The series is as it was, see `learn`.  Raises `ValueError` as `expect` and the coders do.
        """
        self.expect([plane.shape for plane in planes])
        integers = AdaptiveIntegers(2)
        coded: list[Pyramid] = []
        for index, plane in enumerate(planes):
            coded.append(self._plane(index, plane, coded, integers))
        return coded

    def learn(self, coded: list[Pyramid]) -> None:
        """Go on to the picture that was coded."""
        sizes = [_map(np.abs, pyramid) for pyramid in coded]
        if self.pictures:
            sizes = [_map(np.add, *pair) for pair in zip(self._totals, sizes, strict=True)]
        self._last, self._totals = coded, sizes
        self.pictures += 1

    def _plane(
        self, plane: int, coder: PlaneCoder, before: Sequence[Pyramid], integers: AdaptiveIntegers
    ) -> Pyramid:
        empty = blank(coder.shape)
        site = Site(self.kind, plane, 0, COARSE, self.pictures)
        if self.kind == MODE:
            sources = self._sources(site, empty.coarse.shape, [], [], before)
            coarse = coder.band(site, sources)
        else:
            coarse = coder.coarse(empty.coarse, integers, int(plane > 0))
        details: list[list[Integers]] = []
        parents: list[Integers] = []
        for level, blanks in enumerate(empty.details, 1):
            done: list[Integers] = []
            for orientation, band in enumerate(blanks):
                site = Site(self.kind, plane, level, orientation, self.pictures)
                sources = self._sources(site, band.shape, parents, done, before)
                done.append(coder.band(site, sources) if band.size else band)
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
        """(len(Source), h, w) what goes with a band."""
        sources = np.zeros((len(Source), *shape), np.int64)
        if parents:
            own = parents[site.orientation]
            others = sum(
                fitted(p, own.shape) for i, p in enumerate(parents) if i != site.orientation
            )
            sources[Source.PARENT] = enlarged(own, 2, shape)
            sources[Source.AROUND_PARENT] = enlarged(box(own) - own, 2, shape)
            sources[Source.OTHER_PARENTS] = enlarged(np.asarray(others), 2, shape)
        for index, band in enumerate(reversed(done)):
            sources[Source.BAND_BEFORE + index] = fitted(np.abs(band), shape)
        if self.pictures:
            sources[Source.PICTURES_BEFORE] = self._totals[site.plane].band(site)
            sources[Source.LAST_PICTURE] = self._last[site.plane].band(site)
        if site.plane and site.level > 1:
            finer = replace(site, level=site.level - 1)
            sources[Source.LUMA] = fitted(before[0].band(finer), shape)
        if site.plane > 1:
            sources[Source.FIRST_COLOUR] = before[1].band(site)
        return sources

    def foretold_tiles(self, around: Surroundings, site: Site, turn: Turn) -> Integers:
        """(n,) probabilities that tiles hold nothing."""
        return networks().tiles.zeros(around.around_sizes(turn), site, turn)[:, 0]

    def foretold_sizes(self, around: Surroundings, site: Site, turn: Turn) -> Integers:
        """(n, outputs) probabilities of sizes, see `foresee.Networks`."""
        return networks().sizes.zeros(around.around_sizes(turn), site, turn)

    def foretold_signs(self, around: Surroundings, site: Site, turn: Turn) -> Integers:
        """(n,) probabilities that coefficients are positive."""
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


def plane_shape(details: Sequence[Sequence[NDArray[Any]]]) -> Shape:
    """Of the plane that has these details."""
    right, down, _ = details[-1]
    return len(right) + len(down), right.shape[1] + down.shape[1]


def _map(function: Callable[..., Integers], *pyramids: Pyramid) -> Pyramid:
    """A function of the bands of pyramids, band by band."""
    coarse = function(*(pyramid.coarse for pyramid in pyramids))
    levels = zip(*(pyramid.details for pyramid in pyramids), strict=True)
    details = [[function(*bands) for bands in zip(*level, strict=True)] for level in levels]
    return Pyramid(coarse, details)


@dataclass(frozen=True, slots=True)
class _Reader:
    """Reads a plane of `shape` of the next picture of `series`."""

    series: Series
    coder: RangeDecoder
    shape: Shape

    def coarse(self, empty: Integers, integers: AdaptiveIntegers, context: int) -> Integers:
        return code_coarse(self.coder, integers, context, empty)

    def band(self, site: Site, sources: Integers) -> Integers:
        shape = sources.shape[1:]
        flags = self._flags(site, by_tile(np.abs(sources)))
        active, busy = (enlarged(each, TILE, shape) for each in (flags, box(flags)))
        result = np.zeros(shape, np.int64)
        around = Surroundings(sources, active > 0, busy)
        for turn in around.turns():
            zeros = self.series.foretold_sizes(around, site, turn)
            values = code_sizes(self.coder, np.zeros(len(zeros), np.int64), zeros)
            some = values > 0
            if some.any():
                signed = turn.of(some)
                zeros = self.series.foretold_signs(around, site, signed)
                values[some] *= 1 - 2 * self._bits(zeros)
            around.learn(turn, values)
            result[turn.rows, turn.columns] = values
        return result

    def _flags(self, site: Site, sources: Integers) -> Integers:
        """Which tiles of a band hold anything."""
        grid = sources.shape[1:]
        if grid[0] * grid[1] * TILE**2 <= SMALL_BAND:
            return np.ones(grid, np.int64)
        flags = np.zeros(grid, np.int64)
        around = Surroundings(sources, np.ones(grid, bool), np.zeros(grid, np.int64))
        for turn in around.turns():
            found = self._bits(self.series.foretold_tiles(around, site, turn))
            around.learn(turn, found)
            flags[turn.rows, turn.columns] = found
        return flags

    def _bits(self, zeros: Integers) -> Integers:
        return code_bits_each(self.coder, np.zeros_like(zeros), zeros)


def read(series: Series, name: str, data: bytes, shapes: Sequence[Shape]) -> list[Pyramid]:
    """The planes of `shapes` that `data` holds, the next picture of `series`.

    name: what it is, for the message.  Raises `ProtocolError` if `data` holds none; then the series
    is as it was.
    """
    series.expect(shapes)
    coder = RangeDecoder(data)
    try:
        pyramids = series.code([_Reader(series, coder, shape) for shape in shapes])
    except ValueError as error:
        raise ProtocolError(f"{name}: {error}") from error
    if coder.surplus:
        raise ProtocolError(f"{name}: {coder.surplus} bytes too many")
    series.learn(pyramids)
    return pyramids


def restored(pyramid: Pyramid, step: float) -> Array:
    """The plane that integers stand for, in steps of `step`."""
    details = [
        [step * (band - TOWARDS_ZERO * np.sign(band)) for band in level]
        for level in pyramid.details
    ]
    return inverse_transform((pyramid.coarse * step).astype(np.float64), details)
