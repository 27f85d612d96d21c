"""Who may import whom.  Read from the source, so that a lazy import counts as well."""

import ast
import sys
from collections import Counter
from functools import cache
from graphlib import TopologicalSorter
from itertools import accumulate
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
OURS = ("runtime", "shared_model", "protocol", "encoder", "decoder", "aam", "loopback", "risorius")
MAY_IMPORT = {
    "runtime": {"runtime", "shared_model.arrays", "shared_model.errors", "shared_model.logs"},
    "shared_model": {"shared_model"},
    "protocol": {
        "protocol",
        "runtime.jit",
        "shared_model.arrays",
        "shared_model.errors",
        "shared_model.geometry",
        "shared_model.parameters",
    },
    "encoder": {"encoder", "protocol", "runtime", "shared_model"},
    "decoder": {"decoder", "protocol", "runtime", "shared_model"},
    "aam": {
        "aam",
        "shared_model",
        "encoder.appearance",
        "encoder.detection",
        "encoder.fitting",
        "runtime",
    },
    "loopback": {"loopback", "runtime", "shared_model", "protocol", "encoder", "decoder"},
    "risorius": set(OURS),
}
IMPORTERS = {
    "ai_edge_litert": {"encoder/detection/tflite.py"},
    "av": {
        "decoder/sinks/video_file.py",
        "decoder/sinks/sound_file.py",
        "decoder/sinks/sound_stream.py",
        "decoder/sound/speech_decoder.py",
        "encoder/capture/containers.py",
        "encoder/capture/video_file.py",
        "encoder/capture/time_stamps.py",
        "loopback/curves/rivals.py",
        "encoder/sound/sound_file.py",
        "encoder/sound/speech_encoder.py",
    },
    "filterpy": {"encoder/thesis/ekf.py"},
    "matplotlib": {"aam/charts.py"},
    "numba": {"runtime/jit.py"},
    "moderngl": {
        "decoder/rendering/background_pass.py",
        "decoder/rendering/edge_pass.py",
        "decoder/rendering/gl_context.py",
        "decoder/rendering/renderer.py",
    },
    "pycodec2": {"decoder/sound/speech_decoder.py", "encoder/sound/speech_encoder.py"},
    "serial": {"protocol/link/serial_carrier.py"},
    "webrtcvad": {"encoder/sound/speech_coder.py"},
    "zenoh": {
        "protocol/link/zenoh_direction.py",
        "protocol/link/zenoh_link.py",
        "protocol/link/zenoh_session.py",
        "protocol/relay/zenoh_relay.py",
    },
}
CV2_PACKAGES = {"aam", "encoder", "decoder", "loopback", "risorius", "runtime"}
# The encoder's packages in the order of the data; each may import those before it.
ENCODER_PACKAGES = (
    "picture_coding",
    "capture",
    "detection",
    "person",
    "appearance",
    "fitting",
    "learning",
    "layers",
    "coding",
    "residual",
    "live_model",
    "sound",
    "calls",
    "thesis",
)
# Those of the protocol in the order of what they carry; each may import those before it.
PROTOCOL_PACKAGES = (
    "entropy",
    "frames",
    "pictures",
    "picture_residual",
    "voice",
    "security",
    "link",
    "relay",
)
# The decoder's in the order of the data; each may import those before it.
DECODER_PACKAGES = ("sound", "playout", "rendering", "scene", "sinks")
ORDERED = {
    "encoder": ENCODER_PACKAGES,
    "protocol": PROTOCOL_PACKAGES,
    "decoder": DECODER_PACKAGES,
}


def modules() -> list[Path]:
    return sorted(path for package in OURS for path in (ROOT / package).rglob("*.py"))


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@cache
def imports(path: Path) -> tuple[str, ...]:
    """Dotted names of all that a module imports, `from a import b` as `a.b`."""
    found = list[str]()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found += (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name(path)}: relative import"
            found += (f"{node.module}.{alias.name}" for alias in node.names)
    return tuple(found)


def is_within(module: str, allowed: set[str]) -> bool:
    return any(module == prefix or module.startswith(f"{prefix}.") for prefix in allowed)


def test_no_two_test_files_have_one_name() -> None:
    """Pytest imports them by their names alone."""
    names = Counter(path.name for path in (ROOT / "tests").rglob("test_*.py"))
    assert [each for each, count in names.items() if count > 1] == []


# __main__ files put the program together and may reach for the command line.
@pytest.mark.parametrize(
    "path", [path for path in modules() if path.name != "__main__.py"], ids=name
)
def test_imports_point_one_way(path: Path) -> None:
    package = path.relative_to(ROOT).parts[0]
    ours = [module for module in imports(path) if module.split(".")[0] in OURS]
    wrong = [module for module in ours if not is_within(module, MAY_IMPORT[package])]
    assert not wrong, f"{name(path)} imports {wrong}"


def test_nothing_that_is_installed_imports_what_measures_or_makes_data() -> None:
    for path in modules():
        wrong = [module for module in imports(path) if is_within(module, {"benchmarks", "assets"})]
        assert not wrong, f"{name(path)} imports {wrong}"


@pytest.mark.parametrize("room", ORDERED)
def test_no_package_of_a_room_is_outside_its_order(room: str) -> None:
    folders = {path.parent.name for path in (ROOT / room).glob("*/__init__.py")}
    assert folders == set(ORDERED[room])


@pytest.mark.parametrize(
    ("room", "package"),
    [(room, package) for room, packages in ORDERED.items() for package in packages],
)
def test_a_package_imports_only_those_before_it_in_its_room(room: str, package: str) -> None:
    packages = ORDERED[room]
    after = {f"{room}.{each}" for each in packages[packages.index(package) + 1 :]}
    for path in sorted((ROOT / room / package).rglob("*.py")):
        wrong = [module for module in imports(path) if is_within(module, after)]
        assert not wrong, f"{name(path)} imports {wrong}"


def part_of(module: str) -> str:
    """A package within ours; a module that is in none counts by itself."""
    *_, part = (
        prefix for prefix in accumulate(module.split(".")[:2], "{}.{}".format) if exists(prefix)
    )
    return part


def exists(module: str) -> bool:
    path = ROOT / module.replace(".", "/")
    return path.is_dir() or path.with_suffix(".py").is_file()


def test_no_packages_import_each_other_in_a_circle() -> None:
    imported: dict[str, set[str]] = {}
    for path in modules():
        if path.name == "__main__.py":
            continue
        own = part_of(name(path).removesuffix(".py").removesuffix("/__init__").replace("/", "."))
        ours = {part_of(module) for module in imports(path) if module.split(".")[0] in OURS}
        imported.setdefault(own, set()).update(ours - {own})
    # Raises `CycleError`, which names a circle.
    assert len(list(TopologicalSorter(imported).static_order())) >= len(imported)


@pytest.mark.parametrize("library", IMPORTERS)
def test_a_heavy_library_has_few_importers(library: str) -> None:
    importers = {
        name(path)
        for path in modules()
        if any(module.split(".")[0] == library for module in imports(path))
    }
    assert importers <= IMPORTERS[library]


def test_opencv_stays_out_of_the_model_and_the_wire() -> None:
    importers = {
        path.relative_to(ROOT).parts[0]
        for path in modules()
        if any(module.split(".")[0] == "cv2" for module in imports(path))
    }
    assert importers <= CV2_PACKAGES


def test_the_shared_model_needs_numpy_only() -> None:
    allowed = {"numpy", "shared_model"} | set(sys.stdlib_module_names)
    for path in (ROOT / "shared_model").rglob("*.py"):
        wrong = [module for module in imports(path) if not is_within(module, allowed)]
        assert not wrong, f"{name(path)} imports {wrong}"
