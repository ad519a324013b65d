"""insnav and python-ins on the same simulated drives: errors column by column, and time per epoch.

Trajectories, inertial data and fixes are python-ins's own simulation (its splines, its gravity), so that nothing in the data is
of insnav's making. Both programs get the same increments, the same fixes, the same wrong start and the same sigmas.
"""

from __future__ import annotations

import os

# Before numpy: what is compared is one core against one core.
for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(threads, "1")

import argparse
import hashlib
import json
import platform
import sys
import time
import warnings
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pyins import filters, inertial_sensor, measurements, sim, strapdown, transform

import insnav

Array = NDArray[np.float64]

RATE_HZ = 100
DURATION_S = 420
CONVERGED_S = 120
OUTAGES_S = [(180, 240), (300, 360)]
START = (50.1, 14.4, 250.0)
POSITION_SIGMA_M = 1.0
VELOCITY_SIGMA_M_PER_S = 0.05
STANDARD_GRAVITY = 9.80665
# python-ins has biases that walk, insnav biases that also decay (Gauss-Markov). Over a drive of this length and with so long a
# correlation time both are the same process to 0.1 %; with 20 000 s they are not, and the data can only follow one of them.
BIAS_TAU_S = 1e6
COLUMNS = {
    "north": "m",
    "east": "m",
    "down": "m",
    "v north": "m/s",
    "v east": "m/s",
    "v down": "m/s",
    "roll": "deg",
    "pitch": "deg",
    "heading": "deg",
}
# No column of insnav may be worse than this factor times python-ins's, and an epoch must take this much less time.
WORST_RATIO = 1.03
LEAST_SPEEDUP = 100.0


@dataclass(frozen=True)
class Grade:
    """A class of inertial units in the units of data sheets, and how well the start is known."""

    gyro_arw_deg_per_sqrt_hour: float
    accel_vrw_m_per_s_per_sqrt_hour: float
    gyro_bias_deg_per_hour: float
    accel_bias_mg: float
    bias_tau_s: float
    gyro_scale_ppm: float
    accel_scale_ppm: float
    start_position_m: float
    start_velocity_m_per_s: float
    start_level_deg: float
    start_heading_deg: float

    @property
    def gyro_white(self) -> float:
        return float(np.radians(self.gyro_arw_deg_per_sqrt_hour)) / 60

    @property
    def accel_white(self) -> float:
        return self.accel_vrw_m_per_s_per_sqrt_hour / 60

    @property
    def gyro_bias(self) -> float:
        return float(np.radians(self.gyro_bias_deg_per_hour)) / 3600

    @property
    def accel_bias(self) -> float:
        return self.accel_bias_mg * 1e-3 * STANDARD_GRAVITY


GRADES = {
    "mems": Grade(0.3, 0.1, 100.0, 5.0, BIAS_TAU_S, 2000.0, 2000.0, 1.0, 0.1, 0.3, 1.0),
    "navigation": Grade(0.002, 0.01, 0.01, 0.05, BIAS_TAU_S, 10.0, 100.0, 1.0, 0.05, 0.005, 0.1),
}


# --- the drive ---------------------------------------------------------------------------------------------------------


def smooth(x: Array) -> Array:
    """From 0 to 1 with three derivatives that vanish at both ends."""
    x = np.clip(x, 0, 1)
    return np.asarray(x**4 * (35 - 84 * x + 70 * x**2 - 20 * x**3))


def drive(rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Times, velocities (NED) and attitudes (roll, pitch, heading in degrees) of a car: blocks of a town with corners and red
    lights, then bends and slopes at road speed, by turns."""
    t = np.arange(DURATION_S * RATE_HZ + 1) / RATE_HZ
    speed, course, slope = np.zeros_like(t), np.full_like(t, rng.uniform(-180, 180)), np.zeros_like(t)
    at, v, s = 0.0, 0.0, 0.0

    def leg(duration: float, to_speed: float, turn: float, to_slope: float) -> None:
        nonlocal at, v, s
        part = smooth((t - at) / duration)
        speed[:] += (to_speed - v) * part
        course[:] += turn * part
        slope[:] += (to_slope - s) * part
        at, v, s = at + duration, to_speed, to_slope

    leg(10, 0, 0, 0)
    while at < DURATION_S:
        town_ends = at + rng.uniform(120, 240)
        while at < town_ends:
            cruise, grade = rng.uniform(9, 15), rng.uniform(-3, 3)
            leg(rng.uniform(8, 12), cruise, 0, grade)
            leg(rng.uniform(8, 20), cruise, rng.uniform(-10, 10), grade)
            if rng.random() < 0.4:
                leg(cruise / 1.2, 0, 0, 0)
                leg(rng.uniform(8, 25), 0, 0, 0)
            else:
                corner = rng.uniform(4, 6)
                leg(cruise / 1.5, corner, 0, grade)
                leg(rng.uniform(5, 7), corner, rng.choice([-1, 1]) * rng.uniform(80, 100), grade)
        road_ends = at + rng.uniform(100, 200)
        leg(18, 26, 0, 0)
        while at < road_ends:
            leg(rng.uniform(12, 25), rng.uniform(22, 32), rng.uniform(-40, 40), rng.uniform(-3, 3))
        leg(20, 8, 0, 0)

    course_rad, slope_rad = np.radians(course), np.radians(slope)
    velocity_n = speed[:, None] * np.column_stack(
        [np.cos(slope_rad) * np.cos(course_rad), np.cos(slope_rad) * np.sin(course_rad), -np.sin(slope_rad)]
    )
    along = np.gradient(speed, t)
    across = speed * np.gradient(course_rad, t)
    sway = speed / (speed + 6)
    roll = -0.3 * across + sway * 0.4 * np.sin(2 * np.pi * 1.13 * t + rng.uniform(0, 6))
    pitch = slope + 0.2 * along + sway * 0.35 * np.sin(2 * np.pi * 1.29 * t + rng.uniform(0, 6))
    return t, velocity_n, np.column_stack([roll, pitch, course])


@dataclass
class Data:
    """One drive: truth, what the sensors said, and the start that both programs are told."""

    truth: pd.DataFrame
    imu: pd.DataFrame
    positions: pd.DataFrame
    velocities: pd.DataFrame
    start: pd.Series


def simulate(grade: Grade, scale_factors: bool, seed: int) -> Data:
    t, velocity_n, rph = drive(np.random.default_rng(seed))
    truth, imu = sim.generate_imu(t, START, rph, velocity_n, sensor_type="increment")
    # python-ins's own functions draw from the older generator.
    rng = np.random.RandomState(seed)
    gyro, accel = models(grade, scale_factors)
    imu = inertial_sensor.apply_imu_parameters(
        imu,
        "increment",
        inertial_sensor.Parameters.from_EstimationModel(gyro, rng),
        inertial_sensor.Parameters.from_EstimationModel(accel, rng),
    )
    fixes = truth.iloc[RATE_HZ::RATE_HZ]
    positions = sim.generate_position_measurements(fixes, POSITION_SIGMA_M, rng)
    velocities = sim.generate_ned_velocity_measurements(fixes, VELOCITY_SIGMA_M_PER_S, rng)
    seen = np.ones(len(fixes), dtype=bool)
    for begin, end in OUTAGES_S:
        seen &= ~((fixes.index > begin) & (fixes.index < end))
    error = sim.generate_pva_error(
        grade.start_position_m, grade.start_velocity_m_per_s, grade.start_level_deg, grade.start_heading_deg, rng
    )
    start = sim.perturb_pva(truth.iloc[0], error)
    return Data(truth, imu, positions[seen], velocities[seen], start)


def models(grade: Grade, scale_factors: bool) -> tuple[Any, Any]:
    """python-ins's models of gyros and accelerometers; its biases are a random constant and a random walk: the walk is that of
    the Gauss-Markov process that insnav has, whose sigma and correlation time are given."""
    walk = np.sqrt(2 / grade.bias_tau_s)

    def model(bias: float, white: float, ppm: float) -> Any:
        scale = np.eye(3) * ppm * 1e-6 if scale_factors else None
        return inertial_sensor.EstimationModel(bias_sd=bias, noise=white, bias_walk=bias * walk, scale_misal_sd=scale)

    return (
        model(grade.gyro_bias, grade.gyro_white, grade.gyro_scale_ppm),
        model(grade.accel_bias, grade.accel_white, grade.accel_scale_ppm),
    )


# --- the programs: trajectory as (n, 9) in the order of COLUMNS' truth, and the CPU time it took -------------------------


def run_python_ins(data: Data, grade: Grade, scale_factors: bool, time_step_s: float) -> tuple[Array, float]:
    gyro, accel = models(grade, scale_factors)
    aids = [
        measurements.Position(data.positions, POSITION_SIGMA_M),
        measurements.NedVelocity(data.velocities, VELOCITY_SIGMA_M_PER_S),
    ]
    begin = time.process_time()
    increments = strapdown.compute_increments_from_imu(data.imu, "increment")
    result = filters.run_feedback_filter(
        data.start,
        grade.start_position_m,
        grade.start_velocity_m_per_s,
        grade.start_level_deg,
        grade.start_heading_deg,
        increments,
        gyro,
        accel,
        aids,
        time_step=time_step_s,
    )
    took = time.process_time() - begin
    trajectory = result.trajectory
    assert np.array_equal(trajectory.index, data.truth.index)
    return trajectory[data.truth.columns].to_numpy(dtype=float), took


def python_ins(
    data: Data, grade: Grade, scale_factors: bool, time_step_s: float, seed: int, keep: Path | None
) -> tuple[Array, float]:
    """`run_python_ins`, or what it gave before for the very same data."""
    if keep is None:
        return run_python_ins(data, grade, scale_factors, time_step_s)
    given = f"{version('python-ins')} {grade} {scale_factors} {time_step_s} {seed}".encode()
    for table in (data.imu, data.positions, data.velocities, data.start):
        given += table.to_numpy(dtype=float).tobytes()
    path = keep / f"{hashlib.sha256(given).hexdigest()[:16]}.npz"
    if path.exists():
        kept = np.load(path)
        return kept["solution"], float(kept["took"])
    solution, took = run_python_ins(data, grade, scale_factors, time_step_s)
    keep.mkdir(parents=True, exist_ok=True)
    # Whole or not at all: the name appears last.
    partial = path.with_suffix(".partial.npz")
    np.savez(partial, solution=solution, took=took)
    partial.rename(path)
    return solution, took


def run_insnav(data: Data, grade: Grade, scale_factors: bool) -> tuple[Array, float]:
    t = data.imu.index.to_numpy()
    fixes = data.positions.index.to_numpy()
    arrays = {
        "imu_increment": (
            t,
            data.imu[["gyro_x", "gyro_y", "gyro_z"]].to_numpy(),
            data.imu[["accel_x", "accel_y", "accel_z"]].to_numpy(),
        ),
        "gnss_position": (fixes, data.positions[["lat", "lon", "alt"]].to_numpy(), [POSITION_SIGMA_M] * 3),
        "gnss_velocity": (fixes, data.velocities[["VN", "VE", "VD"]].to_numpy(), [VELOCITY_SIGMA_M_PER_S] * 3),
    }
    config: dict[str, Any] = {
        # Fixes here are white, and nothing tells insnav that this is a car.
        "gnss": {"lever_arm_b_m": [0.0, 0.0, 0.0], "correlation_time_s": 0.0},
        "vehicle": {"kind": "any", "nonholonomic": "off"},
        "noise": {
            "gyro_arw_deg_per_sqrt_hour": grade.gyro_arw_deg_per_sqrt_hour,
            "accel_vrw_m_per_s_per_sqrt_hour": grade.accel_vrw_m_per_s_per_sqrt_hour,
            "gyro_bias_deg_per_hour": grade.gyro_bias_deg_per_hour,
            "accel_bias_mg": grade.accel_bias_mg,
            "gyro_bias_tau_s": grade.bias_tau_s,
            "accel_bias_tau_s": grade.bias_tau_s,
        },
        "output": {"rate_hz": 0.0},
    }
    if scale_factors:
        config["imu"] = {"gyro_scale_sigma_ppm": grade.gyro_scale_ppm, "accel_scale_sigma_ppm": grade.accel_scale_ppm}
    level, heading = grade.start_level_deg, grade.start_heading_deg
    start = {
        "latitude_deg_longitude_deg_height_m": data.start[["lat", "lon", "alt"]].to_numpy(dtype=float),
        "velocity_n_m_per_s": data.start[["VN", "VE", "VD"]].to_numpy(dtype=float),
        "roll_deg_pitch_deg_heading_deg": data.start[["roll", "pitch", "heading"]].to_numpy(dtype=float),
        "sigma_position_n_m": [grade.start_position_m] * 3,
        "sigma_velocity_n_m_per_s": [grade.start_velocity_m_per_s] * 3,
        "sigma_attitude_n_deg": [level, level, heading],
    }
    begin = time.process_time()
    s = insnav.run(arrays, config, time_offset_s=0.0, start=start)
    took = time.process_time() - begin
    assert np.array_equal(np.round(s.time_s * RATE_HZ), np.arange(len(t))), "not an epoch for each inertial sample"
    columns = [s.latitude_deg, s.longitude_deg, s.height_m, s.velocity_n_m_per_s, s.roll_deg, s.pitch_deg, s.heading_deg]
    return np.column_stack(columns), took


# --- the comparison ------------------------------------------------------------------------------------------------------


def errors(solution: Array, truth: pd.DataFrame) -> Array:
    """Estimate minus truth in the order and units of COLUMNS, shape (n, 9)."""
    true = truth.to_numpy()
    position = transform.compute_lla_difference(solution[:, :3], true[:, :3])
    angles = (solution[:, 6:] - true[:, 6:] + 180) % 360 - 180
    return np.column_stack([position, solution[:, 3:6] - true[:, 3:6], angles])


def stretches(t: Array) -> dict[str, NDArray[np.bool_]]:
    """Epochs of the two tables."""
    out = np.zeros(len(t), dtype=bool)
    for begin, end in OUTAGES_S:
        out |= (t > begin) & (t < end)
    return {"aided": (t > CONVERGED_S) & ~out, "60 s outages": out}


def ratio_and_error(ours: Array, theirs: Array) -> tuple[Array, Array]:
    """Ratio of the RMS over all seeds, and its standard error by the jackknife over seeds, whose data both programs share.
    Mean squares by seed, shape (seeds, columns)."""
    ratio = np.sqrt(ours.sum(axis=0) / theirs.sum(axis=0))
    n = len(ours)
    if n < 2:
        return ratio, np.full_like(ratio, np.nan)
    without = np.sqrt((ours.sum(axis=0) - ours) / (theirs.sum(axis=0) - theirs))
    return ratio, np.asarray(np.sqrt((n - 1) / n * ((without - without.mean(axis=0)) ** 2).sum(axis=0)))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--grade", choices=[*GRADES], action="append", help="default: all")
    parser.add_argument("--no-scale-factors", action="store_true", help="neither in the data nor as states")
    parser.add_argument("--time-step", type=float, default=0.1, help="python-ins's covariance step, s (its default: 0.1)")
    parser.add_argument(
        "--keep",
        type=Path,
        metavar="DIR",
        help="keep python-ins's solutions and times there, and take them from there the next time: a drive takes it a minute",
    )
    parser.add_argument("--json", type=Path, help="write the numbers there")
    options = parser.parse_args()
    # A table made of progress lines of pandas is none.
    warnings.simplefilter("ignore", FutureWarning)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    scale_factors = not options.no_scale_factors

    print(f"insnav {insnav.__version__}, python-ins {version('python-ins')}, Python {platform.python_version()}, one core")
    print(
        f"{options.seeds} drives of {DURATION_S} s, {RATE_HZ} Hz increments, fixes at 1 Hz ({POSITION_SIGMA_M} m, "
        f"{VELOCITY_SIGMA_M_PER_S} m/s, white), outages {OUTAGES_S} s, scale factors {'on' if scale_factors else 'off'}"
    )
    failures: list[str] = []
    report: dict[str, Any] = {"seeds": options.seeds, "scale_factors": scale_factors, "grades": {}}
    for name in options.grade or GRADES:
        grade = GRADES[name]
        squares: dict[str, dict[str, list[Array]]] = {}
        took = {"python-ins": [], "insnav": []}
        # Compile python-ins's integrator before any clock runs.
        warm = simulate(grade, scale_factors, 0)
        warm.imu = warm.imu.iloc[:300]
        warm.truth = warm.truth.iloc[:300]
        run_python_ins(warm, grade, scale_factors, options.time_step)
        for seed in range(options.first_seed, options.first_seed + options.seeds):
            data = simulate(grade, scale_factors, seed)
            runs = {
                "python-ins": python_ins(data, grade, scale_factors, options.time_step, seed, options.keep),
                "insnav": run_insnav(data, grade, scale_factors),
            }
            t = data.truth.index.to_numpy()
            for program, (solution, seconds) in runs.items():
                took[program].append(seconds / (len(t) - 1))
                e = errors(solution, data.truth)
                for stretch, where in stretches(t).items():
                    squares.setdefault(stretch, {}).setdefault(program, []).append((e[where] ** 2).mean(axis=0))
            print(f"\r{name}: {seed - options.first_seed + 1}/{options.seeds}", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)

        report["grades"][name] = {}
        for stretch, by_program in squares.items():
            ours, theirs = np.array(by_program["insnav"]), np.array(by_program["python-ins"])
            ratio, error = ratio_and_error(ours, theirs)
            rms = {p: np.sqrt(np.mean(s, axis=0)) for p, s in by_program.items()}
            print(f"\n{name}, {stretch}: RMS over time and drives")
            print(f"{'':10}{'python-ins':>12}{'insnav':>12}  {'':4}{'difference':>12}")
            for i, (column, unit) in enumerate(COLUMNS.items()):
                verdict = "" if ratio[i] <= WORST_RATIO else "  WORSE"
                print(
                    f"{column:10}{rms['python-ins'][i]:12.5f}{rms['insnav'][i]:12.5f}  {unit:4}"
                    f"{100 * (ratio[i] - 1):+8.2f} ± {100 * error[i]:.2f} %{verdict}"
                )
                if verdict:
                    failures.append(f"{name}, {stretch}, {column}: {100 * (ratio[i] - 1):+.2f} %")
            report["grades"][name][stretch] = {
                "columns": [*COLUMNS],
                "python_ins_rms": rms["python-ins"].tolist(),
                "insnav_rms": rms["insnav"].tolist(),
                "ratio": ratio.tolist(),
                "ratio_standard_error": error.tolist(),
            }
        medians = {p: float(np.median(s)) for p, s in took.items()}
        speedup = medians["python-ins"] / medians["insnav"]
        print(
            f"\n{name}: CPU time per inertial epoch, median of the drives: python-ins {1e6 * medians['python-ins']:.1f} µs "
            f"(covariance every {options.time_step} s), insnav {1e6 * medians['insnav']:.2f} µs (covariance at every epoch): "
            f"{speedup:.0f} times less"
        )
        report["grades"][name]["cpu_s_per_epoch"] = medians
        report["grades"][name]["speedup"] = speedup
        if speedup < LEAST_SPEEDUP:
            failures.append(f"{name}: {speedup:.0f} times less time, not {LEAST_SPEEDUP:.0f}")
    if options.json:
        options.json.write_text(json.dumps(report, indent=1) + "\n")
    print("\n" + ("\n".join(["not as good as it must be:", *failures]) if failures else "as good in all columns"))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
