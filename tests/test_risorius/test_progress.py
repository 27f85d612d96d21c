"""The progress line on a terminal and in a log."""

import io

from risorius.command_line.progress import ProgressLine


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_log_gets_a_line_now_and_then_and_none_for_a_short_job() -> None:
    stream, clock = io.StringIO(), Clock()
    with ProgressLine("encode", stream, clock=clock) as progress:
        for done in range(1, 26):
            clock.now = float(done)
            progress(done, None)
    assert stream.getvalue() == "encode 10 frames 1/s\nencode 20 frames 1/s\n"


def test_a_terminal_gets_a_bar_that_ends_full() -> None:
    stream, clock = Terminal(), Clock()
    with ProgressLine("decode", stream, clock=clock) as progress:
        for done in range(1, 101):
            clock.now += 0.01
            progress(done, 100)
    drawn = stream.getvalue()
    assert drawn.endswith(f"decode |{'#' * 30}| 100/100 100/s\n")
    assert drawn.count("\r") < 15


def test_a_terminal_is_told_at_once_what_is_prepared_and_when_that_is_over() -> None:
    stream, clock = Terminal(), Clock()
    with ProgressLine("encode", stream, clock=clock) as progress:
        progress.preparing("first pass")
        clock.now = 1.0
        progress(60, 120)
        progress.preparing("training the model")
        progress.preparing("")
        drawn = [line.partition("| ")[2] for line in stream.getvalue().split("\r\x1b[K")]
    rate = "60/120 60/s"
    assert "encode: first pass ..." in stream.getvalue()
    assert drawn == ["", "", f"{rate}, first pass", f"{rate}, training the model", rate]


def test_a_terminal_says_what_goes_on_before_there_is_a_bar() -> None:
    terminal, log = Terminal(), io.StringIO()
    for stream in (terminal, log):
        with ProgressLine("encode", stream, clock=Clock()) as progress:
            progress.preparing("starting")
            progress.preparing("")
            progress.say("hear")
            progress.preparing("first pass")
    start = "\r\x1b[Kencode: starting ..."
    first_pass = "\r\x1b[Kencode: first pass ..."
    assert terminal.getvalue() == f"{start}\r\x1b[Kencode: hear\n{first_pass}\r\x1b[K"
    assert log.getvalue() == "encode: hear\n"


def test_a_line_that_stays_takes_the_place_of_the_bar() -> None:
    terminal, log = Terminal(), io.StringIO()
    for stream in (terminal, log):
        with ProgressLine("encode", stream, clock=Clock()) as progress:
            progress.say("hear")
            progress(1, None)
            progress.say("hear")
    bar = "\r\x1b[Kencode 1 frames 1000000/s"
    assert terminal.getvalue() == f"encode: hear\n{bar}\r\x1b[Kencode: hear\n{bar}\n"
    assert log.getvalue() == "encode: hear\nencode: hear\n"


def test_quiet_is_quiet() -> None:
    stream = Terminal()
    with ProgressLine("decode", stream, quiet=True) as progress:
        progress(1, 1)
        progress.preparing("more")
        progress.say("this")
    assert stream.getvalue() == ""
