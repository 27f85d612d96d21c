"""A fork server loads once, and becomes processes that have what it has loaded."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from processes import LIMIT_S

from runtime.child_process import Process, start_child, start_fork_server
from runtime.fork_server import ForkedChild, ForkServer, can_fork, current_server

pytestmark = pytest.mark.skipif(
    not can_fork(), reason="this system has no descriptors of processes"
)
# A module of children: what they say, and what was loaded before they began.
CHILD = """
import json, os, socket, time
from pathlib import Path
from runtime.child_process import start_child

loaded_by = None

def load():
    global loaded_by
    loaded_by = os.getpid()

def linger():
    time.sleep(999)

def serve(descriptor, *arguments):
    with socket.socket(fileno=descriptor) as connection:
        name = Path("/proc/self/comm").read_text().strip()
        said = [loaded_by, os.getppid(), os.getsid(0) == os.getpid(), name, *arguments]
        connection.sendall(json.dumps(said).encode())
        if arguments == ("parent",):
            process, other = start_child("some_child", ["child"])
            connection.sendall(other.recv(1000))
        elif arguments == ("stays",):
            connection.recv(1)
        elif arguments and isinstance(arguments[-1], int):
            os.write(arguments[-1], b"by its descriptor")
"""


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ForkServer:
    (tmp_path / "some_child.py").write_text(CHILD)
    monkeypatch.syspath_prepend(str(tmp_path))
    start_fork_server("some_child", "load")
    started = current_server()
    assert started is not None
    return started


def said_by(*arguments: str, descriptors: tuple[int, ...] = ()) -> tuple[Process, str]:
    process, connection = start_child("some_child", arguments, descriptors)
    with connection, connection.makefile() as file:
        return process, file.read()


def test_children_have_what_the_server_has_loaded(server: ForkServer) -> None:
    process, said = said_by("it's", "so")
    assert isinstance(process, ForkedChild)
    process.wait(LIMIT_S)
    loader, parent, *rest = json.loads(said)
    assert loader == parent != os.getpid() and rest == [True, "some_child", "it's", "so"]


def test_a_child_starts_children_by_the_same_server(server: ForkServer) -> None:
    _, said = said_by("parent")
    first, second = said.replace("][", "]|[").split("|")
    assert first.split(",")[:2] == second.split(",")[:2]


def test_a_child_gets_descriptors(server: ForkServer) -> None:
    read, written = os.pipe()
    said_by(descriptors=(written,))
    os.close(written)
    # Ends: the server has closed it as well.
    with os.fdopen(read) as file:
        assert file.read() == "by its descriptor"


def test_a_child_is_killed_and_waited_for(server: ForkServer) -> None:
    process, connection = start_child("some_child", ["stays"])
    assert connection.recv(1)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.01)
    process.kill()
    process.wait(LIMIT_S)
    with pytest.raises(ProcessLookupError):
        os.kill(process.pid, 0)
    process.kill()


def test_a_child_that_is_killed_before_it_is_there_ends(server: ForkServer, tmp_path: Path) -> None:
    wait = tmp_path / "wait"
    os.mkfifo(wait)
    (tmp_path / "waiting.py").write_text(f"def load(): open({str(wait)!r}).read()\n")
    server.run("waiting", "load")
    killed, connection = start_child("some_child", ["stays"])
    killed.kill()
    killed.wait(LIMIT_S)
    with pytest.raises(ChildProcessError):
        assert killed.pid
    wait.write_text("go on")
    # It may begin, but ends: whoever stays would keep its end of the connection open.
    connection.settimeout(LIMIT_S)
    with connection, connection.makefile() as file:
        file.read()


def test_children_of_a_server_that_has_failed_end_at_once(server: ForkServer) -> None:
    server.run("some_child", "nothing_of_that_name")
    process, said = said_by()
    process.wait(LIMIT_S)
    assert said == ""


def test_a_server_that_still_loads_ends_with_its_client(tmp_path: Path) -> None:
    (tmp_path / "some_child.py").write_text(CHILD)
    code = (
        "from runtime.child_process import start_child, start_fork_server;"
        "from runtime.fork_server import current_server;"
        "start_fork_server('some_child', 'load');"
        "process, _ = start_child('some_child', ['stays']);"
        "print(process.pid and open(f'/proc/{process.pid}/stat').read().split()[3]);"
        "current_server().run('some_child', 'linger')"
    )
    environment = {**os.environ, "PYTHONPATH": f"{tmp_path}:{Path(__file__).parents[2]}"}
    told = subprocess.check_output([sys.executable, "-c", code], text=True, env=environment)
    with pytest.raises(ProcessLookupError):
        os.kill(int(told), 0)


def test_without_descriptors_of_processes_children_start_afresh(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("runtime.child_process.can_fork", lambda: False)
    (tmp_path / "some_child.py").write_text(CHILD)
    monkeypatch.syspath_prepend(str(tmp_path))
    start_fork_server("some_child", "load")
    assert current_server() is None
    process, said = said_by("alone")
    assert isinstance(process, subprocess.Popen) and '"alone"' in said
    assert process.wait(LIMIT_S) == 0
