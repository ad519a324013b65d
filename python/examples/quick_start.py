# %% [markdown]
# # Quick start
#
# A log in, a trajectory with its uncertainty out. The drive is simulated, so that the truth is known; of a recording of your own,
# `insnav.run("drive.mcap")` is all there is to it.

# %%
import numpy as np

import insnav

drive = insnav.sim.Scenario.car_drive(120.0).simulate(seed=7)
{name: [np.shape(column) for column in columns] for name, columns in drive.arrays.items()}

# %% [markdown]
# Those are plain numpy arrays: time, and what was measured. Units and axes are in the names of the documentation of `insnav.Arrays`:
# seconds, rad/s, m/s², degrees, metres; the body looks forward, right and down.

# %%
solution = insnav.run(drive.arrays, {"gnss": {"lever_arm_b_m": [0.0, 0.0, 0.0]}})
solution

# %% [markdown]
# Every column has one row an epoch. Names end with their unit.

# %%
last = {
    "latitude_deg": solution.latitude_deg[-1],
    "longitude_deg": solution.longitude_deg[-1],
    "height_m": solution.height_m[-1],
    "heading_deg": solution.heading_deg[-1],
    "sigma_position_n_m": solution.sigma_position_n_m[-1],
}
last

# %% [markdown]
# How good is it? Against the truth, and against what it says of itself: a NEES of one per degree of freedom is an honest filter.

# %%
comparison = insnav.compare(solution, drive.truth)
comparison

# %%
for name, value in comparison.summary.items():
    if isinstance(value, float | int) and not isinstance(value, bool):
        print(f"{name:40} {value:.4g}")

# Three sigmas hold 99.7 % of what is normal; neighbouring errors are nearly the same one.
for errors, sigma in [
    (comparison.position_error_n_m, comparison.sigma_position_n_m),
    (comparison.velocity_error_n_m_per_s, comparison.sigma_velocity_n_m_per_s),
    (comparison.attitude_error_n_deg, comparison.sigma_attitude_n_deg),
]:
    assert (np.abs(errors) < 3 * sigma).mean() > 0.95

# %% [markdown]
# What the filter did with each measurement, and where the vehicle stood:

# %%
print(solution.updates)
print(solution.stops)
# It begins with a minute at rest.
assert len(solution.stops) == 1 and abs(solution.stops.end_s[0] - 60.0) < 3.0
assert set(solution.updates.verdict) == {"accepted"}

# %% [markdown]
# What cannot be used is refused with a reason and a remedy.

# %%
t, rates, forces = drive.arrays["imu"]
try:
    insnav.run({"imu": (t, rates, forces[:-1])})
except insnav.ArgumentError as error:
    print(error.argument, error.received, error.expected, sep=" | ")
    assert error.argument == "imu: specific_force_b_m_per_s2"
else:
    raise AssertionError("a row too few was taken")

# %% [markdown]
# The same from a shell: `insnav demo` makes a log to play with, `insnav info drive.mcap` says what is in a log, `insnav run drive.mcap`
# navigates it.
