"""A child process has the caller's modules, one thread for sums, and a socket to talk by."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from processes import LIMIT_S

from runtime.child_process import start_child, start_early

CHILD = """
import json, os, socket
import numpy as np
from threadpoolctl import threadpool_info

def serve(descriptor, *arguments):
    threads = [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]
    with socket.socket(fileno=descriptor) as connection:
        connection.sendall(json.dumps([threads, arguments, os.getsid(0) == os.getpid()]).encode())
"""


def test_a_child_says_what_it_has(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "some_child.py").write_text(CHILD)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(os.environ, "OPENBLAS_NUM_THREADS", raising=False)
    process, connection = start_child("some_child", ["it's", "so"])
    with connection, connection.makefile() as file:
        said = file.read()
    assert process.wait(LIMIT_S) == 0
    assert said == '[[1], ["it\'s", "so"], true]'


def test_a_child_that_was_started_early_is_the_one_that_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "some_child.py").write_text(CHILD)
    monkeypatch.syspath_prepend(str(tmp_path))
    start_early("some_child")
    start_early("some_child")
    process, connection = start_child("some_child")
    another, other_connection = start_child("some_child")
    assert process.pid < another.pid
    for each, its_connection in ((process, connection), (another, other_connection)):
        with its_connection, its_connection.makefile() as file:
            assert file.read().endswith("[], true]")
        assert each.wait(LIMIT_S) == 0


def test_a_child_that_nobody_asks_for_ends_with_its_parent(tmp_path: Path) -> None:
    (tmp_path / "sleeper.py").write_text("import time\ndef serve(descriptor): time.sleep(999)\n")
    code = (
        "from runtime import child_process as c; c.start_early('sleeper');"
        "print(c._early['sleeper'][0].pid)"
    )
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}:{Path(__file__).parents[2]}"}
    told = subprocess.check_output([sys.executable, "-c", code], text=True, env=environment)
    with pytest.raises(ProcessLookupError):
        os.kill(int(told), 0)
