"""Which examples run where: `python/examples/run.py`."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest

for needed in ("jupytext", "nbclient", "packaging"):
    pytest.importorskip(needed)

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture(scope="module")
def runner() -> Any:
    spec = importlib.util.spec_from_file_location("run_examples", EXAMPLES / "run.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_examples_are_skipped_only_where_a_package_has_no_release(runner: Any, tmp_path: Path) -> None:
    drive = EXAMPLES / "drive_with_stops_and_outage.py"
    assert runner.without_release(drive, {"python_version": "3.10"}) == ["matplotlib"]
    for script in runner.scripts():
        # What is not installed there, although it could be, is an error.
        assert runner.without_release(script, {"python_version": "3.12"}) == []
    # numpy has a line for each Python; what is in no line is the script's own concern.
    script = tmp_path / "script.py"
    script.write_text("import numpy.linalg\nimport nobody\nfrom xarray import Dataset\nfrom . import polars\n")
    assert runner.without_release(script, {"python_version": "3.10"}) == ["xarray"]


def test_what_is_skipped_is_told_and_the_rest_fails(
    runner: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    script, skips = tmp_path / "one.py", tmp_path / "skips"
    script.write_text("# %%\nimport nobody_has_this\n")
    script.with_suffix(".ipynb").write_text(runner.text(runner.notebook(script)))
    monkeypatch.setattr(runner, "HERE", tmp_path)
    requirements = tmp_path / "requirements.txt"
    monkeypatch.setattr(runner, "REQUIREMENTS", requirements)
    monkeypatch.setattr("sys.argv", ["run.py", "--skips", str(skips)])
    requirements.write_text('nobody_has_this==1.0; python_version < "3"\n')
    assert runner.main() == 0
    assert skips.read_text().startswith("SKIPPED: example one: no release of nobody_has_this for Python 3.")
    capsys.readouterr()
    requirements.write_text("nobody_has_this==1.0\n")
    assert runner.main() == 1
    assert "No module named 'nobody_has_this'" in capsys.readouterr().err
