"""An object in a process of its own whose methods fail in the ways that there are."""

import threading
from concurrent.futures import Future

from runtime.remote_calls import answer_calls
from shared_model.errors import NO_FACE, UserError


class TwoWordedError(UserError):
    """Cannot be unpickled, as many exceptions with a constructor of their own."""

    def __init__(self, one: str, other: str) -> None:
        super().__init__(f"{one} {other}")


class Failing:
    """Does what it is asked, or not."""

    def add(self, *numbers: int) -> "Future[int]":
        """Their sum."""
        done = Future[int]()
        done.set_result(sum(numbers))
        return done

    def never(self) -> "Future[int]":
        """Nothing, as long as anybody waits."""
        return Future()

    def mistake(self) -> "Future[int]":
        """A mistake of the user, and the word for it."""
        return failed(UserError("no face", NO_FACE))

    def unsendable(self) -> "Future[object]":
        """What cannot be pickled."""
        done = Future[object]()
        done.set_result(threading.Lock())
        return done

    def unsendable_mistake(self) -> "Future[int]":
        """A mistake of the user that cannot be pickled."""
        error = UserError("no face", NO_FACE)
        error.culprit = threading.Lock()  # type: ignore[attr-defined]
        return failed(error)

    def unreadable(self) -> "Future[int]":
        """What cannot be unpickled."""
        return failed(TwoWordedError("cannot", "read"))

    def fault(self) -> "Future[int]":
        """A fault of ours, which cannot even be pickled."""
        error = ArithmeticError("of ours")
        error.add_note("a note")
        error.culprit = lambda: None  # type: ignore[attr-defined]
        return failed(error)

    def crash(self) -> None:
        """A fault where nobody expects a result."""
        raise ArithmeticError("of ours")


def failed(error: Exception) -> "Future[int]":
    """A result that is an error."""
    result = Future[int]()
    result.set_exception(error)
    return result


def serve(descriptor: int) -> None:
    """See `RemoteCalls`."""
    answer_calls(descriptor, Failing())
