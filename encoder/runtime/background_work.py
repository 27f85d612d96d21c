"""Work beside the frames of a live call, in the time that these leave over."""

import os
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

# How much the frames go before, as the system counts niceness.
NICE = 5


def threads_beside(count: int) -> ThreadPoolExecutor:
    """Threads that let others go first, where the system tells threads apart."""
    return ThreadPoolExecutor(count, initializer=_step_back)


def _step_back() -> None:
    if sys.platform == "linux":
        nice = os.getpriority(os.PRIO_PROCESS, 0) + NICE
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), nice)
