# %% [markdown]
# # Tuning with Allan deviation and autocovariance least squares
#
# Which noise goes into the filter? A record at rest tells, in two ways: the Allan deviation by averaging time, and what innovations of a
# filter leave at all lags (ALS). Both come with standard errors.

# %%
import gzip
import os
from pathlib import Path

import numpy as np

import insnav

data = Path(os.environ.get("INSNAV_DATA", "../../../shared/data"))
record = data / "adis16405_static_imu1" / "imu.csv.gz"
if record.is_file():
    with gzip.open(record, "rt") as lines:
        # The first half hour is enough here.
        table = np.loadtxt(lines, delimiter=",", skiprows=1, max_rows=180_000)
    t, gyro, accel = table[:, 0], table[:, 1:4], table[:, 4:7]
else:
    print(f"SKIPPED: no record at {record}: a simulated unit in its place")
    rng = np.random.default_rng(1)
    n = 180_000
    t = np.linspace(0.0, 0.01 * (n - 1), n)
    gyro = 6e-3 * rng.standard_normal((n, 3))
    gyro += np.cumsum(rng.normal(0.0, 1e-6, (n, 3)), axis=0)
    accel = 3e-2 * rng.standard_normal((n, 3))
    accel[:, 2] -= 9.81
    accel += np.cumsum(rng.normal(0.0, 1e-5, (n, 3)), axis=0)
print(f"{t[-1] / 60:.0f} minutes")

# %% [markdown]
# ## By averaging time
#
# White noise N falls with the square root of the averaging time, flicker B is flat, a random walk K rises with the square root.

# %%
deviation = insnav.noise.overlapping_allan(gyro[:, 0], 0.01)
fit = insnav.noise.fit_allan(deviation)
print(f"N = {np.degrees(fit.white) * 60:.3f} ± {np.degrees(fit.white_se) * 60:.3f} deg/sqrt(hour)")
print(f"B = {np.degrees(fit.flicker) * 3600:.2f} ± {np.degrees(fit.flicker_se) * 3600:.2f} deg/hour")
print(f"K = {fit.random_walk:.2e} ± {fit.random_walk_se:.1e} rad/s/sqrt(s)")
for tau, measured, fitted in zip(deviation.tau_s[::3], deviation.deviation[::3], fit.fitted[::3], strict=True):
    print(f"{tau:9.2f} s  measured {measured:.3e}  fit {fitted:.3e} rad/s")

# %% [markdown]
# ## By what a filter leaves
#
# A bias that walks, seen through white noise, at one value a second: two unknowns, Q and R. Any gain that is stable will do to begin with.

# %%
seconds = gyro[: len(gyro) // 100 * 100, 0].reshape(-1, 100).mean(axis=1)
start = [1e-12, float(np.var(seconds))]
estimate = insnav.noise.als_estimate(seconds - seconds[:30].mean(), [[1.0]], [[1.0]], [[1.0]], start, lags=60, skip=30)
print(estimate)
white = np.sqrt(estimate.R[0, 0])
print(f"white noise of the gyro: {np.degrees(white) * 60:.3f} deg/sqrt(hour) by ALS, {np.degrees(fit.white) * 60:.3f} by Allan")

# %% [markdown]
# Both see the same white noise, from different sides: the shortest averaging times, and what neighbouring innovations have in common.

# %%
assert abs(white / fit.white - 1) < 0.2

# %% [markdown]
# ## All of it at once
#
# `insnav.noise.identify_noise` does this for all axes, judges each number, and gives the block for the settings of `insnav.run`.

# %%
report = insnav.noise.identify_noise(t[:60_000], gyro[:60_000], accel[:60_000])
print(report["config"])
