"""Speed of the stages of both ends against fixed work: python -m benchmarks speed_ratios

Encodes a clip live and recorded, decodes both calls, and prints the CPU time of each stage a frame
as a multiple of that of a fixed piece of NumPy work, measured in between: a faster or busier
machine changes both.  Where a ratio is above `TOLERANCE` times that of the file of expected ratios,
the stage is named and the exit code is 1.  --write makes that file anew.
"""

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.command import run
from decoder.pipeline import DecodeOptions, decode
from encoder.compiled_loops import compile_loops
from encoder.options import EncodeOptions
from encoder.pipeline import encode
from loopback.clip_paths import CARPHONE, clip_path
from loopback.report import Cell, table
from loopback.toml_file import read_toml
from runtime.parallel import one_blas_thread

EXPECTED, TOLERANCE = Path(__file__).with_name("expected.toml"), 1.5
# Stages below this many ms a frame are left out: a clock's tick is a large part of them.
LEAST_MS = 0.1
# Side of the reference's matrices, length of its vector, and how often it is timed.
SIDE, LENGTH, REPETITIONS = 192, 50_000, 40

Ratios = dict[str, float]


def main(arguments: Sequence[str]) -> None:
    """Measure, print, and compare or write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("clip", nargs="?", default=CARPHONE, help="default: that of the demo")
    parser.add_argument("--max-frames", type=int, default=100, help="only so many (default: 100)")
    parser.add_argument("--expected", type=Path, default=EXPECTED, help="file of expected ratios")
    parser.add_argument("--write", action="store_true", help="write that file, compare nothing")
    options = parser.parse_args(arguments)
    expected = {} if options.write else read_toml(options.expected, "a file of expected ratios")
    ratios = measure_ratios(str(clip_path(options.clip, Path())), options.max_frames)
    print(comparison(ratios, expected))
    if options.write:
        lines = [f'"{stage}" = {ratio:.2f}\n' for stage, ratio in ratios.items()]
        options.expected.write_text("".join(lines))
    if slow := slower_stages(ratios, expected):
        print(f"slower than {TOLERANCE:g} times what is expected: {', '.join(slow)}")
        sys.exit(1)


def measure_ratios(clip: str, max_frames: int) -> Ratios:
    """CPU time a frame of each stage of both ends, in units of `reference_ms`."""
    compile_loops()
    stages: dict[str, float] = {}
    references: list[float] = []
    with TemporaryDirectory() as folder, one_blas_thread():
        for kind in ("live", "recorded"):
            call = Path(folder, f"{kind}.rzo")
            references.append(reference_ms())
            options = EncodeOptions(clip, call, live=kind == "live", max_frames=max_frames)
            encoded = encode(options, lambda done, total: None, lambda: False)
            references.append(reference_ms())
            decoded = decode(DecodeOptions(call), lambda done, total: None, lambda: False)
            for end, report in (("encoder", encoded), ("decoder", decoded)):
                for stage, ms in report.stages.stage_cpu_ms.items():
                    stages[f"{end}, {kind}, {stage}"] = ms
    reference = float(np.median([*references, reference_ms()]))
    return {stage: ms / reference for stage, ms in stages.items() if ms >= LEAST_MS}


def reference_ms() -> float:
    """Median CPU time of a product of matrices and the sorting of a vector, ms."""
    rng = np.random.default_rng(0)
    matrix, vector = rng.random((SIDE, SIDE), np.float32), rng.random(LENGTH)
    times = []
    for _ in range(REPETITIONS):
        begin = time.thread_time()
        np.sort(np.sqrt(vector))
        np.matmul(matrix, matrix)
        times.append(time.thread_time() - begin)
    return 1000 * float(np.median(times))


def slower_stages(ratios: Mapping[str, float], expected: Mapping[str, float]) -> list[str]:
    """The stages whose ratio is more than `TOLERANCE` times the expected one."""
    return [name for name in ratios if ratios[name] > TOLERANCE * expected.get(name, np.inf)]


def comparison(ratios: Mapping[str, float], expected: Mapping[str, float]) -> str:
    """A table of the ratios beside those that are expected."""
    rows: list[list[Cell]] = [[name, ratio, expected.get(name)] for name, ratio in ratios.items()]
    return table(("stage", "ratio", "expected"), rows)


if __name__ == "__main__":
    run(main)
