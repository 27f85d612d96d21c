"""The containers' description is valid, and its very commands make a call, without Docker."""

import json
import re
import shlex
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import PROGRAM, ROOT, Start
from processes import LIMIT_S
from videos import copy_frames

from encoder.capture.video_source import open_source
from loopback.process_pair import free_port
from risorius.cli import build_parser

COMPOSE = ROOT / "docker-compose.yml"
DOCKERFILE = ROOT / "Dockerfile"
PARTS = ("encoder", "router", "decoder")
DEFAULT = re.compile(r"\$\{\w+:-([^}]*)\}")


@pytest.fixture(scope="module")
def services() -> dict[str, Any]:
    """The services by name, variables at their defaults."""
    text = DEFAULT.sub(r"\1", COMPOSE.read_text())
    content: dict[str, Any] = yaml.safe_load(text)["services"]
    return content


def test_the_file_obeys_the_compose_specification() -> None:
    pytest.importorskip("check_jsonschema")
    command = ["-m", "check_jsonschema", "--builtin-schema", "vendor.compose-spec", str(COMPOSE)]
    result = subprocess.run([sys.executable, *command], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout


@pytest.mark.parametrize("prefix", ["", "secure-"])
def test_there_are_an_encoder_a_router_and_a_decoder(prefix: str, services: dict[str, Any]) -> None:
    assert set(services) == {f"{p}{part}" for p in ("", "secure-") for part in PARTS} | {"keys"}
    for name in ("encoder", "decoder"):
        depends = services[prefix + name]["depends_on"]
        assert depends[f"{prefix}router"]["condition"] == "service_healthy"
    assert "./clips:/clips:ro" in services[f"{prefix}encoder"]["volumes"]
    assert "decoded:/out" in services[f"{prefix}decoder"]["volumes"]
    secure = {name for name, service in services.items() if service.get("profiles") == ["secure"]}
    assert secure == {"keys", *(f"secure-{part}" for part in PARTS)}


def test_every_service_runs_a_command_of_ours(services: dict[str, Any]) -> None:
    lines = [service["command"] for name, service in services.items() if name != "keys"]
    script = services["keys"]["command"][0].splitlines()[1:]
    lines += [shlex.split(line)[1:] for line in script if line.startswith("risorius ")]
    assert len(lines) == 6 + len(script)
    for line in lines:
        assert callable(build_parser().parse_args(line).run)


def test_the_image_copies_files_that_exist_and_runs_the_program() -> None:
    lines = DOCKERFILE.read_text().splitlines()
    copied = [name for line in lines if line.startswith("COPY ") for name in line.split()[1:-1]]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"]
    packages = [name.removesuffix("*") for name in project["packages"]["find"]["include"]]
    assert {"requirements.lock", *packages} <= set(copied)
    allowed = (ROOT / ".dockerignore").read_text().splitlines()
    for name in copied:
        assert (ROOT / name).exists() and f"!{name}" in allowed
    assert 'ENTRYPOINT ["risorius"]' in lines


def test_the_image_has_the_system_libraries_of_the_makefile() -> None:
    script = (ROOT / "scripts" / "system_libraries.sh").read_text()
    match = re.search(r"for package in ([^;]+);", script)
    assert match is not None
    assert set(match[1].split()) <= set(DOCKERFILE.read_text().split())


@pytest.mark.parametrize("prefix", ["", "secure-"], ids=["open", "secure"])
def test_the_services_commands_make_a_call(
    prefix: str, services: dict[str, Any], carphone: Path, start: Start, tmp_path: Path
) -> None:
    clip, port = tmp_path / "clip.mkv", free_port()
    copy_frames(carphone, clip, 5)
    places = {
        "0.0.0.0:7447": f"127.0.0.1:{port}",
        f"{prefix}router:7447": f"127.0.0.1:{port}",
        f"{prefix}router": "127.0.0.1",
        "/clips/clip.mp4": str(clip),
        "/out/": f"{tmp_path}/",
        "/keys/": f"{tmp_path}/",
        "risorius ": f"{shlex.join(PROGRAM)} ",
    }

    def here(argument: str) -> str:
        for container, host in places.items():
            argument = argument.replace(container, host)
        return argument

    def run(name: str) -> "subprocess.Popen[str]":
        return start(*map(here, services[prefix + name]["command"]))

    if prefix:
        make_keys([*services["keys"]["entrypoint"], here(services["keys"]["command"][0])])
    router = run("router")
    health = services[f"{prefix}router"]["healthcheck"]["test"]
    wait_until_healthy([word.replace("7447", str(port)) for word in health])
    decoder, encoder = run("decoder"), run("encoder")
    for process in (encoder, decoder):
        _, stderr = process.communicate(timeout=LIMIT_S)
        assert process.returncode == 0, stderr
        assert ("not encrypted" in stderr) == (not prefix)
    router.send_signal(signal.SIGTERM)
    assert router.wait(LIMIT_S) == 0
    with open_source(str(clip)) as source, open_source(str(tmp_path / "decoded.mkv")) as copy:
        assert (copy.width, copy.height, copy.fps) == (source.width, source.height, source.fps)
        assert sum(1 for _ in copy) == sum(1 for _ in source)
    report = json.loads((tmp_path / "decoder.json").read_text())
    assert report["complete"] and report["lost_packets"] == 0


def make_keys(script: list[str]) -> None:
    """The second time the script finds what the first has made."""
    for _ in range(2):
        subprocess.run(script, check=True, cwd=ROOT, stdout=subprocess.DEVNULL)


def wait_until_healthy(test: list[str]) -> None:
    """Run the health check of a container until it passes."""
    kind, program, *arguments = test
    assert (kind, program) == ("CMD", "python"), shlex.join(test)
    deadline = time.monotonic() + LIMIT_S
    while subprocess.run([sys.executable, *arguments], capture_output=True, check=False).returncode:
        assert time.monotonic() < deadline, f"not healthy: {shlex.join([*PROGRAM, *test])}"
        time.sleep(0.1)


def test_every_service_can_be_built(services: dict[str, Any]) -> None:
    """Whichever is started alone: no image has to be there before."""
    assert {service["build"] for service in services.values()} == {"."}


def test_the_image_is_without_what_only_tests_need() -> None:
    lock = (ROOT / "requirements.lock").read_text()
    [removed] = re.findall(r"pip uninstall --yes (.+?)\n\S", DOCKERFILE.read_text(), re.DOTALL)
    names = removed.replace("\\", "").split()
    assert {"pytest", "mypy", "ruff", "matplotlib"} <= set(names)
    assert all(re.search(rf"^{re.escape(name)}==", lock, re.MULTILINE) for name in names)
