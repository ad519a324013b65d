"""What `import insnav` costs over `import numpy`, and how soon the command `insnav` answers.

    python python/benchmarks/import_time.py [--pairs 30] [--bar-ms 20]

Processes of both kinds run by turns, and each kind counts with the least of its processor times, which is what it takes where nothing else wants
the machine and files are in its memory. Ends with 1 where the difference is above the bar.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np

# Times itself, so that the start of the interpreter does not count; what the processor did for it, not what it waited for others.
TIMED = "import time; begin = time.process_time(); import {module}; print(time.process_time() - begin)"


def seconds(module: str) -> float:
    done = subprocess.run([sys.executable, "-c", TIMED.format(module=module)], check=True, capture_output=True, text=True)
    return float(done.stdout)


def started(command: list[str]) -> float:
    script = "import subprocess, sys, time; begin = time.perf_counter(); subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL); print(time.perf_counter() - begin)"
    done = subprocess.run([sys.executable, "-c", script, *command], check=True, capture_output=True, text=True)
    return float(done.stdout)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=30)
    parser.add_argument("--bar-ms", type=float, default=20.0)
    arguments = parser.parse_args()
    insnav = str(Path(sysconfig.get_path("scripts")) / "insnav")
    # Once each beforehand: bytecode, and pages of the disk.
    seconds("numpy"), seconds("insnav"), started([insnav, "--version"])
    pairs = np.array([(seconds("numpy"), seconds("insnav")) for _ in range(arguments.pairs)]) * 1e3
    numpy_ms, both_ms = pairs.min(axis=0)
    more, usual = both_ms - numpy_ms, float(np.diff(np.median(pairs, axis=0))[0])
    command_ms = min([started([insnav, "--version"]) for _ in range(10)]) * 1e3
    bare_ms = min([started([sys.executable, "-c", ""]) for _ in range(10)]) * 1e3
    print(f"import numpy {numpy_ms:.1f} ms, import insnav {both_ms:.1f} ms: {more:.1f} ms more (medians: {usual:.1f}; {arguments.bar_ms:g} allowed)")
    print(f"insnav --version {command_ms:.1f} ms, an interpreter that does nothing {bare_ms:.1f} ms")
    return int(more > arguments.bar_ms)


if __name__ == "__main__":
    sys.exit(main())
