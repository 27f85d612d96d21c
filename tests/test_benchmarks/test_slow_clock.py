"""A program on slower clocks sees its waits as long as it has asked for."""

import shutil
import subprocess
import sys

import pytest

PROGRAM = """
import asyncio, queue, select, threading, time
def wait(work):
    start = time.monotonic(), time.time()
    work()
    print(*(f"{end - begin:.3f}" for begin, end in zip(start, (time.monotonic(), time.time()))))
def empty():
    try:
        queue.SimpleQueue().get(timeout=0.2)
    except queue.Empty:
        pass
wait(lambda: time.sleep(0.2))
wait(lambda: threading.Event().wait(0.2))
wait(empty)
wait(lambda: select.select([], [], [], 0.2))
wait(lambda: asyncio.run(asyncio.sleep(0.2)))
"""
# How much longer a wait may last on a busy machine.
LATE_S = 5.0


@pytest.mark.skipif(
    sys.platform != "linux" or not shutil.which("cc"), reason="needs Linux and a C compiler"
)
def test_waits_are_as_long_as_asked_by_slower_clocks() -> None:
    command = [sys.executable, "-m", "benchmarks", "slow_clock", "0.05"]
    done = subprocess.run(
        [*command, sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True
    )
    waits = [tuple(map(float, line.split())) for line in done.stdout.splitlines()]
    assert len(waits) == 5
    for monotonic_s, real_time_s in waits:
        assert 0.199 <= monotonic_s < 0.2 + LATE_S
        assert abs(monotonic_s - real_time_s) < 0.01


def test_clocks_are_not_made_faster() -> None:
    command = [sys.executable, "-m", "benchmarks", "slow_clock", "1000", "true"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "only made slower" in done.stderr
