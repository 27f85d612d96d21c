"""Sizes: lines of a module, lines of a function, modules of a package.

An exception has a limit of its own, close above its size.  Once it has shrunk its limit is lowered,
and it goes when the general limit suffices.
"""

import ast
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("shared_model", "protocol", "encoder", "decoder", "aam", "loopback", "risorius")
MODULE_LINES, FUNCTION_LINES, PACKAGE_MODULES = 300, 40, 13
LONGER_MODULES: dict[str, int] = {
    "tests/test_protocol/test_call_file.py": 353,
    "protocol/link/messages.py": 325,
    "tests/test_protocol/test_packets.py": 353,
    "tests/test_decoder/test_renderer.py": 313,
}
LONGER_FUNCTIONS: dict[str, int] = {
    "tests/make_vectors.py:default_call": 51,
    "encoder/picture_coding/subband_rdoq.py:_quantise": 47,
    "encoder/tracking/outlier_rejection.py:robust_residuals": 45,
    "protocol/model_packet.py:_model_from_fields": 41,
}
LARGER_PACKAGES: dict[str, int] = {
    "encoder/calls": 14,
    "encoder/fitting": 16,
    "scripts": 23,
}
# By how much an exception's limit may exceed the size.
SLACK_LINES = 10


def sources() -> dict[str, str]:
    """The text of every Python file by its path."""
    paths = [path for top in (*PACKAGES, "scripts", "tests") for path in (ROOT / top).rglob("*.py")]
    return {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in paths}


def module_lines() -> dict[str, int]:
    return {name: len(text.splitlines()) for name, text in sources().items()}


def function_lines() -> dict[str, int]:
    """The lines of every function by `path:name`, the longest of several with one name."""
    found: dict[str, int] = {}
    for path, text in sources().items():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                name, lines = f"{path}:{node.name}", (node.end_lineno or 0) - node.lineno + 1
                found[name] = max(found.get(name, 0), lines)
    return found


def package_modules() -> dict[str, int]:
    """The modules of every package by its path, without `__init__.py` and `__main__.py`.

    The folders of `tests` follow the packages and have no limit of their own.
    """
    modules = [name for name in sources() if not name.endswith("__.py")]
    folders = [name.rpartition("/")[0] for name in modules if not name.startswith("tests/")]
    return dict(Counter(folders))


@pytest.mark.parametrize(
    ("measure", "limit", "exceptions", "slack"),
    [
        (module_lines, MODULE_LINES, LONGER_MODULES, SLACK_LINES),
        (function_lines, FUNCTION_LINES, LONGER_FUNCTIONS, SLACK_LINES),
        (package_modules, PACKAGE_MODULES, LARGER_PACKAGES, 0),
    ],
    ids=["modules", "functions", "packages"],
)
def test_nothing_is_larger_than_its_limit_and_no_exception_is_wider_than_needed(
    measure: Callable[[], dict[str, int]], limit: int, exceptions: dict[str, int], slack: int
) -> None:
    sizes = measure()
    limits = {name: exceptions.get(name, limit) for name in sizes}
    assert {name: size for name, size in sizes.items() if size > limits[name]} == {}
    needed = {name for name, size in sizes.items() if size > limit}
    assert set(exceptions) - needed == set(), "not needed"
    assert [name for name in exceptions if exceptions[name] > sizes[name] + slack] == [], "lower it"
