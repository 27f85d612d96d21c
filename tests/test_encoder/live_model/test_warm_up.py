"""After a warm-up nothing is left to be compiled or loaded when frames come."""

from pathlib import Path

from late_loops import late_loops
from shots import draw, talking

LIVE = """
from encoder.live_model import learning_process
from encoder.options import EncodeOptions
from encoder.pipeline import encode
warmed_up, warm_up = [], learning_process.warm_up
def warm_up_and_count(*arguments):
    warm_up(*arguments)
    warmed_up.append(versions())
learning_process.warm_up = warm_up_and_count
options = EncodeOptions(str(source), output, profile="default", live=True, pace=True)
encode(options, lambda done, total: None, lambda: False)
(before,) = warmed_up
"""


def test_a_live_call_compiles_nothing_once_it_has_begun(networks: Path, tmp_path: Path) -> None:
    # A live call needs the time to learn an update.
    draw(tmp_path / "clip.mkv", talking(2))
    assert late_loops(LIVE, tmp_path / "clip.mkv", tmp_path / "call.rzo") == []
