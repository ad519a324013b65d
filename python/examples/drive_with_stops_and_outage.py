# %% [markdown]
# # A drive with stops and an outage
#
# A town drive with a consumer IMU: the car waits at lights, and for forty seconds there are no fixes. A filter is honest if its errors stay inside
# the bands that it states, at rest, under way, and while nobody helps it. The drive is simulated, so that the errors are known.
#
# `INSNAV_FIGURE=docs/drive.svg python python/examples/drive_with_stops_and_outage.py` makes the figure of the README.

# %%
import os
import warnings

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

import insnav

BEGIN_S, END_S = 190.0, 230.0
scenario = insnav.sim.Scenario.from_dict(
    {
        "start": {"latitude_deg": 50.1, "longitude_deg": 14.4, "height_m": 250.0, "heading_deg": 70.0},
        "route": [
            {"duration_s": 40, "speed_m_per_s": 0},
            {"duration_s": 10, "speed_m_per_s": 12},
            {"duration_s": 15},
            {"duration_s": 8, "turn_deg": 90},
            {"duration_s": 20, "speed_m_per_s": 15},
            {"duration_s": 8, "speed_m_per_s": 0},
            {"duration_s": 30},
            {"duration_s": 10, "speed_m_per_s": 14},
            {"duration_s": 30, "turn_deg": -110},
            {"duration_s": 30, "speed_m_per_s": 18},
            {"duration_s": 25, "turn_deg": 70},
            {"duration_s": 9, "speed_m_per_s": 0},
            {"duration_s": 30},
            {"duration_s": 10, "speed_m_per_s": 13},
            {"duration_s": 25, "turn_deg": 60},
        ],
        "imu": {"grade": "consumer", "rate_hz": 100.0},
        "gnss": {"position_sigma_m": [0.5, 0.5, 1.0], "outages": [{"begin_s": BEGIN_S, "end_s": END_S}]},
    }
)
drive = scenario.simulate(seed=4, truth_rate_hz=0.5)
scenario

# %% [markdown]
# The class of the IMU is all that is told; biases, attitude and heading are found in the data, and so are the stops.

# %%
with warnings.catch_warnings():
    warnings.simplefilter("ignore", insnav.InsnavWarning)
    solution = insnav.run(drive.arrays, {"imu": {"grade": "consumer"}, "gnss": {"lever_arm_b_m": [0.0, 0.0, 0.0]}})
print(solution)
print(solution.stops)

# %% [markdown]
# Errors (lines) and three stated standard deviations (bands): north, east and down. Stops are grey, the outage is red.

# %%
mpl.rcParams.update({"svg.hashsalt": "drive", "svg.fonttype": "none", "font.size": 8})
figure, axes = plt.subplots(3, 3, figsize=(10, 5.5), sharex=True, layout="constrained")
solution.plot.errors(drive.truth, axes)
for ax in axes.ravel():
    ax.axvspan(BEGIN_S, END_S, color="r", alpha=0.15, linewidth=0)
figure.suptitle("Errors inside their 3-sigma bands: stops grey, outage of GNSS red")
if path := os.environ.get("INSNAV_FIGURE"):
    figure.savefig(path, metadata={"Date": None} if path.endswith(".svg") else None)

# %% [markdown]
# In numbers, for those who do not trust figures: the share of errors inside three sigmas, and the mean normalised errors squared, which are 1
# for a filter that knows how good it is.

# %%
comparison = insnav.compare(solution, drive.truth)
quantities = {
    "position": (comparison.position_error_n_m, comparison.sigma_position_n_m),
    "velocity": (comparison.velocity_error_n_m_per_s, comparison.sigma_velocity_n_m_per_s),
    "attitude": (comparison.attitude_error_n_deg, comparison.sigma_attitude_n_deg),
}
for name, (error, sigma) in quantities.items():
    inside = float(np.mean(np.abs(error) <= 3 * sigma))
    print(f"{name}: {inside:.1%} inside 3 sigma, NEES {np.mean(getattr(comparison, f'nees_{name}')):.2f}")
    assert inside > 0.97, name

# %% [markdown]
# What the filter was told in between, against what it expected: 95 % of the dots should lie between the dashed lines.

# %%
_ = solution.plot.nis(measurements=["gnss_position", "gnss_velocity"])

# %% [markdown]
# And what it made of the unit's biases:

# %%
_ = solution.plot.biases()
