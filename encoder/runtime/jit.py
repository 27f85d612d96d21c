"""Loops over texels and pixels as machine code, where NumPy would make an array of every step.

Compiled when they are first called and kept beside the source, or in the user's cache folder. They
let other threads run. Floating point keeps to the order in which it is written, so results do not
depend on the machine.
"""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(loop: Function) -> Function:
    """The same function of arrays and numbers as machine code; division by zero as in NumPy."""
    try:
        kept = numba.njit(cache=True, nogil=True, error_model="numpy")(loop)
    except RuntimeError:
        # There is no folder to keep it in.
        kept = numba.njit(nogil=True, error_model="numpy")(loop)
    return cast(Function, kept)
