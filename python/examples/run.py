"""Notebooks from the example scripts, and whether they run.

    python run.py --write      make the notebooks anew
    python run.py              each notebook is that of its script, and runs to its end

The scripts are the source (jupytext's percent format). Notebooks are kept without outputs, so that what is read is what runs. Each example may
take 30 s. One whose recordings are absent says so and stops early: its output then has a line that begins with "SKIPPED". One that imports what
has no release for this Python, by the markers of requirements-test.txt, is skipped; what is merely not installed is an error.
"""

from __future__ import annotations

import argparse
import ast
import os
import sys
import time
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, cast

import jupytext
import nbclient
import nbformat
from packaging.requirements import Requirement

HERE = Path(__file__).parent
REQUIREMENTS = HERE.parent / "requirements-test.txt"
LONGEST_S = 30.0


def scripts() -> list[Path]:
    return sorted(path for path in HERE.glob("*.py") if path != Path(__file__) and "# %%" in path.read_text())


def notebook(script: Path) -> Any:
    """The notebook of a script: always the same bytes."""
    made = jupytext.reads(script.read_text(), fmt="py:percent")
    for i, cell in enumerate(made.cells):
        cell.id = f"cell-{i}"
        cell.metadata = {}
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    made.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    made.nbformat, made.nbformat_minor = 4, 5
    return made


def text(made: Any) -> str:
    written = cast("Callable[[Any], str]", nbformat.writes)
    return written(made).rstrip("\n") + "\n"


def execute(script: Path) -> tuple[float, list[str]]:
    """Seconds, and the lines that say what was skipped."""
    made = notebook(script)
    begin = time.monotonic()
    nbclient.NotebookClient(made, timeout=int(4 * LONGEST_S), kernel_name="python3", resources={"metadata": {"path": str(HERE)}}).execute()
    printed = [o.get("text", "") for cell in made.cells if cell.cell_type == "code" for o in cell.outputs]
    return time.monotonic() - begin, [line for block in printed for line in block.splitlines() if line.startswith("SKIPPED")]


def without_release(script: Path, python: Mapping[str, str] | None = None) -> list[str]:
    """What a script imports of which no release is for this Python, or for another one (``{"python_version": "3.10"}``)."""
    found: dict[str, bool] = {}
    for line in REQUIREMENTS.read_text().splitlines():
        if line.strip() and not line.startswith("#"):
            package = Requirement(line)
            here = package.marker is None or package.marker.evaluate(dict(python) if python else None)
            found[package.name] = found.get(package.name, False) or here
    names = set()
    for node in ast.walk(ast.parse(script.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.partition(".")[0])
    return sorted(name for name in names if found.get(name) is False)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write the notebooks instead of running them")
    parser.add_argument("--skips", type=Path, help="file to which skipped examples are added, one a line")
    parser.add_argument("names", nargs="*", help="of examples; all if none")
    arguments = parser.parse_args()
    # Figures go nowhere.
    os.environ.setdefault("MPLBACKEND", "agg")
    wrong = []
    for script in scripts():
        if arguments.names and script.stem not in arguments.names:
            continue
        path = script.with_suffix(".ipynb")
        if arguments.write:
            path.write_text(text(notebook(script)))
            continue
        if not path.is_file() or path.read_text() != text(notebook(script)):
            wrong.append(f"{path.name} is not that of {script.name}: make notebooks")
            continue
        missing = [name for name in without_release(script) if find_spec(name) is None]
        try:
            if missing:
                took, skipped = 0.0, [f"SKIPPED: no release of {', '.join(missing)} for Python {sys.version_info[0]}.{sys.version_info[1]}"]
            else:
                took, skipped = execute(script)
        except nbclient.exceptions.CellExecutionError as error:
            wrong.append(f"{script.name}: {error}")
            continue
        for line in skipped:
            print(f"{script.name}: {line}")
            if arguments.skips:
                with arguments.skips.open("a") as file:
                    file.write(f"SKIPPED: example {script.stem}: {line.removeprefix('SKIPPED').lstrip(': ')}\n")
        print(f"{script.name}: {took:.1f} s")
        if took > LONGEST_S:
            wrong.append(f"{script.name} took {took:.1f} s: {LONGEST_S:g} s are allowed")
    for line in wrong:
        print(f"error: {line}", file=sys.stderr)
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
