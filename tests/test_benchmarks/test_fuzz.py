"""Changed bytes at everything that reads them from outside: a small part of `benchmarks.fuzz`."""

import random
from pathlib import Path

from layer_streams import write_call

from benchmarks.fuzz.__main__ import SHARES, fuzz
from benchmarks.fuzz.mutation import mutated

TRIES = 1500


def test_changed_bytes_are_refused_by_typed_errors(tmp_path: Path) -> None:
    write_call(tmp_path / "call.rzo", 4)
    found = fuzz(tmp_path / "call.rzo", TRIES, seed=1)
    assert list(found) == list(SHARES)
    assert sum(each.tries for each in found.values()) >= 0.99 * TRIES
    # No checksum in front of the parsers: what is well-formed passes.
    assert 0 < found["packet parser"].refused < found["packet parser"].tries
    assert found["call file"].refused == found["call file"].tries


def test_a_seed_makes_the_same_changes_and_most_are_changes() -> None:
    samples = [bytes(range(100)), bytes(40)]
    made = [[mutated(random.Random(n), samples) for n in range(100)] for _ in range(2)]
    assert made[0] == made[1]
    assert sum(data not in samples for data in made[0]) > 80
