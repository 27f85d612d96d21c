"""A `Learner` in a process of its own, so that learning never holds the interpreter of the frames.

The process is started once for a call and has a lower priority.  It ends with the call, and with
the process that started it.
"""

import os
import signal
import socket
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import suppress
from functools import partial
from itertools import count
from typing import Any

from encoder.capture.video_source import VideoFormat
from encoder.coding.background import Background
from encoder.coding.gop import GopStructure
from encoder.learning.incremental_modes import LearnedMode
from encoder.live_model import LEARNING_PROCESS
from encoder.live_model.learner import LocalLearner, ModesTask, TrainingTask
from encoder.live_model.model_trainer import ModelTrainer
from encoder.live_model.model_version import ModelVersion
from encoder.live_model.warm_up import warm_up
from runtime.child_process import start_child
from runtime.object_stream import ObjectStream
from runtime.parallel import (
    low_priority_executor,
    lower_priority_of_process,
    short_switch_interval,
)
from shared_model.mesh import generic_head
from shared_model.surround import head_with_surround

# An update may come half a second later, a mode must not: with 2 a mode takes a third longer while
# an update is trained.
TRAINING_NICENESS = 9
# Heads are large, and both processes have them.
SHARED = {"generic head": generic_head, "head with surround": head_with_surround}


class LearningProcess:
    """A `Learner` in a process of its own.

    on_failure: called once with a line if the process ends by itself or cannot be understood;
        nothing more is learned.
    """

    def __init__(self, on_failure: Callable[[str], None]) -> None:
        self._process, ours = start_child(LEARNING_PROCESS)
        self._stream, self._on_failure = ObjectStream(ours, SHARED), on_failure
        self._numbers, self._waiting = count(), dict[int, Future[Any]]()
        self._is_closing = self._has_ended = False
        # Results that a call waits for: they fail when the process ends.
        self._ending, self._awaited = threading.Lock(), list[Future[Any]]()
        # Objects are put together and sent in a thread of their own.
        self._sender = ThreadPoolExecutor(1)
        threading.Thread(target=self._receive, daemon=True).start()

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def warm_up(self, video: VideoFormat, gop: GopStructure) -> None:
        """Warm up the learning process and its caller for a source, see `warm_up`."""
        other = self._send_awaited("warm_up", video, gop)
        warm_up(head_with_surround(), video, gop)
        wait([other])

    def encode_background(self, background: Background, max_bytes: int) -> "Future[bytes]":
        """See `Learner`.

        A call waits for this: it fails with `ChildProcessError` if the process is gone, where other
        results are never done.
        """
        return self._send_awaited("encode_background", background, max_bytes)

    def begin(self, trainer: ModelTrainer) -> None:
        """See `Learner`."""
        self._send("begin", trainer)

    def train(self, task: TrainingTask) -> "Future[ModelVersion]":
        """See `Learner`."""
        return self._send("train", task)

    def start_modes(self, version: ModelVersion, samples_per_s: float) -> None:
        """See `Learner`."""
        self._send("start_modes", version, samples_per_s)

    def learn(self, task: ModesTask) -> "Future[list[LearnedMode]]":
        """See `Learner`."""
        return self._send("learn", task)

    def close(self) -> None:
        """End the process; closing twice has no further effect."""
        self._is_closing = True
        self._process.kill()
        self._process.wait()
        self._sender.shutdown(cancel_futures=True)
        self._stream.close()

    def _send(self, method: str, *arguments: object) -> "Future[Any]":
        future = Future[Any]()
        number = next(self._numbers)
        self._waiting[number] = future
        self._sender.submit(self._send_now, number, method, arguments)
        return future

    def _send_awaited(self, method: str, *arguments: object) -> "Future[Any]":
        with self._ending:
            future = self._send(method, *arguments)
            if self._has_ended:
                future.set_exception(ChildProcessError())
            else:
                self._awaited.append(future)
        return future

    def _send_now(self, number: int, method: str, arguments: tuple[object, ...]) -> None:
        try:
            self._stream.send((number, method, arguments))
        except OSError:
            # A process that is gone is noticed where its results are received.
            return
        except Exception as error:
            # An argument that cannot be pickled: for whoever asks for the result.
            self._waiting.pop(number).set_exception(error)

    def _receive(self) -> None:
        try:
            while True:
                number, result, error = self._stream.receive()
                future = self._waiting.pop(number)
                if error is None:
                    future.set_result(result)
                else:
                    future.set_exception(error)
        except EOFError:
            if not self._is_closing:
                self._fail(f"the learning process has ended ({self._process.wait()})")
        except Exception as error:
            # Whatever unpickling raises.
            self._process.kill()
            self._fail(f"what the learning process has sent cannot be read ({error!r})")

    def _fail(self, reason: str) -> None:
        with self._ending:
            self._has_ended = True
            for future in self._awaited:
                if not future.done():
                    future.set_exception(ChildProcessError())
        self._on_failure(f"{reason}: nothing more is learned")


def serve(descriptor: int) -> None:
    """Learn for the process at the other end of a socket until it is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    lower_priority_of_process()
    # Modes are learned beside the training of an update: neither may hold the interpreter for long.
    with short_switch_interval():
        _Server(ObjectStream(socket.socket(fileno=descriptor), SHARED)).run()
    # What is under way is of no use any more.
    os._exit(0)


class _Server:
    def __init__(self, stream: ObjectStream) -> None:
        self._stream, self._lock = stream, threading.Lock()
        training = low_priority_executor(1, TRAINING_NICENESS)
        self._learner = LocalLearner(training, ThreadPoolExecutor(1))

    def run(self) -> None:
        with suppress(EOFError):
            while True:
                number, method, arguments = self._stream.receive()
                result = getattr(self._learner, method)(*arguments)
                if isinstance(result, Future):
                    result.add_done_callback(partial(self._answer, number))
                else:
                    self._reply(number, None, None)

    def _answer(self, number: int, done: "Future[Any]") -> None:
        error = done.exception()
        self._reply(number, None if error else done.result(), error)

    def _reply(self, number: int, result: object, error: BaseException | None) -> None:
        with self._lock, suppress(OSError):
            self._stream.send((number, result, error))
