"""After a warm-up nothing is left to be compiled or loaded when frames come."""

from dataclasses import dataclass
from pathlib import Path

import pytest
from call_contents import played
from late_loops import late_loops

# A live call needs the time to learn an update.
FRAMES = 60
LIVE = """
from encoder.live_model import learning_process
from encoder.options import EncodeOptions
from encoder.pipeline import encode
warmed_up, warm_up = [], learning_process.warm_up
def warm_up_and_count(*arguments):
    drawn = warm_up(*arguments)
    warmed_up.append(versions())
    return drawn
learning_process.warm_up = warm_up_and_count
options = EncodeOptions(str(source), output, live=True, pace=True, max_frames={frames})
encode(options, lambda done, total: None, lambda: False)
(before,) = warmed_up
"""


@dataclass(frozen=True, slots=True)
class Paced:
    """A live call at the source's rate, and what it has compiled after it began."""

    call: Path
    late: list[str]


@pytest.fixture(scope="module")
def paced(talking_clip: Path, tmp_path_factory: pytest.TempPathFactory) -> Paced:
    call = tmp_path_factory.mktemp("paced") / "call.rzo"
    return Paced(call, late_loops(LIVE.format(frames=FRAMES), talking_clip, call))


def test_a_live_call_compiles_nothing_once_it_has_begun(paced: Paced) -> None:
    assert paced.late == []


def test_training_in_the_background_loses_no_frame(paced: Paced) -> None:
    assert [frame.index for frame in played(paced.call)] == list(range(FRAMES))
