"""The command ``insnav``. A package of its own, so that it starts without importing numpy and all of :mod:`insnav`."""

from __future__ import annotations

import signal
import sys
from importlib.machinery import PathFinder
from importlib.util import find_spec, module_from_spec
from typing import NoReturn

__all__ = ["main"]


def main() -> NoReturn:
    """Run the command line with the arguments of this process, and end it with the command's exit code."""
    # Python's own handler would wait for the command to end.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    package = find_spec("insnav")
    spec = PathFinder.find_spec("_insnav", package.submodule_search_locations) if package else None
    if spec is None or spec.loader is None:
        sys.exit("insnav: the installation is damaged: install the package insnav again")
    # Beside its package, whose other modules the command has no use for.
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    sys.exit(module.command(sys.argv))
