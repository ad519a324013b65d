"""What one call of `Navigator.step_imu` costs beyond the navigator itself.

The same samples go through the navigator in Rust (`examples/step_loop.rs`), through `batch`, which makes no call for each of them, and through
`step_imu`, one call each, in turns; the difference by sample is the price of a call, with the loop of Python around it. That `batch` reads
and sorts its arrays first is in its time. A loop that calls an empty function of Python is there to compare.

    cargo build --release --example step_loop
    python python/benchmarks/step_overhead.py [samples] [rounds] [--rust target/release/examples/step_loop] [--bar-ns 1000]

With a bar it ends with 1 where a call, array or tuple, takes more than that beyond Rust, each by the least of its times.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import insnav

CONFIG: dict[str, Any] = {
    "imu": {"grade": "industrial"},
    "gnss": {"lever_arm_b_m": [0.0, 0.0, 0.0]},
    # Vehicles that stand are another path.
    "stationary": {"mode": "off"},
    "output": {"rate_hz": 1.0},
}
START = {
    "time_s": 0.0,
    "latitude_deg_longitude_deg_height_m": [50.0, 14.0, 300.0],
    "velocity_n_m_per_s": [10.0, 0.0, 0.0],
    "roll_deg_pitch_deg_heading_deg": [0.0, 0.0, 0.0],
    "sigma_position_n_m": [1.0, 1.0, 1.0],
    "sigma_velocity_n_m_per_s": [0.1, 0.1, 0.1],
    "sigma_attitude_n_deg": [0.1, 0.1, 0.5],
}


#: What the bar is for.
STEPS = ("step_imu, arrays", "step_imu, tuples")


def samples(n: int) -> tuple[Any, Any, Any]:
    rng = np.random.default_rng(1)
    t = np.arange(n) * 0.005
    rate = rng.normal(0, 0.02, (n, 3))
    force = np.array([0.0, 0.0, -9.81]) + rng.normal(0, 0.1, (n, 3))
    return t, rate, force


def seconds(job: Callable[[], object]) -> float:
    begin = time.perf_counter()
    job()
    return time.perf_counter() - begin


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("samples", type=int, nargs="?", default=100_000)
    parser.add_argument("rounds", type=int, nargs="?", default=7)
    parser.add_argument("--rust", type=Path, help="examples/step_loop.rs, built as the wheel was")
    parser.add_argument("--bar-ns", type=float, help="what a call may cost beyond Rust")
    options = parser.parse_args()
    if options.bar_ns is not None and options.rust is None:
        parser.error("--bar-ns: give --rust, against which it is")
    with tempfile.TemporaryDirectory() as folder:
        return measure(options.samples, options.rounds, options.rust, options.bar_ns, Path(folder) / "samples.f64")


def measure(n: int, rounds: int, rust: Path | None, bar_ns: float | None, file: Path) -> int:
    t, rate, force = samples(n)
    stamps = t.tolist()
    rows = [(list(rate), list(force)), (list(map(tuple, rate.tolist())), list(map(tuple, force.tolist())))]
    arrays = {"imu": (t, rate, force)}
    np.column_stack([t, rate, force]).astype("<f8").tofile(file)

    def navigator() -> insnav.Navigator:
        return insnav.Navigator(CONFIG, start=START, keep=False)

    def batch() -> float:
        own = navigator()
        return seconds(lambda: own.batch(arrays))

    def by_kind() -> float:
        step = navigator().step

        def loop() -> None:
            for time_s, a, b in zip(stamps, *rows[0], strict=True):
                step("imu", time_s, a, b)

        return seconds(loop)

    def steps(w: list[Any], f: list[Any], call: Callable[..., object] | None = None) -> float:
        step = navigator().step_imu if call is None else call

        def loop() -> None:
            for time_s, a, b in zip(stamps, w, f, strict=True):
                step(time_s, a, b)

        return seconds(loop)

    def in_rust() -> float:
        done = subprocess.run([str(rust), str(file)], check=True, capture_output=True, text=True)
        return float(done.stdout) * n / 1e9

    kinds: dict[str, Callable[[], float]] = {
        **({"Rust": in_rust} if rust else {}),
        "batch": batch,
        "step_imu, arrays": lambda: steps(*rows[0]),
        "step_imu, tuples": lambda: steps(*rows[1]),
        'step("imu", ...), arrays': by_kind,
        "a loop that calls nothing": lambda: steps(*rows[0], call=lambda a, b, c: None),
    }
    times: dict[str, list[float]] = {name: [] for name in kinds}
    for _ in range(rounds):
        for name, job in kinds.items():
            times[name].append(1e9 * job() / n)
    base = "Rust" if rust else "batch"
    print(f"{n} samples, {rounds} rounds in turns; ns per sample, median (least to most)")
    for name, values in times.items():
        spread = f"{statistics.median(values):8.0f} ({min(values):.0f} to {max(values):.0f})"
        # The least of each is what it takes where nothing else wants the machine.
        beyond = "" if name == base else f"  beyond {base} {min(values) - min(times[base]):6.0f}"
        print(f"{name:28} {spread}{beyond}")
    wrong = [name for name in STEPS if bar_ns is not None and min(times[name]) - min(times[base]) > bar_ns]
    for name in wrong:
        print(f"error: {name}: {min(times[name]) - min(times[base]):.0f} ns beyond {base}, {bar_ns:g} are allowed", file=sys.stderr)
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
