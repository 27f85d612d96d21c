"""A child process has the caller's modules, one thread for sums, and a socket to talk by."""

import os
from pathlib import Path

import pytest
from processes import LIMIT_S

from runtime.child_process import start_child

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
