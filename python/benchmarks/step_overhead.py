"""What one call of `Navigator.step_imu` costs beyond the navigator itself.

The same samples go through `batch`, which makes no call for each of them, and through `step_imu`, one call each, in turns; the difference by
sample is the price of a call, with the loop of Python around it. That `batch` reads and sorts its arrays first is in its time.
A loop that calls an empty function of Python is there to compare.

    python python/benchmarks/step_overhead.py [samples] [rounds]
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
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


def main() -> None:
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    rounds = int(sys.argv[2]) if len(sys.argv) > 2 else 7
    t, rate, force = samples(n)
    stamps = t.tolist()
    rows = [(list(rate), list(force)), (list(map(tuple, rate.tolist())), list(map(tuple, force.tolist())))]
    arrays = {"imu": (t, rate, force)}

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

    kinds: dict[str, Callable[[], float]] = {
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
    base = times["batch"]
    print(f"{n} samples, {rounds} rounds in turns; ns per sample, median (least to most)")
    for name, values in times.items():
        # Round by round, so that what slows the machine slows both.
        over = [v - b for v, b in zip(values, base, strict=True)]
        spread = f"{statistics.median(values):8.0f} ({min(values):.0f} to {max(values):.0f})"
        beyond = "" if name == "batch" else f"  beyond batch {statistics.median(over):6.0f} ({min(over):.0f} to {max(over):.0f})"
        print(f"{name:28} {spread}{beyond}")


if __name__ == "__main__":
    main()
