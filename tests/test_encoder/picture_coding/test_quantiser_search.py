"""The finest quantiser within a size is found in few trials."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from encoder.picture_coding.quantiser_search import finest_quantiser_within

LEAST, LAST = 3, 80


@given(
    sizes=st.lists(st.integers(0, 10_000), min_size=LAST + 1, max_size=LAST + 1),
    max_size=st.integers(0, 10_000),
    initial=st.integers(-5, LAST + 5),
    halving=st.floats(1, 50),
)
def test_the_finest_that_fits_is_found_for_any_sizes(
    sizes: list[int], max_size: int, initial: int, halving: float
) -> None:
    sizes.sort(reverse=True)
    expected = next((n for n in range(LEAST, LAST) if sizes[n] <= max_size), LAST)
    encoded: list[int] = []

    def encode(quantiser: int) -> tuple[int, int]:
        encoded.append(quantiser)
        return quantiser, sizes[quantiser]

    quantisers = range(LEAST, LAST + 1)
    best = finest_quantiser_within(
        encode, lambda item: item[1], max_size, quantisers, initial, halving
    )
    assert best == (expected, (expected, sizes[expected]))
    assert len(encoded) == len(set(encoded)) <= 12


def test_sizes_that_halve_evenly_take_few_trials() -> None:
    for max_size in range(200, 20_000, 700):
        encoded: list[int] = []

        def encode(quantiser: int, encoded: list[int] = encoded) -> float:
            encoded.append(quantiser)
            return float(40_000 * 2 ** (-quantiser / 9))

        quantisers = range(LAST + 1)
        best, size = finest_quantiser_within(encode, float, max_size, quantisers, LAST // 2, 8)
        assert len(encoded) <= 5
        assert size == encode(best) <= max_size and (not best or encode(best - 1) > max_size)


@pytest.mark.parametrize("quantisers", [range(0), range(0, 10, 2), range(5, 0, -1)])
def test_quantisers_that_are_not_consecutive_are_refused(quantisers: range) -> None:
    with pytest.raises(ValueError, match="steps of 1"):
        finest_quantiser_within(float, float, 1.0, quantisers, 0, 8)
