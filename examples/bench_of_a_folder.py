"""Our rate and quality, and those of another codec, for each video of a folder.

python examples/bench_of_a_folder.py clips out
"""

import sys
from pathlib import Path

from loopback.clip_paths import videos_in
from loopback.curves.contenders import Rung
from loopback.curves.curve_bench import OURS, CurveSettings, bench_curves


def main(folder: str, out: str, max_frames: int = 100) -> None:
    settings = CurveSettings((Rung(300), Rung(800)), ("x264",), max_frames=max_frames)
    clips, judge, failures = bench_curves(videos_in(folder), settings, Path(out), print)
    for name, contenders in clips.items():
        for codec in (OURS, "x264"):
            for point in contenders[codec]:
                rate = point.total_bps(60) / 1000
                print(f"{name}: {codec}, {point.label}: {rate:.1f} kbit/s, {point.figures}")
    print(f"measured by {judge}; {len(failures)} failed")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
