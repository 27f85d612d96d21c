"""A program on slower clocks sees its waits as long as it has asked for; they last longer."""

import shutil
import subprocess
import sys
import time

import pytest

# Prints what the program sees of waits of .1 s each, by two clocks, and of work of .1 s.
PROGRAM = """
import asyncio, queue, select, threading, time
def seen(work):
    start = time.monotonic(), time.time()
    work()
    print(*(f"{end - begin:.3f}" for begin, end in zip(start, (time.monotonic(), time.time()))))
def empty():
    try:
        queue.SimpleQueue().get(timeout=0.1)
    except queue.Empty:
        pass
def work():
    end_s = time.process_time() + 0.1
    while time.process_time() < end_s:
        pass
seen(lambda: time.sleep(0.1))
seen(lambda: threading.Event().wait(0.1))
seen(empty)
seen(lambda: select.select([], [], [], 0.1))
seen(lambda: asyncio.run(asyncio.sleep(0.1)))
seen(work)
"""
RATE, WAITS, WAIT_S = 0.2, 6, 0.1


@pytest.mark.skipif(
    sys.platform != "linux" or not shutil.which("cc"), reason="needs Linux and a C compiler"
)
def test_waits_are_as_long_as_asked_by_slower_clocks() -> None:
    command = [sys.executable, "-m", "benchmarks", "slow_clock", str(RATE), sys.executable, "-c"]
    start_s = time.monotonic()
    done = subprocess.run([*command, PROGRAM], capture_output=True, text=True, check=True)
    took_s = time.monotonic() - start_s
    waits = [tuple(map(float, line.split())) for line in done.stdout.splitlines()]
    assert len(waits) == WAITS
    for monotonic_s, real_time_s in waits:
        assert monotonic_s >= WAIT_S - 0.001 and abs(monotonic_s - real_time_s) < 0.01
    assert took_s >= WAITS * (WAIT_S - 0.001) / RATE


def test_clocks_are_not_made_faster() -> None:
    command = [sys.executable, "-m", "benchmarks", "slow_clock", "1.5", "true"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2 and "only made slower" in done.stderr
