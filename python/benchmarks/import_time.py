"""What `import insnav` costs over `import numpy`, and how soon the command `insnav` answers.

    python python/benchmarks/import_time.py [--pairs 30] [--bar-ms 20]

Processes of both kinds run by turns, so that whatever else the machine does meets both alike; the difference is that of the medians, with
the spread of the medians by resampling. Ends with 1 where the difference is above the bar by more than that spread.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np

# Times itself, so that the start of the interpreter does not count.
TIMED = "import time; begin = time.perf_counter(); import {module}; print(time.perf_counter() - begin)"


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
    numpy_ms, both_ms = np.median(pairs, axis=0)
    picked = np.random.default_rng(0).integers(0, len(pairs), (1000, len(pairs)))
    again = np.median(pairs[picked, 1], axis=1) - np.median(pairs[picked, 0], axis=1)
    more, spread = both_ms - numpy_ms, float(np.std(again))
    command_ms = np.median([started([insnav, "--version"]) for _ in range(10)]) * 1e3
    bare_ms = np.median([started([sys.executable, "-c", ""]) for _ in range(10)]) * 1e3
    print(f"import numpy {numpy_ms:.1f} ms, import insnav {both_ms:.1f} ms: {more:.1f} ± {spread:.1f} ms more ({arguments.bar_ms:g} allowed)")
    print(f"insnav --version {command_ms:.1f} ms, an interpreter that does nothing {bare_ms:.1f} ms")
    return int(more - spread > arguments.bar_ms)


if __name__ == "__main__":
    sys.exit(main())
