"""Work beside the frames of a live call, in the time that these leave over."""

import os
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

# How much the frames go before, as the system counts niceness.
NICE = 5
# A thread that wants to go on waits no longer than this for one that computes.
SWITCH_S = 0.0002


def threads_beside(count: int) -> ThreadPoolExecutor:
    """Threads that let others go first, where the system tells threads apart."""
    sys.setswitchinterval(SWITCH_S)
    return ThreadPoolExecutor(count, initializer=_step_back)


def _step_back() -> None:
    with suppress(AttributeError, OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)
