"""Calls to another process: what fails there is told once, and never ends what asks for it."""

import threading
from queue import Empty, SimpleQueue

import pytest
from processes import LIMIT_S

from runtime.remote_calls import RemoteCalls
from shared_model.errors import NO_FACE, UserError


def test_results_and_mistakes_of_the_user_are_for_whoever_asks() -> None:
    lines = list[str]()
    calls = RemoteCalls("failing_object", lines.append)
    try:
        assert calls.call("add", 1, 2).result(LIMIT_S) == 3
        mistake = calls.call("mistake").exception(LIMIT_S)
        assert isinstance(mistake, UserError) and mistake.exit_code == NO_FACE
        assert calls.call("add", 4, 5).result(LIMIT_S) == 9
    finally:
        calls.close()
    assert lines == []


@pytest.mark.parametrize(
    ("method", "arguments", "said"),
    [
        ("fault", (), "the failing object has failed (ArithmeticError('of ours'))"),
        ("unsendable", (), "the failing object has failed (TypeError("),
        ("unsendable_mistake", (), "the failing object has failed (TypeError("),
        ("unreadable", (), "what the failing object has sent cannot be read"),
        ("crash", (), "the failing object has ended (1)"),
        ("add", (threading.Lock(),), "the failing object cannot be asked (TypeError"),
    ],
)
def test_a_failure_is_told_once_and_whoever_asks_goes_on(
    method: str, arguments: tuple[object, ...], said: str
) -> None:
    lines = SimpleQueue[str]()
    calls = RemoteCalls("failing_object", lines.put)
    try:
        awaited, unawaited = calls.call_awaited("never"), calls.call("never")
        failing = calls.call(method, *arguments)
        assert said in lines.get(timeout=LIMIT_S)
        # A call asks whether it is done, and sends its packets and its end meanwhile.
        assert not failing.done() and not unawaited.done() and not calls.call("never").done()
        for result in (awaited, calls.call_awaited("add", 1)):
            assert isinstance(result.exception(LIMIT_S), ChildProcessError)
    finally:
        calls.close()
    with pytest.raises(Empty):
        lines.get(timeout=0.1)


def test_results_under_way_end_when_a_later_call_cannot_be_sent() -> None:
    lines = SimpleQueue[str]()
    calls = RemoteCalls("failing_object", lines.put)
    try:
        results = [calls.call_awaited("add", each) for each in range(300)]
        calls.call("add", threading.Lock())
        errors = [result.exception(LIMIT_S) for result in results]
        assert all(isinstance(error, ChildProcessError | None) for error in errors)
        assert "cannot be asked" in lines.get(timeout=LIMIT_S)
    finally:
        calls.close()
