"""How fast insnav is from Python: one hour of inertial data through `insnav.run`, and python-ins on the begin of the same data.

One hour at 200 Hz, fixes at 1 Hz, all in memory: `insnav.run` as a user calls it (it surveys the data, looks for clock offsets and for
wheels, and returns 180 000 epochs), on one core. python-ins needs some minutes for the hour, in proportion to its length: it gets
the first minute, or with ``--whole`` all of it. Runs take turns, and each counts with the least of its times. Ends with 1 where less than what is asked for
comes out; where python-ins is not installed it says that this was skipped.

    pip install python-ins pandas
    (cd python && maturin develop --release)
    python python/benchmarks/speed.py
"""

from __future__ import annotations

import os

# Before numpy: what is measured is one core.
for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(threads, "1")

import argparse
import json
import platform
import statistics
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import insnav

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from simulation import Drive, drive

Array = NDArray[np.float64]

DURATION_S = 3600.0
RATE_HZ = 200.0
POSITION_SIGMA_M = 1.0
VELOCITY_SIGMA_M_PER_S = 0.05
GYRO_WHITE = 1e-4
ACCEL_WHITE = 1e-3
CONFIG: dict[str, Any] = {"gnss": {"lever_arm_b_m": [0.0, 0.0, 0.0]}}
# What is asked for.
MOST_SECONDS = 1.0
LEAST_SPEEDUP = 50.0


def hour(duration_s: float) -> tuple[Drive, dict[str, Any]]:
    """A car in bends at 12 m/s after a stop, and what its sensors say."""
    truth = drive(duration_s, RATE_HZ)
    arrays = truth.arrays(
        np.random.default_rng(1),
        position_sigma_m=POSITION_SIGMA_M,
        velocity_sigma_m_per_s=VELOCITY_SIGMA_M_PER_S,
        gyro_white=GYRO_WHITE,
        accel_white=ACCEL_WHITE,
    )
    for key in ("gnss_position", "gnss_velocity"):
        time_s, values, sigma = arrays[key]
        sigma = np.asarray(sigma)
        arrays[key] = (time_s[::5], values[::5], sigma if sigma.ndim == 1 else sigma[::5])
    return truth, arrays


def insnav_seconds(arrays: dict[str, Any]) -> float:
    """CPU time of one run, the columns of its solution included."""
    begin = time.process_time()
    solution = insnav.run(arrays, CONFIG)
    took = time.process_time() - begin
    assert len(solution) > 0
    return took


def python_ins_seconds(truth: Drive, arrays: dict[str, Any], samples: int) -> float:
    """CPU time of python-ins's feedback filter over the first samples, its increments included; 15 states, covariance every 0.1 s."""
    import pandas as pd
    from pyins import filters, inertial_sensor, measurements, strapdown

    t, rate, force = (column[:samples] for column in arrays["imu"])
    imu = pd.DataFrame(
        np.hstack([rate, force]), index=t, columns=["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]
    )

    def table(key: str, columns: list[str]) -> Any:
        time_s, values = arrays[key][:2]
        here = time_s <= t[-1]
        return pd.DataFrame(values[here], index=time_s[here], columns=columns)

    aids = [
        measurements.Position(table("gnss_position", ["lat", "lon", "alt"]), POSITION_SIGMA_M),
        measurements.NedVelocity(table("gnss_velocity", ["VN", "VE", "VD"]), VELOCITY_SIGMA_M_PER_S),
    ]
    start = pd.Series(
        [truth.latitude_deg[0], truth.longitude_deg[0], truth.height_m, 0.0, 0.0, 0.0, 0.0, 0.0, truth.heading_deg[0]],
        index=["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"],
        # It is the name that says when.
        name=t[0],
    )
    gyro = inertial_sensor.EstimationModel(bias_sd=1e-3, noise=GYRO_WHITE, bias_walk=1e-6)
    accel = inertial_sensor.EstimationModel(bias_sd=0.05, noise=ACCEL_WHITE, bias_walk=1e-5)
    begin = time.process_time()
    increments = strapdown.compute_increments_from_imu(imu, "rate")
    result = filters.run_feedback_filter(start, 1.0, 0.1, 0.3, 1.0, increments, gyro, accel, aids, time_step=0.1)
    took = time.process_time() - begin
    assert np.all(np.isfinite(result.trajectory.to_numpy()))
    return took


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=5, help="runs of each, of which the least and the median are told")
    parser.add_argument("--peer-seconds", type=float, default=60.0, help="seconds of the data that python-ins gets")
    parser.add_argument("--whole", action="store_true", help="give python-ins all of it")
    parser.add_argument("--no-peer", action="store_true")
    parser.add_argument("--json", type=Path, help="write the numbers there")
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    print(f"insnav {insnav.__version__}, Python {platform.python_version()}, numpy {np.__version__}, one core")
    truth, arrays = hour(DURATION_S)
    samples = len(arrays["imu"][0])
    insnav_seconds(arrays)
    ours: list[float] = []
    theirs: list[float] = []
    peer_samples = samples if options.whole else int(options.peer_seconds * RATE_HZ)
    peer = not options.no_peer and find_spec("pyins") is not None
    if peer:
        # Compiles its integrator before the clock runs.
        python_ins_seconds(truth, arrays, 1000)
    for _ in range(options.repeat):
        ours.append(insnav_seconds(arrays))
        if peer:
            theirs.append(python_ins_seconds(truth, arrays, peer_samples))
    least = min(ours)
    print(
        f"insnav.run, {samples} inertial samples: {least:.2f} s (median {statistics.median(ours):.2f}), "
        f"{1e6 * least / samples:.2f} µs a sample; asked: at most {MOST_SECONDS} s"
    )
    report: dict[str, Any] = {"samples": samples, "run_s": ours}
    ok = least <= MOST_SECONDS
    if peer:
        ratio = (min(theirs) / peer_samples) / (least / samples)
        print(
            f"python-ins, the first {peer_samples} of them: {min(theirs):.2f} s (median {statistics.median(theirs):.2f}), "
            f"{1e6 * min(theirs) / peer_samples:.0f} µs a sample: {ratio:.0f} times as much; asked: at least {LEAST_SPEEDUP:.0f}"
        )
        report |= {"peer_samples": peer_samples, "peer_s": theirs, "speedup": ratio}
        ok = ok and ratio >= LEAST_SPEEDUP
    elif not options.no_peer:
        print("SKIPPED: python-ins is not installed: pip install python-ins pandas")
    if options.json:
        options.json.write_text(json.dumps(report))
    return 0 if ok else 1


if __name__ == "__main__":
    sys.exit(main())
