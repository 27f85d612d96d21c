"""Learned measures by networks of the user: LPIPS (Zhang et al. 2018), DISTS (Ding et al. 2020)."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from loopback.judge.observer import MediaPipeJudge, Observer
from loopback.judge.programs import run_program
from shared_model.arrays import Picture
from shared_model.errors import UserError

# The value of black in what each network takes; white is 1.
BLACK = {"lpips": -1.0, "dists": 0.0}


def learned_distance(
    measure: str,
    network: Path,
    observer: Observer,
    pairs: Iterable[tuple[Picture, Picture]],
    size: tuple[int, int],
) -> float:
    """The mean distance of pictures (h, w, 3) uint8 BGR, original and copy; 0: they are the same.

    measure: of `BLACK`.  network: an ONNX file, see `learned_program`.  size: (width, height).
    Raises `UserError` without a judge, or if the network cannot be run.
    """
    if not isinstance(observer, MediaPipeJudge):
        raise UserError(f"{measure} is measured by the judge's environment; make judge")
    if not network.is_file():
        raise UserError(f"cannot read {network}: no such file")
    program = str(Path(__file__).with_name("learned_program.py"))
    numbers = [str(value) for value in (*size, BLACK[measure])]
    command = [str(observer.python), program, str(network), *numbers]
    pieces = (np.ascontiguousarray(each).tobytes() for pair in pairs for each in pair)
    result = run_program(command, pieces, f"{network} gives no {measure}")
    return float(result)
