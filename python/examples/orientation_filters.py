# %% [markdown]
# # Orientation filters on the same recordings
#
# Gyro, accelerometer and magnetometer of the BROAD benchmark (Laidig et al., Data 2021, 6(7), 72), optical truth beside them. `insnav.ahrs`
# against what everybody can write down in ten lines, and against other packages where they are installed. The complete table, with all programs
# and both scorers, is that of `python/evaluation/orientation.py`.

# %%
import gzip
import os
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import insnav

Array = NDArray[np.float64]
data = Path(os.environ.get("INSNAV_DATA", "../../../shared/data")) / "ahrs"
trials = [data / name for name in ("broad_02_undisturbed_slow_rotation_B", "broad_12_undisturbed_slow_translation_C")]
trials = [trial for trial in trials if trial.is_dir()]
if not trials:
    print(f"SKIPPED: no recordings at {data}")


# %% [markdown]
# The sensors look forward, left and up; `insnav` wants forward, right and down, and gives the attitude against north, east, down. The truth
# counts against east, north, up. Both turns are constant quaternions.


# %%
def product(p: Array, q: Array) -> Array:
    a, b, c, d = np.moveaxis(np.asarray(p), -1, 0)
    w, x, y, z = np.moveaxis(np.asarray(q), -1, 0)
    parts = [a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y, a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w]
    return np.stack(parts, axis=-1)


FLIP = np.array([1.0, -1.0, -1.0])
ENU_NED = np.array([0.0, np.sqrt(0.5), np.sqrt(0.5), 0.0])
FRD_FLU = np.array([0.0, 1.0, 0.0, 0.0])


def table(path: Path) -> Array:
    with gzip.open(path, "rt") as lines:
        return np.genfromtxt(lines, delimiter=",", skip_header=1)


def errors_deg(estimate: Array, truth: Array, scored: NDArray[np.bool_]) -> tuple[float, float]:
    """Root mean squares of heading and inclination, without any alignment."""
    scored = scored & np.isfinite(estimate).all(axis=1)
    e = product(estimate[scored], truth[scored] * [1.0, -1.0, -1.0, -1.0])
    w, x, y, z = np.abs(e.T)
    heading, inclination = 2 * np.arctan2(z, w), 2 * np.arctan2(np.hypot(x, y), np.hypot(w, z))
    return tuple(float(np.degrees(np.sqrt(np.mean(a * a)))) for a in (heading, inclination))  # type: ignore[return-value]


# %% [markdown]
# What one writes first: at every instant north and east from gravity and field alone, without any filter.


# %%
def without_filter(accel: Array, mag: Array) -> Array:
    """Attitude of the sensor against east, north, up, from one accelerometer and one magnetometer sample each."""
    up = accel / np.linalg.norm(accel, axis=1, keepdims=True)
    east = np.cross(mag, up)
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    north = np.cross(up, east)
    c = np.stack([east, north, up], axis=1)
    w = 0.5 * np.sqrt(np.maximum(1e-12, 1 + c[:, 0, 0] + c[:, 1, 1] + c[:, 2, 2]))
    xyz = np.stack([c[:, 2, 1] - c[:, 1, 2], c[:, 0, 2] - c[:, 2, 0], c[:, 1, 0] - c[:, 0, 1]], axis=1) / (4 * w[:, None])
    # Near half a turn w has no digits: such rows tell nothing.
    return np.where(w[:, None] > 0.05, np.column_stack([w, xyz]), np.nan)


# %%
for trial in trials:
    imu, reference = table(trial / "imu.csv.gz"), table(trial / "truth_quat.csv.gz")
    t, gyro, accel, mag = imu[:, 0], imu[:, 1:4], imu[:, 4:7], imu[:, 7:10]
    truth = reference[:, 1:5]
    scored = np.isfinite(truth).all(axis=1) & (reference[:, 5] > 0)
    results = {"no filter": without_filter(accel, mag)}
    for name, smooth in [("insnav", False), ("insnav, smoothed", True)]:
        found = insnav.ahrs(t, gyro * FLIP, accel * FLIP, mag * FLIP * 1e-6, smooth=smooth)
        q = np.full((len(t), 4), np.nan)
        q[np.searchsorted(t, found.time_s - 1e-6)] = product(product(ENU_NED, found.quaternion_nb_wxyz), FRD_FLU)
        results[name] = q
    if find_spec("vqf") is not None:
        from vqf import VQF

        results["vqf"] = VQF(float(np.median(np.diff(t)))).updateBatch(gyro, accel, mag)["quat9D"]
    print(trial.name)
    for name, estimate in results.items():
        heading, inclination = errors_deg(estimate, truth, scored)
        print(f"  {name:18} heading {heading:6.2f}°  inclination {inclination:6.2f}°")
    assert max(errors_deg(results["insnav"], truth, scored)) < max(errors_deg(results["no filter"], truth, scored))
