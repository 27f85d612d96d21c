"""Compiled functions give the results of the Python code, with or without a cache folder."""

import subprocess
import sys

import numpy as np

from runtime.jit import fingerprint, jit

LOOP = """
def ratios(over, under):
    found = np.empty(len(over))
    for number in range(len(over)):
        found[number] = over[number] / under[number]
    return found
"""


def test_a_function_without_a_file_is_compiled_without_a_cache() -> None:
    # Code that is in no file has no folder for a cache.
    names: dict[str, object] = {"np": np}
    exec(LOOP, names)
    ratios = names["ratios"]
    assert callable(ratios)
    found = jit(ratios)(np.array([1.0, 3.0]), np.array([2.0, 4.0]))
    np.testing.assert_array_equal(found, [0.5, 0.75])


def test_division_by_zero_is_infinite_as_in_numpy() -> None:
    @jit
    def inverse(value: float) -> float:
        return 1 / value

    assert inverse(0.0) == np.inf


def test_a_constant_of_another_module_changes_the_fingerprint() -> None:
    source = "def scaled(value):\n    return FACTOR * value + shifted(value)\n"

    def of(factor: float, shift: float) -> str:
        inner: dict[str, object] = {"SHIFT": shift}
        exec("def shifted(value):\n    return value + SHIFT\n", inner)
        shifted = inner["shifted"]
        assert callable(shifted)
        outer: dict[str, object] = {"FACTOR": factor, "shifted": jit(shifted)}
        exec(source, outer)
        scaled = outer["scaled"]
        assert callable(scaled)
        return fingerprint(scaled)

    assert of(2.0, 1.0) == of(2.0, 1.0)
    assert len({of(2.0, 1.0), of(3.0, 1.0), of(2.0, 4.0)}) == 3


def test_compiled_loops_do_without_scipy() -> None:
    program = (
        "import sys, numpy as np; from runtime.jit import jit;"
        "assert jit(lambda values: values.sum())(np.ones(3)) == 3;"
        "sys.exit('scipy.linalg' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
