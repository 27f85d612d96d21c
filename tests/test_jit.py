"""Compiled loops do what they are written to do, wherever they come from."""

import numpy as np

from encoder.runtime.jit import jit

LOOP = """
def ratios(over, under):
    found = np.empty(len(over))
    for number in range(len(over)):
        found[number] = over[number] / under[number]
    return found
"""


def test_a_loop_for_which_there_is_no_folder_is_compiled_all_the_same() -> None:
    # What is in no file can be kept beside none.
    names: dict[str, object] = {"np": np}
    exec(LOOP, names)
    ratios = names["ratios"]
    assert callable(ratios)
    found = jit(ratios)(np.array([1.0, 3.0]), np.array([2.0, 4.0]))
    np.testing.assert_array_equal(found, [0.5, 0.75])


def test_what_is_divided_by_nothing_is_infinite_as_in_numpy() -> None:
    @jit
    def inverse(value: float) -> float:
        return 1 / value

    assert inverse(0.0) == np.inf
