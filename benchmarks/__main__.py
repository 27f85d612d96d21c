"""Runs a benchmark: `python -m benchmarks NAME ...`; `--help` lists them."""

import ast
import runpy
import sys
from pathlib import Path

from risorius.command_line.parser import BAD_USAGE

FOLDER = Path(__file__).resolve().parent


def programs() -> dict[str, Path]:
    """The file of each benchmark by its name: a module or a package that runs as a program."""
    found = {
        path.stem: path
        for path in FOLDER.glob("*.py")
        if path.name != "__main__.py" and '__name__ == "__main__"' in path.read_text()
    }
    found |= {path.parent.name: path for path in FOLDER.glob("*/__main__.py")}
    return dict(sorted(found.items()))


def summary(path: Path) -> str:
    """The first sentence of a program's docstring, without how it is called."""
    text = ast.get_docstring(ast.parse(path.read_text())) or ""
    return text.split("\n")[0].split(": python -m")[0].split(": `python -m")[0].rstrip(".:")


def main() -> int:
    """Run the benchmark that the first argument names; the exit code of what is no benchmark."""
    known = programs()
    name = sys.argv[1] if len(sys.argv) > 1 else "--help"
    if name in known:
        sys.argv[:2] = [f"python -m benchmarks {name}"]
        runpy.run_module(f"benchmarks.{name}", run_name="__main__", alter_sys=False)
        return 0
    is_asked = name in ("-h", "--help")
    lines = ["usage: python -m benchmarks NAME [--help] ...", ""]
    lines += [f"  {each:20} {summary(path)}" for each, path in known.items()]
    if not is_asked:
        lines = [f"benchmarks: {name!r} is none; `python -m benchmarks --help` lists them"]
    print("\n".join(lines), file=sys.stdout if is_asked else sys.stderr)
    return 0 if is_asked else BAD_USAGE


if __name__ == "__main__":
    sys.exit(main())
