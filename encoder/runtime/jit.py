"""Compiled loops over texels and pixels, where NumPy would need large temporary arrays."""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., object])


def jit(function: Function) -> Function:
    """Compile a function of arrays and numbers to machine code at its first call (decorator).

    The code releases the interpreter lock, divides by zero as NumPy does, and keeps the order of
    floating-point operations, so that results do not depend on the machine.  The compiled code is
    cached next to the source or in the user's cache folder; it is compiled again when the file of
    the function changes, but not when another file does: then `make clean`.
    """
    try:
        compiled = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError:
        # There is no folder that a cache can be written to.
        compiled = numba.njit(nogil=True, error_model="numpy")(function)
    return cast(Function, compiled)
