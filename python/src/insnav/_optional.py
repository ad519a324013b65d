"""Packages that some functions need and this one does not bring."""

from __future__ import annotations

from importlib import import_module
from typing import Any

EXTRAS = {"distributed": "dask", "matplotlib": "plot", "pandas": "pandas", "polars": "polars", "xarray": "xarray"}


def needs(module: str) -> Any:
    """The module, imported now.

    Raises
    ------
    ImportError
        It is not installed; says which command installs it.
    """
    package = module.partition(".")[0]
    try:
        return import_module(module)
    except ImportError as e:
        if (e.name or "").partition(".")[0] != package:
            # It is there, and something that it needs is not.
            raise
        raise ImportError(f"{package} is not installed: pip install 'insnav[{EXTRAS[package]}]'", name=package) from e
