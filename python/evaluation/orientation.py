"""Orientation filters on the same recordings: `insnav ahrs` beside vqf, ahrs and imufusion, in one run.

    pip install -r python/evaluation/requirements.txt
    python python/evaluation/orientation.py --insnav target/debug/insnav --data "$INSNAV_DATA/ahrs"

Every folder with `imu.csv.gz` and `truth_quat.csv.gz` is a trial. Errors are those of the BROAD benchmark (Laidig et al.,
"BROAD - A Benchmark for Robust Inertial Orientation Estimation", Data 2021, 6(7), 72): e = q_est * conj(q_ref) in the earth
frame without any alignment, total 2 acos |w|, heading 2 atan |z/w|, inclination 2 acos sqrt(w^2 + z^2), root mean square
over valid truth with moving = 1. The truth of RepoIMU does not count from north, and its markers are not aligned to
the sensor: there the constant rotations between the earth frames and between the body axes are taken out first, of every
program's result alike.

Programs run with their defaults, and with one setting for all trials. The errors of insnav are computed twice, here and by
`insnav compare`, and have to agree.
"""

from __future__ import annotations

import argparse
import gzip
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# The CSV has nine decimals of a quaternion, and the truth is at its instants: what two scorers may differ by.
AGREEMENT_DEG = 1e-5
# Share of the scored instants that a program may have no attitude for, at the begin.
MISSING = 0.005
STANDARD_GRAVITY = 9.80665
# Dip at the place of the recordings, degrees, for filters that have to be told; their own default is a place with declination.
DIP_DEG = 67.0


@dataclass(frozen=True)
class Trial:
    """One recording: sensor axes, +g on z when level; truth from sensor to earth (ENU), NaN where there is none."""

    name: str
    folder: Path
    t: Array
    gyro: Array
    accel: Array
    mag: Array
    truth: Array
    scored: NDArray[np.bool_]

    @property
    def step(self) -> float:
        return float(np.median(np.diff(self.t)))

    @property
    def aligned(self) -> bool:
        return self.name.startswith("repoimu")


def read(path: Path) -> NDArray[np.void]:
    with gzip.open(path, "rt") if path.suffix == ".gz" else path.open() as lines:
        return np.genfromtxt(lines, delimiter=",", names=True)


def columns(table: NDArray[np.void], names: str) -> Array:
    return np.ascontiguousarray(np.stack([table[name] for name in names.split()], axis=1))


def trial_of(folder: Path) -> Trial:
    imu, truth = read(folder / "imu.csv.gz"), read(folder / "truth_quat.csv.gz")
    quaternions = columns(truth, "qw qx qy qz")
    scored = np.isfinite(quaternions).all(axis=1)
    if "moving" in (truth.dtype.names or ()):
        scored &= truth["moving"] > 0
    if len(imu) != len(truth) or np.abs(imu["t_s"] - truth["t_s"]).max() > 1e-6:
        sys.exit(f"{folder}: the truth is not at the instants of the samples")
    return Trial(
        folder.name,
        folder,
        imu["t_s"],
        columns(imu, "gx gy gz"),
        columns(imu, "ax ay az"),
        columns(imu, "mx my mz"),
        quaternions,
        scored,
    )


def product(p: Array, q: Array) -> Array:
    a, b, c, d = np.moveaxis(p, -1, 0)
    w, x, y, z = np.moveaxis(q, -1, 0)
    return np.stack(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ],
        axis=-1,
    )


def conjugate(q: Array) -> Array:
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def aligned(estimate: Array, truth: Array) -> Array:
    """Errors without the constant rotations of earth frame and body axes, each the mean (Markley 2007) given the other."""

    def mean(q: Array) -> Array:
        return np.linalg.eigh(q.T @ q)[1][:, -1]

    for _ in range(100):
        left = conjugate(mean(product(estimate, conjugate(truth))))
        estimate = product(left, estimate)
        right = conjugate(mean(product(conjugate(truth), estimate)))
        estimate = product(estimate, right)
        if max(np.hypot.reduce(left[1:]), np.hypot.reduce(right[1:])) < 0.5e-9:
            break
    return product(estimate, conjugate(truth))


def errors_deg(estimate: Array, trial: Trial) -> tuple[float, float, float]:
    """Total, heading and inclination RMSE in degrees."""
    known = np.isfinite(estimate).all(axis=1)
    e = product(estimate, conjugate(trial.truth))[trial.scored & known]
    if trial.aligned:
        e = aligned(estimate[trial.scored & known], trial.truth[trial.scored & known])
    w, x, y, z = np.abs(e / np.linalg.norm(e, axis=1, keepdims=True)).T
    # By atan2 where acos has no digits left.
    parts = (
        2 * np.arctan2(np.sqrt(x * x + y * y + z * z), w),
        2 * np.arctan2(z, w),
        2 * np.arctan2(np.hypot(x, y), np.hypot(w, z)),
    )
    total, heading, inclination = (float(np.degrees(np.sqrt(np.mean(a * a)))) for a in parts)
    return total, heading, inclination


def run_vqf(trial: Trial) -> Array:
    from vqf import VQF

    return VQF(trial.step).updateBatch(trial.gyro, trial.accel, trial.mag)["quat9D"]


def run_offline_vqf(trial: Trial) -> Array:
    from vqf import offlineVQF

    return offlineVQF(trial.gyro, trial.accel, trial.mag, trial.step)["quat9D"]


def run_madgwick(trial: Trial) -> Array:
    from ahrs.filters import Madgwick

    q = Madgwick(gyr=trial.gyro, acc=trial.accel, mag=trial.mag, frequency=1 / trial.step).Q
    # Its x is north, y west.
    return product(np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)]), np.asarray(q))


def run_mahony(trial: Trial) -> Array:
    from ahrs.filters import Mahony

    return np.asarray(
        Mahony(gyr=trial.gyro, acc=trial.accel, mag=trial.mag, frequency=1 / trial.step).Q
    )


def run_ekf(trial: Trial) -> Array:
    from ahrs.filters import EKF

    # NED and forward-right-down; gravity, not specific force.
    frd = np.array([1.0, -1.0, -1.0])
    q = EKF(
        gyr=trial.gyro * frd,
        acc=-trial.accel * frd,
        mag=trial.mag * frd,
        frequency=1 / trial.step,
        frame="NED",
        magnetic_ref=DIP_DEG,
    ).Q
    half = np.sqrt(0.5)
    enu_ned = np.array([0.0, half, half, 0.0])
    return product(product(enu_ned, np.asarray(q)), np.array([0.0, 1.0, 0.0, 0.0]))


def run_imufusion(trial: Trial) -> Array:
    import imufusion

    settings = imufusion.AhrsSettings()
    settings.convention = imufusion.CONVENTION_ENU
    settings.sample_rate = 1 / trial.step
    settings.gain = 0.5
    # What its own example has: nothing is rejected by default.
    settings.acceleration_rejection = 10
    settings.magnetic_rejection = 10
    settings.rejection_timeout = 5
    fusion = imufusion.Ahrs()
    fusion.set_settings(settings)
    q = np.empty((len(trial.t), 4))
    gyro, accel = np.degrees(trial.gyro), trial.accel / STANDARD_GRAVITY
    for i in range(len(q)):
        fusion.update(gyro[i], accel[i], trial.mag[i])
        q[i] = fusion.get_quaternion()
    return q


class Insnav:
    """`insnav convert`, `ahrs` and `compare` as anyone would call them."""

    def __init__(self, program: str, noise: str, work: Path) -> None:
        self.program, self.noise, self.work = program, noise, work
        self.coverage: dict[tuple[str, str], tuple[float, int]] = {}

    def command(self, *arguments: str | Path) -> str:
        done = subprocess.run(
            [self.program, *map(str, arguments)], capture_output=True, text=True, check=False
        )
        if done.returncode:
            sys.exit(f"insnav {' '.join(map(str, arguments))}: {done.stderr}")
        return done.stdout

    def run(self, name: str, smooth: bool) -> Callable[[Trial], Array]:
        def filtered(trial: Trial) -> Array:
            log = self.work / f"{trial.name}.mcap"
            if not log.exists():
                self.command("convert", trial.folder, "--axes", "flu", "-o", log)
            out = self.work / f"{trial.name}.{name.replace(' ', '_')}.mcap"
            flags = ["--smooth"] if smooth else []
            self.command("ahrs", log, "--noise", self.noise, *flags, "-o", out, "--force")
            table = out.with_suffix(".csv")
            self.command("convert", out, "-o", table, "--force")
            align = ["--align-earth", "--remove-mounting"] if trial.aligned else []
            reference = trial.folder / "truth_quat.csv.gz"
            told = json.loads(
                self.command("compare", out, reference, *align, "--format", "json")
            )
            got = read(table)
            # Stamps have nine decimals; an estimate at every sample that is scored.
            at = np.searchsorted(got["t_s"], trial.t - 1e-6)
            found = np.minimum(at, len(got) - 1)
            missing = np.abs(got["t_s"][found] - trial.t) > 1e-6
            # The first attitude takes it some samples, which other programs guess.
            if (missing & trial.scored).sum() > MISSING * trial.scored.sum():
                sys.exit(f"{out}: {(missing & trial.scored).sum()} scored instants are missing")
            q = columns(got, "qw qx qy qz")[found]
            q[missing] = np.nan
            ours = errors_deg(q, trial)[0]
            if trial.scored.any() and abs(told["total_rmse_deg"] - ours) > AGREEMENT_DEG:
                sys.exit(f"{out}: compare says {told['total_rmse_deg']}, and here it is {ours}")
            self.coverage[name, trial.name] = (
                told["coverage_95"],
                told["orientation_count"],
            )
            return q

        return filtered


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    data = Path(os.environ.get("INSNAV_DATA", "../shared/data")) / "ahrs"
    parser.add_argument("--data", type=Path, default=data, help="folder of trials [%(default)s]")
    parser.add_argument("--insnav", default="insnav", help="the program [%(default)s]")
    parser.add_argument("--noise", default="auto", help="for `insnav ahrs` [%(default)s]")
    parser.add_argument("--only", help="programs, comma-separated [all]")
    parser.add_argument("--trials", default="*", help="pattern of folder names [%(default)s]")
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    arguments = parser.parse_args()

    with tempfile.TemporaryDirectory() as work:
        insnav = Insnav(arguments.insnav, arguments.noise, Path(work))
        programs: dict[str, Callable[[Trial], Array]] = {
            "insnav": insnav.run("insnav", smooth=False),
            "insnav smooth": insnav.run("insnav smooth", smooth=True),
            "vqf": run_vqf,
            "offlineVQF": run_offline_vqf,
            "Madgwick": run_madgwick,
            "Mahony": run_mahony,
            "EKF": run_ekf,
            "imufusion": run_imufusion,
        }
        if arguments.only:
            unknown = set(arguments.only.split(",")) - set(programs)
            if unknown:
                parser.error(f"--only: {unknown}: known are {', '.join(programs)}")
            programs = {name: programs[name] for name in arguments.only.split(",")}
        folders = sorted(arguments.data.glob(arguments.trials))
        trials = [trial_of(f) for f in folders if (f / "truth_quat.csv.gz").exists()]
        without = [trial.name for trial in trials if not trial.scored.any()]
        trials = [trial for trial in trials if trial.scored.any()]
        if not trials:
            sys.exit(f"{arguments.data}: no folder with imu.csv.gz and truth_quat.csv.gz")
        if without:
            print(f"no valid truth, left out: {', '.join(without)}")
        errors: dict[str, dict[str, tuple[float, float, float]]] = {}
        seconds: dict[str, float] = {}
        for name, program in programs.items():
            begin = time.perf_counter()
            errors[name] = {t.name: errors_deg(program(t), t) for t in trials}
            seconds[name] = time.perf_counter() - begin

        width = max(len(trial.name) for trial in trials)
        print("total / heading / inclination RMSE, degrees")
        print(" " * width + "".join(f"{name:>21}" for name in programs))
        for group in ("broad", "repoimu", ""):
            chosen = [
                t.name
                for t in trials
                if (group and t.name.startswith(group))
                or (not group and not t.name.startswith(("broad", "repoimu")))
            ]
            if not chosen:
                continue
            rows = [(name, {p: errors[p][name] for p in programs}) for name in chosen]
            mean = {
                p: tuple(np.mean([errors[p][name] for name in chosen], axis=0)) for p in programs
            }
            for name, cells in [*rows, (f"mean of {len(chosen)}", mean)]:
                text = "".join("  {:>6.2f}{:>7.2f}{:>6.2f}".format(*cells[p]) for p in programs)
                print(f"{name:<{width}}{text}")
            for program in ("insnav", "insnav smooth"):
                shares = [insnav.coverage[program, n] for n in chosen if (program, n) in insnav.coverage]
                if shares:
                    count = sum(n for _, n in shares)
                    pooled = sum(share * n for share, n in shares) / count
                    each = ", ".join(f"{100 * share:.1f}" for share, _ in shares)
                    print(f"{program}: inside the stated 95 % ellipsoid {100 * pooled:.1f} % ({each})")
            print()
        if arguments.json:
            numbers = {
                "errors_deg": errors,
                "seconds": seconds,
                "coverage_95": [[*key, *value] for key, value in insnav.coverage.items()],
            }
            arguments.json.write_text(json.dumps(numbers, indent=1))


if __name__ == "__main__":
    main()
