"""Compiled loops over texels and pixels, where NumPy would need large temporary arrays."""

import hashlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, TypeVar, cast

import numba
import numpy as np

Function = TypeVar("Function", bound=Callable[..., object])

PACKAGE = Path(__file__).resolve().parent


def jit(function: Function) -> Function:
    """Compile a function of arrays and numbers to machine code at its first call (decorator).

    The code releases the interpreter lock, divides by zero as NumPy does, and keeps the order of
    floating-point operations, so that results do not depend on the machine.  The compiled code is
    cached under a fingerprint of all that it is made from: Numba by itself does not notice what has
    changed in another file than the function's.
    """
    _load_without_scipy()
    try:
        with _cache_folder(fingerprint(function)):
            compiled = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    except RuntimeError:
        # There is no folder that a cache can be written to.
        compiled = numba.njit(nogil=True, error_model="numpy")(function)
    return cast(Function, compiled)


@cache
def _load_without_scipy() -> None:
    """Load Numba's array functions as if there were no SciPy.

    They would load its linear algebra to see whether compiled loops can have it.  None does, and
    that takes as long as loading the functions.  Numba has no option for it; its issue 808 is about
    how long it takes to load.
    """
    linear_algebra = cast(Any, import_module("numba.np.linalg"))
    ensure_blas = linear_algebra.ensure_blas
    linear_algebra.ensure_blas = _no_blas
    try:
        import_module("numba.np.arraymath")
    finally:
        linear_algebra.ensure_blas = ensure_blas


def _no_blas() -> None:
    raise ImportError("SciPy is not loaded for compiled loops")


def fingerprint(function: Callable[..., object]) -> str:
    """A name for a function that changes with its code, its constants, and what it calls."""
    assert isinstance(function, FunctionType)
    digest = hashlib.sha256()
    for part in _parts(function.__code__, function.__globals__):
        digest.update(part)
    return digest.hexdigest()[:16]


def _parts(code: CodeType, names: Mapping[str, Any]) -> Iterator[bytes]:
    yield code.co_code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _parts(constant, names)
        else:
            yield repr(constant).encode()
    for name in code.co_names:
        value = names.get(name)
        yield name.encode()
        if isinstance(value, np.ndarray):
            yield value.tobytes()
        elif isinstance(value, int | float | str | tuple):
            yield repr(value).encode()
        elif called := getattr(value, "py_func", None):
            yield from _parts(called.__code__, called.__globals__)


@contextmanager
def _cache_folder(name: str) -> Iterator[None]:
    """Numba's cache folder while a function is declared; that of the rest of the program stays."""
    config = cast(Any, numba.config)
    before = config.CACHE_DIR
    config.CACHE_DIR = str((Path(before) if before else _default_folder()) / name)
    try:
        yield
    finally:
        config.CACHE_DIR = before


@cache
def _default_folder() -> Path:
    """In the package where that can be written, else in the user's cache folder."""
    folder = PACKAGE / "__pycache__" / "compiled"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "writable").touch()
    except OSError:
        return Path.home() / ".cache" / "risorius" / "compiled"
    return folder
