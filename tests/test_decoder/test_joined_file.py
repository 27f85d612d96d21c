"""A file that begins in the middle of a call is played at its time in it."""

from played_samples import control, model, play, sample

from decoder.playout.playout import Playout
from protocol.packets import ControlKind, ControlPacket, serialise


def test_a_file_that_begins_in_the_middle_says_where() -> None:
    """Packet 70 and those after it are told from those of the beginning; the end counts frames."""
    playout = Playout()
    packets = [control(ControlKind.JOINED, 175), sample(70), control(ControlKind.END, 4)]
    played = play([model((25, 1)), *packets], playout)
    assert [frame.index for frame in played] == [175, 176, 177, 178]
    assert not any(frame.lost for frame in played) and playout.ended
    assert playout.joined_late and playout.lost == playout.before_join == 0


def test_a_lost_face_is_found_at_its_time_in_a_file_that_begins_in_the_middle() -> None:
    lost, found = control(ControlKind.FACE_LOST, 701), control(ControlKind.FACE_FOUND, 900)
    joined, end = control(ControlKind.JOINED, 700), control(ControlKind.END, 201)
    played = play([model((10, 1)), joined, sample(700), lost, found, sample(900), end])
    assert [frame.index for frame in played] == list(range(700, 901))
    assert [frame.frozen for frame in played] == [False] + [True] * 199 + [False]


def test_a_call_that_goes_on_cannot_be_told_to_begin_elsewhere() -> None:
    playout, joined = Playout(), ControlPacket(0, ControlKind.JOINED, 50)
    play([model((10, 1)), sample(0), serialise(joined)], playout)
    assert len(play([sample(1)], playout)) == 1 and not playout.joined_late
    over_link = Playout()
    play([model((10, 1))], over_link)
    assert list(over_link.receive(joined, 0)) == [] and not over_link.joined_late
