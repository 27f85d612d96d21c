"""Learned measures by networks of the user: LPIPS (Zhang et al. 2018), DISTS (Ding et al. 2020)."""

import subprocess
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from loopback.judge.observer import MediaPipeJudge, Observer
from shared_model.errors import UserError

Picture = NDArray[np.uint8]

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
    command, pipe = [str(observer.python), program, str(network), *numbers], subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe) as process:
        assert process.stdin and process.stdout and process.stderr
        said: list[bytes] = []
        complaints = process.stderr
        reader = threading.Thread(target=lambda: said.append(complaints.read()))
        reader.start()
        _write(process.stdin, pairs)
        result = process.stdout.read()
        reader.join()
    if process.returncode:
        words = said[0].decode(errors="replace").strip().splitlines()
        raise UserError(f"{network} gives no {measure}: {words[-1] if words else 'it failed'}")
    return float(result)


def _write(stream: IO[bytes], pairs: Iterable[tuple[Picture, Picture]]) -> None:
    try:
        for pair in pairs:
            for picture in pair:
                stream.write(np.ascontiguousarray(picture).tobytes())
        stream.close()
    except BrokenPipeError:
        return  # It has ended, and says why.
