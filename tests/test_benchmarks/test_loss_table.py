"""What a simulated link delivers."""

from pathlib import Path

import pytest
from layer_streams import BASE, write_call

from benchmarks.simulated_link import SimulatedLink, arrivals, sent_packets

COUNT = 60


@pytest.fixture(scope="module")
def call(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("calls") / "call.rzo"
    write_call(path, COUNT)
    return path


def test_packets_are_sent_at_their_own_time_with_their_number(call: Path) -> None:
    sent = sent_packets(call)
    assert [each.number for each in sent] == [0, *range(COUNT), COUNT]
    times = [each.sent_s for each in sent[1:-1]]
    assert times == pytest.approx([8 * k / BASE.call.fps for k in range(COUNT)])


def test_a_link_loses_its_share_and_repeats_what_it_lost(call: Path) -> None:
    sent = sent_packets(call)
    lost = sum(
        len(sent) - len(arrivals(sent, SimulatedLink(loss=0.25, repeats=False), seed))
        for seed in range(20)
    )
    assert 0.2 < lost / (20 * COUNT) < 0.3
    for seed in range(5):
        came = arrivals(sent, SimulatedLink(loss=0.25), seed)
        assert len(came) == len(sent)
        assert came == sorted(came, key=lambda arrival: arrival.time_s)
        assert came == arrivals(sent, SimulatedLink(loss=0.25), seed)


def test_losses_in_bursts_are_as_many_but_in_a_row(call: Path) -> None:
    sent = sent_packets(call)
    link, rows, lost = SimulatedLink(loss=0.25, burst=3, repeats=False), 0, 0
    for seed in range(30):
        numbers = {each.number for each in arrivals(sent, link, seed)[1:-1]}
        missing = [k not in numbers for k in range(COUNT)]
        lost += sum(missing)
        rows += sum(missing[k] and not (k and missing[k - 1]) for k in range(COUNT))
    assert 0.18 < lost / (30 * COUNT) < 0.32
    assert 2.2 < lost / rows < 3.8
