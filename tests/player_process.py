"""What the player makes of calls, in a process of node, beside what a decoder of ours does."""

import json
import subprocess
from collections.abc import Sequence
from pathlib import Path
from shutil import which
from typing import Any

import pytest
from conftest import ROOT
from played_integers import Played, as_json

PLAYER = ROOT / "tests" / "test_player" / "played_integers.js"


def of_player(paths: Sequence[Path]) -> list[Any]:
    """What the player makes of calls and lists of events."""
    node = which("node")
    if node is None:
        pytest.skip("needs node: apt-get install nodejs")
    # Without the flag node may hang as it ends: its issue 54918.
    command: list[str | Path] = [node, "--no-concurrent-recompilation", PLAYER, *paths]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return [json.loads(line) for line in run.stdout.splitlines()]


def check_same(path: Path, expected: Played) -> None:
    (found,) = of_player([path])
    for name, ours in as_json(expected).items():
        if isinstance(ours, list):
            for place, (one, other) in enumerate(zip(ours, found[name], strict=False)):
                assert one == other, f"{name}, {place}"
        assert ours == found[name], name
