"""What a bad wire does to packets, on a simulated clock."""

from itertools import pairwise
from pathlib import Path

import pytest

from benchmarks.bad_wire.network_namespace import TUN_DEVICE, obstacle
from benchmarks.bad_wire.wire import Faults, Lane


def fates(faults: Faults, count: int, seed: int = 1) -> list[tuple[float, ...]]:
    """Arrivals of packets of 100 bytes, sent 10 ms apart."""
    lane = Lane(faults, seed)
    return [lane.carry(100, 0.01 * number) for number in range(count)]


def test_a_wire_without_faults_delivers_each_packet_at_once() -> None:
    assert fates(Faults(), 50) == [(0.01 * number,) for number in range(50)]


def test_the_same_seed_gives_the_same_fates() -> None:
    faults = Faults(loss=0.2, burst=2, delay_ms=20, jitter_ms=10, duplicates=0.1)
    assert fates(faults, 500) == fates(faults, 500)
    assert fates(faults, 500) != fates(faults, 500, seed=2)


def test_single_losses_have_the_share_asked_for() -> None:
    lost = [not arrivals for arrivals in fates(Faults(loss=0.25), 20_000)]
    assert sum(lost) / len(lost) == pytest.approx(0.25, abs=0.01)
    after_lost = [now for before, now in pairwise(lost) if before]
    assert sum(after_lost) / len(after_lost) == pytest.approx(0.25, abs=0.02)


def test_bursts_have_the_share_and_the_mean_length_asked_for() -> None:
    lost = [not arrivals for arrivals in fates(Faults(loss=0.1, burst=3), 50_000)]
    begun = sum(now and not before for before, now in pairwise(lost))
    assert sum(lost) / len(lost) == pytest.approx(0.1, abs=0.01)
    assert sum(lost) / begun == pytest.approx(3, abs=0.15)


def test_jitter_stays_within_its_bounds_and_puts_packets_out_of_order() -> None:
    arrivals = [each[0] for each in fates(Faults(delay_ms=50, jitter_ms=20), 1000)]
    delays = [at - 0.01 * number for number, at in enumerate(arrivals)]
    assert 0.03 <= min(delays) < 0.032
    assert 0.068 < max(delays) <= 0.07
    assert arrivals != sorted(arrivals)


def test_no_packet_arrives_before_it_was_sent() -> None:
    arrivals = fates(Faults(delay_ms=5, jitter_ms=50), 500)
    assert all(each[0] >= 0.01 * number for number, each in enumerate(arrivals))


def test_some_packets_come_twice() -> None:
    twice = [len(arrivals) == 2 for arrivals in fates(Faults(duplicates=0.05), 20_000)]
    assert sum(twice) / len(twice) == pytest.approx(0.05, abs=0.005)


def test_packets_wait_for_the_rate() -> None:
    """100 bytes take 100 ms at 8,000 bits a second."""
    arrivals = [each[0] for each in fates(Faults(rate_bps=8000), 20)]
    assert arrivals == pytest.approx([0.1 * (number + 1) for number in range(20)])


def test_a_full_queue_loses_what_comes_then() -> None:
    arrivals = fates(Faults(rate_bps=8000, queue_bytes=250), 100)
    assert 10 <= sum(map(len, arrivals)) <= 13
    assert max(each[0] - 0.01 * n for n, each in enumerate(arrivals) if each) <= 0.25 + 1e-9


def test_nothing_passes_during_a_cut() -> None:
    arrivals = fates(Faults(cuts=((0.1, 0.2), (0.5, 0.6))), 100)
    lost = [number for number, each in enumerate(arrivals) if not each]
    assert lost == [*range(10, 20), *range(50, 60)]


@pytest.mark.parametrize(
    "wrong",
    [
        {"loss": 1.0},
        {"loss": -0.1},
        {"duplicates": 1.5},
        {"delay_ms": -1.0},
        {"jitter_ms": -1.0},
        {"rate_bps": -1.0},
        {"queue_bytes": -1},
        {"burst": 0.5},
        {"cuts": ((3.0, 2.0),)},
    ],
)
def test_faults_that_cannot_be_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong)).partition("_")[0].rstrip("s")):
        Faults(**wrong)  # type: ignore[arg-type]


def test_no_wire_without_the_device(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("benchmarks.bad_wire.network_namespace.TUN_DEVICE", tmp_path / "tun")
    assert obstacle() == f"there is no {tmp_path / 'tun'}"
    assert TUN_DEVICE.name == "tun"
