"""Recordings and the command, where they are."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of recordings; the tests that need it are skipped visibly when it is absent."""
    folder = Path(os.environ.get("INSNAV_DATA") or ROOT.parent / "shared" / "data")
    if not folder.is_dir():
        pytest.skip(f"no recordings at {folder}")
    return folder


@pytest.fixture(scope="session")
def command() -> Path:
    """The command `insnav` built from the same source."""
    path = Path(os.environ.get("INSNAV_COMMAND") or ROOT / "target" / "debug" / "insnav")
    if not path.is_file():
        pytest.skip(f"no command at {path}: cargo build -p insnav-cli")
    return path


@pytest.fixture(scope="session")
def rust_example(command: Path) -> Path:
    """The example `run_log`, which uses the Rust API, built beside the command."""
    path = command.parent / "examples" / "run_log"
    if not path.is_file():
        pytest.skip(f"no example at {path}: cargo build --example run_log")
    return path
