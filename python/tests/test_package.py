"""The wheel as it is installed."""

from __future__ import annotations

import re
from importlib import metadata, resources
from pathlib import Path

import insnav


def test_version_is_that_of_the_workspace() -> None:
    cargo = (Path(__file__).parents[2] / "Cargo.toml").read_text()
    version = re.search(r'^version = "(.*)"', cargo, re.M)
    assert version is not None
    assert insnav.__version__ == version[1] == metadata.version("insnav")


def test_the_wheel_is_typed_and_not_the_source_tree() -> None:
    package = resources.files(insnav)
    assert (package / "py.typed").is_file() and (package / "_insnav.pyi").is_file()
    assert "site-packages" in str(package)


def test_everything_public_says_what_it_is() -> None:
    for name in insnav.__all__:
        if not name.startswith("__"):
            assert getattr(insnav, name).__doc__, name
    for name, member in vars(insnav.Solution).items():
        if not name.startswith("_"):
            assert member.__doc__, name
