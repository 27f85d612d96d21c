"""Player and decoder make the same of what a link delivers late, twice or never."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from call_kinds import SmallCall, call_of_kind
from conftest import MakeOnce
from played_integers import Event, Played, played_file, played_link, write_events
from player_process import check_same

from benchmarks.simulated_link import SimulatedLink, arrivals, sent_packets
from protocol.link.interface import Arrival
from protocol.packets import PacketKind, packet_kind

# How often a page looks whether it has to show something although nothing comes.
POLL_S = 0.1
# Then packets that are missing are no longer waited for; then the face is held.
PATIENCE_S, SILENCE_S = 3.0, 33.0


@pytest.fixture
def small_call(slow_clip: Path, live_call: Path, make_once: MakeOnce) -> SmallCall:
    """A call of a kind by its name."""
    return partial(call_of_kind, make_once, slow_clip, live_call)


def over_link(path: Path, link: SimulatedLink, seed: int = 1) -> list[Arrival]:
    return arrivals(sent_packets(path), link, seed)


def with_polls(arriving: Sequence[Arrival], silence_s: float = PATIENCE_S) -> list[Event]:
    """Arrivals in order of time, between them and behind them the times of polls."""
    events, poll_s = list[Event](), POLL_S / 3
    for arrival in sorted(arriving, key=lambda each: each.time_s):
        while poll_s < arrival.time_s:
            events.append(poll_s)
            poll_s += POLL_S
        events.append(arrival)
    ending = [poll_s + POLL_S * count for count in range(round(PATIENCE_S / POLL_S))]
    return [*events, *ending, poll_s + silence_s]


def check_events(events: Sequence[Event], folder: Path) -> Played:
    played, path = played_link(events), folder / "events.json"
    write_events(path, events)
    check_same(path, played)
    return played


def lost_frames(played: Played) -> int:
    return sum(frame[4] for frame in played.frames)


LINKS = {
    "good": SimulatedLink(),
    "uneven": SimulatedLink(jitter_s=0.4, duplicates=0.3),
    "repeating": SimulatedLink(loss=0.3, delay_s=0.2, jitter_s=0.3),
    "lossy": SimulatedLink(loss=0.3, burst=3, repeats=False),
}
SENT = ("live_call", "call", "picture residual", "late layers", "voice of 700", "found again")


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("name", SENT)
def test_links_that_lose_delay_and_repeat(
    name: str, link: str, small_call: SmallCall, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    is_fixture = name in ("live_call", "call")
    path = request.getfixturevalue(name) if is_fixture else small_call(name)
    played = check_events(with_polls(over_link(path, LINKS[link], 3)), tmp_path)
    assert played.ended and not played.damages
    if link == "good":
        frames = [frame[1:] for frame in played.frames]
        assert frames == [frame[1:] for frame in played_file(path).frames]


@pytest.mark.parametrize("link", ["good", "uneven"])
def test_speech_has_its_times(link: str, small_call: SmallCall, tmp_path: Path) -> None:
    arriving = over_link(small_call("voice of opus"), LINKS[link], 3)
    played = check_events(with_polls(arriving), tmp_path)
    assert len(played.spoken) > 10 and not played.damages


def test_a_face_is_led_back_after_a_packet_that_comes_late(live_call: Path, tmp_path: Path) -> None:
    arriving, late_s = over_link(live_call, SimulatedLink()), 1.1
    place = [i for i, each in enumerate(arriving) if is_frame(each)][1]
    late = replace(arriving[place], time_s=arriving[place].time_s + late_s)
    rest = arriving[:place] + arriving[place + 1 :]
    played = check_events(with_polls([*rest, late]), tmp_path)
    assert 0 < lost_frames(played) < 20
    never = played_link(with_polls(rest))
    true = played_file(live_call)
    differs = [
        face_of(one) != face_of(each) for one, each in zip(played.frames, true.frames, strict=True)
    ]
    # It comes back in steps: neither as it would be without the packet nor as it is at once.
    assert played.frames != never.frames and sum(differs) > lost_frames(played) + 2
    assert not any(differs[-10:])


def face_of(frame: list[int]) -> list[int]:
    """Pose and actuators of a frame, and what follows."""
    return frame[7:]


def is_frame(arrival: Arrival) -> bool:
    return packet_kind(arrival.data) is PacketKind.FRAME


def test_an_encoder_starts_again(live_call: Path, tmp_path: Path) -> None:
    arriving = over_link(live_call, LINKS["uneven"])
    first = [each for each in arriving if each.time_s < 1.2]
    again = [replace(each, session=1, time_s=each.time_s + 3.1) for each in arriving]
    played = check_events(with_polls([*first, *again, *first[-2:]]), tmp_path)
    indices = [frame[1] for frame in played.frames]
    assert indices == list(range(len(indices))) and len(indices) > 140 and lost_frames(played)


def test_a_silence_is_filled(live_call: Path, tmp_path: Path) -> None:
    arriving = [each for each in over_link(live_call, LINKS["good"]) if each.time_s < 1.2]
    played = check_events(with_polls(arriving, SILENCE_S), tmp_path)
    assert lost_frames(played) > 25 and not played.ended


def test_who_joins_late_gets_the_pictures_of_the_model_before_afterwards(
    live_call: Path, tmp_path: Path
) -> None:
    arriving = over_link(live_call, LINKS["good"])
    models = [i for i, each in enumerate(arriving) if packet_kind(each.data) is PacketKind.MODEL]
    assert len(models) > 1
    joined = arriving[models[1] :]
    before = replace(arriving[models[0]], time_s=joined[0].time_s + 0.3)
    played = check_events(with_polls([*joined, before]), tmp_path)
    assert played.frames[0][1] > 0 and played.ended
