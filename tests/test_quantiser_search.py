"""The finest quantiser within a size is found, wherever it is, in few trials."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from encoder.picture_coding.quantiser_search import finest_quantiser_within

LEAST, LAST = 3, 80


@given(
    sizes=st.lists(st.integers(0, 10_000), min_size=LAST + 1, max_size=LAST + 1),
    most=st.integers(0, 10_000),
    first=st.integers(-5, LAST + 5),
    halving=st.floats(1, 50),
)
def test_the_finest_that_fits_is_found_whatever_the_sizes(
    sizes: list[int], most: int, first: int, halving: float
) -> None:
    sizes.sort(reverse=True)
    expected = next((n for n in range(LEAST, LAST) if sizes[n] <= most), LAST)
    tried: list[int] = []

    def make(number: int) -> tuple[int, int]:
        tried.append(number)
        return number, sizes[number]

    numbers = range(LEAST, LAST + 1)
    found = finest_quantiser_within(make, lambda item: item[1], most, numbers, first, halving)
    assert found == (expected, (expected, sizes[expected]))
    assert len(tried) == len(set(tried)) <= 12


def test_sizes_that_halve_evenly_take_few_trials() -> None:
    for most in range(200, 20_000, 700):
        tried: list[int] = []

        def make(number: int, tried: list[int] = tried) -> float:
            tried.append(number)
            return float(40_000 * 2 ** (-number / 9))

        numbers = range(LAST + 1)
        found, size = finest_quantiser_within(make, float, most, numbers, LAST // 2, 8)
        assert len(tried) <= 5
        assert size == make(found) <= most and (not found or make(found - 1) > most)


@pytest.mark.parametrize("numbers", [range(0), range(0, 10, 2), range(5, 0, -1)])
def test_numbers_that_are_not_consecutive_are_refused(numbers: range) -> None:
    with pytest.raises(ValueError, match="steps of 1"):
        finest_quantiser_within(float, float, 1.0, numbers, 0, 8)
