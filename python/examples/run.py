"""Notebooks from the example scripts, and whether they run.

    python run.py --write      make the notebooks anew
    python run.py              each notebook is that of its script, and runs to its end

The scripts are the source (jupytext's percent format). Notebooks are kept without outputs, so that what is read is what runs. Each example may
take 30 s. One whose recordings are absent says so and stops early: its output then has a line that begins with "SKIPPED".
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import jupytext
import nbclient
import nbformat

HERE = Path(__file__).parent
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
        try:
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
