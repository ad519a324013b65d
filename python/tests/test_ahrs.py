"""`insnav.ahrs` and `insnav.noise.identify_noise` on simulated units."""

from __future__ import annotations

import gzip
import pickle
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import insnav
from insnav import noise

Array = NDArray[np.float64]

RATE_HZ, GRAVITY = 100.0, 9.80665
# White noise, rad/√s, m/s/√s and T.
GYRO, ACCEL, MAG = np.radians(0.3) / 60, 2e-3, 2e-7
ROLL, PITCH, HEADING = np.radians([10.0, -20.0, 130.0])
FIELD_N = np.array([20e-6, 0.0, 44e-6])


def body_to_north(roll: Any, pitch: Any, heading: Any) -> Array:
    """C_nb of the angles, shape (…, 3, 3)."""

    def about(axis: int, angle: Any) -> Array:
        c, s = np.cos(angle), np.sin(angle)
        m = np.zeros((*np.shape(angle), 3, 3))
        i, j = (axis + 1) % 3, (axis + 2) % 3
        m[..., axis, axis], m[..., i, i], m[..., j, j] = 1, c, c
        m[..., i, j], m[..., j, i] = -s, s
        return m

    return np.asarray(about(2, heading) @ about(1, pitch) @ about(0, roll))


def rest(seconds: float, seed: int = 0, bias_rad_per_s: float = 0.0) -> tuple[Array, Array, Array, Array]:
    """A unit that does not move: t, gyro, accel, mag."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, seconds, 1 / RATE_HZ)
    c = body_to_north(ROLL, PITCH, HEADING)

    def white(sigma: float) -> Array:
        return rng.normal(0, sigma, (len(t), 3))

    gyro = bias_rad_per_s + white(GYRO * np.sqrt(RATE_HZ))
    accel = c.T @ [0, 0, -GRAVITY] + white(ACCEL * np.sqrt(RATE_HZ))
    return t, gyro, accel, c.T @ FIELD_N + white(MAG)


def matrix(q: Array) -> Array:
    """C_nb of quaternions (w, x, y, z)."""
    w, x, y, z = q.T
    return np.stack(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)


@pytest.mark.parametrize("smooth", [False, True])
def test_orientation_of_a_unit_at_rest(smooth: bool) -> None:
    t, gyro, accel, mag = rest(120, bias_rad_per_s=np.radians(0.1))
    found = insnav.ahrs(t, gyro, accel, mag, smooth=smooth)
    assert len(found) == len(found.time_s) > len(t) - 0.5 * RATE_HZ
    assert found.time_s[-1] == pytest.approx(t[-1], abs=1e-9)
    assert found.quaternion_nb_wxyz.shape == (len(found), 4)
    np.testing.assert_allclose(np.linalg.norm(found.quaternion_nb_wxyz, axis=1), 1, atol=1e-12)
    angles = np.radians([found.roll_deg, found.pitch_deg, found.heading_deg])
    np.testing.assert_allclose(matrix(found.quaternion_nb_wxyz), body_to_north(*angles), rtol=0, atol=1e-12)
    late = found.time_s > 60
    # The filter allows for accelerometer biases (0.02 m/s², 0.12°) and iron (1.5 % of the field, 2° of heading), which this unit has
    # not: the errors are within what it states.
    sigma = found.sigma_attitude_n_deg[late]
    assert np.all(np.hypot(found.roll_deg - 10, found.pitch_deg + 20)[late] < 3 * sigma[:, :2].min(axis=1))
    assert np.all(np.abs(found.heading_deg - 130)[late] < 3 * sigma[:, 2])
    assert sigma[:, :2].max() < 0.2 and sigma[:, 2].max() < 3
    covariance = found.attitude_covariance_n_rad2
    assert covariance.shape == (len(found), 3, 3)
    np.testing.assert_allclose(covariance, covariance.transpose(0, 2, 1), atol=1e-15)
    by_diagonal = np.degrees(np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)))
    np.testing.assert_allclose(found.sigma_attitude_n_deg, by_diagonal, rtol=1e-12)
    again = pickle.loads(pickle.dumps(found))
    assert again.quaternion_nb_wxyz.tobytes() == found.quaternion_nb_wxyz.tobytes() and again.summary == found.summary
    assert again.attitude_covariance_n_rad2.tobytes() == found.attitude_covariance_n_rad2.tobytes()
    assert found.summary["smoothed"] is smooth and found.summary["heading_reference"] == "magnetic_north"
    np.testing.assert_allclose(found.summary["gyro_bias_deg_per_s"], 0.1, atol=0.01)


def test_a_turn_is_followed_about_the_right_axis() -> None:
    """Nose to the right at 30°/s for three seconds, then at rest."""
    t, gyro, accel, _ = rest(10)
    turning = (t >= 5) & (t < 8)
    rate = np.where(turning, np.radians(30.0), 0.0)
    heading = np.cumsum(rate) / RATE_HZ
    c = body_to_north(0.0, 0.0, heading)
    gyro = gyro + np.outer(rate, [0, 0, 1])
    accel = np.tile([0.0, 0.0, -GRAVITY], (len(t), 1)) + np.random.default_rng(1).normal(0, 0.02, (len(t), 3))
    mag = np.einsum("nji,j->ni", c, FIELD_N)
    for field, reference in [(mag, "magnetic_north"), (None, "start")]:
        found = insnav.ahrs(t, gyro, accel, field, noise="datasheet")
        assert found.summary["heading_reference"] == reference
        assert found.heading_deg[-1] == pytest.approx(90, abs=1.5)
        assert abs(found.roll_deg[-1]) < 0.5 and abs(found.pitch_deg[-1]) < 0.5


def test_the_smoother_knows_more_than_the_filter() -> None:
    t, gyro, accel, mag = rest(60)
    causal, whole = (insnav.ahrs(t, gyro, accel, mag, smooth=s, noise="datasheet") for s in (False, True))
    assert np.array_equal(causal.time_ns, whole.time_ns)
    early = causal.time_s < 30
    assert np.all(whole.sigma_attitude_n_deg[early].mean(axis=0) < causal.sigma_attitude_n_deg[early].mean(axis=0))


def test_fields_with_stamps_of_their_own() -> None:
    t, gyro, accel, mag = rest(20)
    every = np.arange(len(t)) % 4 == 0
    sparse = np.where(every[:, None], mag, np.nan)
    holes = insnav.ahrs(t, gyro, accel, sparse, noise="datasheet")
    stamped = insnav.ahrs(t, gyro, accel, (t[every], mag[every]), noise="datasheet")
    assert np.array_equal(holes.quaternion_nb_wxyz, stamped.quaternion_nb_wxyz)
    assert holes.summary["magnetic_fields"] == every.sum()
    true_north = insnav.ahrs(t, gyro, accel, sparse, noise="datasheet", config={"alignment": {"declination_deg": 5.0}})
    np.testing.assert_allclose(true_north.heading_deg - holes.heading_deg, 5, atol=1e-9)


def test_a_mounting_turns_the_field_too() -> None:
    t, gyro, accel, mag = rest(20)
    # A unit that lies with its x axis to the right.
    turned = [np.column_stack([a[:, 1], -a[:, 0], a[:, 2]]) for a in (gyro, accel, mag)]
    straight = insnav.ahrs(t, gyro, accel, mag, noise="datasheet")
    mounted = insnav.ahrs(t, *turned, noise="datasheet", config={"imu": {"mounting_rpy_deg": [0.0, 0.0, 90.0]}})
    np.testing.assert_allclose(mounted.heading_deg, straight.heading_deg, atol=1e-6)
    np.testing.assert_allclose(mounted.roll_deg, straight.roll_deg, atol=1e-6)


@pytest.mark.parametrize("smooth", [False, True])
def test_a_recording_gives_what_the_command_gives(smooth: bool, data: Path, command: Path, tmp_path: Path) -> None:
    folder = data / "ahrs" / "broad_05_undisturbed_slow_rotation_with_breaks_B"
    if not folder.is_dir():
        pytest.skip(f"no recording at {folder}")
    log, out = tmp_path / "a.mcap", tmp_path / "out.mcap"
    flags = ["--also", "csv"] + ["--smooth"] * smooth
    for arguments in (["convert", folder / "imu.csv.gz", "--axes", "flu", "-o", log], ["ahrs", log, "-o", out, *flags]):
        done = subprocess.run([str(a) for a in (command, *arguments)], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    by_command = np.loadtxt(tmp_path / "out.csv", delimiter=",", skiprows=1)
    with gzip.open(folder / "imu.csv.gz", "rt") as file:
        rows = np.loadtxt(file, delimiter=",", skiprows=1)
    frd = np.array([1.0, -1.0, -1.0])
    found = insnav.ahrs(rows[:, 0], rows[:, 1:4] * frd, rows[:, 4:7] * frd, rows[:, 7:10] * frd * 1e-6, smooth=smooth)
    np.testing.assert_allclose(found.time_s, by_command[:, 0], atol=1e-9)
    # The command writes forward-left-up against east, north, up. For small angles a difference of matrices is the angle times √2.
    enu = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    apart = enu @ matrix(found.quaternion_nb_wxyz) * frd - matrix(by_command[:, 1:5])
    angle = np.degrees(np.linalg.norm(apart, axis=(1, 2)) / np.sqrt(2))
    # Nine decimals are 2e-7 degrees.
    assert angle.max() < 1e-6


def test_noise_of_a_unit_at_rest() -> None:
    t, gyro, accel, mag = rest(600, seed=4)
    found = noise.identify_noise(t, gyro, accel, mag, config={"imu": {"grade": "industrial"}})
    for name, truth in [("gyro_white_rad_per_sqrt_s", GYRO), ("accel_white_m_per_s_per_sqrt_s", ACCEL)]:
        number = found["als"][name]
        assert number["accepted"], number["reason"]
        assert abs(number["value"] - truth) < 3 * number["standard_error"] < 0.3 * truth
    field = found["als"]["heading"]["magnetometer_microtesla"]
    assert field["accepted"] and abs(field["value"] - MAG * 1e6) < 4 * field["standard_error"] < 0.3 * MAG * 1e6
    for axis in found["fit"]["gyro"]:
        white = axis["white_rad_per_sqrt_s"]
        assert abs(white["value"] - GYRO) < 4 * white["standard_error"]
    # The block is what settings take.
    assert "[noise]" in found["config"]


@pytest.mark.parametrize(
    ("changes", "code", "words"),
    [
        ({"gyro": np.zeros((4, 3))}, "wrong_shape", ["gyro", "(4, 3)", "(5, 3)"]),
        ({"accel": np.zeros((3, 5))}, "wrong_shape", ["accel", "(3, 5)", "(5, 3)"]),
        ({"t": np.zeros((5, 1))}, "wrong_shape", ["t", "(5, 1)", "(n,)"]),
        ({"mag": np.zeros((5, 2))}, "wrong_shape", ["mag", "(5, 2)", "(5, 3)"]),
        ({"mag": (np.zeros(2), np.zeros((5, 3)))}, "wrong_shape", ["mag[1]", "(5, 3)", "(2, 3)"]),
        ({"t": [0, 1, 2, 1.5, 4]}, "backward_stamps", ["t[3]"]),
        ({"noise": "guess"}, "bad_option", ["noise", "guess", "datasheet"]),
        ({"config": {"gnns": {}}}, "unknown_config_key", ["gnns"]),
    ],
)
def test_names_the_argument_and_what_was_expected(changes: Any, code: str, words: list[str]) -> None:
    arguments: dict[str, Any] = {"t": np.arange(5.0), "gyro": np.zeros((5, 3)), "accel": np.zeros((5, 3))}
    with pytest.raises(ValueError) as caught:
        insnav.ahrs(**(arguments | changes))
    assert isinstance(caught.value, insnav.InsnavError)
    assert caught.value.code == code, str(caught.value)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("given", ["fast", -1.0, 0.0, float("nan")])
def test_refuses_ranges_that_are_none(given: Any) -> None:
    with pytest.raises(TypeError, match="gyro_range_deg_per_s"):
        insnav.ahrs(np.arange(5.0), np.zeros((5, 3)), np.zeros((5, 3)), gyro_range_deg_per_s=given)


def test_a_carrier_that_is_fast_may_accelerate_for_longer() -> None:
    """A level car in gentle bends that gains 3 m/s each second for six seconds: to a hand's filter that is a tilt of 17°."""
    t, gyro, _, _ = rest(40)
    gyro = gyro + np.outer(np.radians(5.0) * np.sin(np.pi * t), [0, 0, 1])
    push = np.outer((t > 20) & (t < 26), [3.0, 0.0, 0.0])
    accel = push + np.random.default_rng(2).normal([0.0, 0.0, -GRAVITY], 0.02, (len(t), 3))
    found = {v: insnav.ahrs(t, gyro, accel, noise="datasheet", carrier_speed_m_per_s=v) for v in (1.0, 8.0, None)}
    early = (found[1.0].time_s > 20) & (found[1.0].time_s < 22)
    tilt = {v: np.abs(o.pitch_deg) for v, o in found.items()}
    assert tilt[8.0][early].max() < 0.6 * tilt[1.0][early].max()
    # What is left is within what a car's filter states, and far beyond what a hand's does.
    normalised = {v: (tilt[v] / o.sigma_attitude_n_deg[:, :2].max(axis=1)).max() for v, o in found.items()}
    assert normalised[8.0] < 3 and normalised[1.0] > 5
    # A hand's is the default.
    assert np.array_equal(found[None].quaternion_nb_wxyz, found[1.0].quaternion_nb_wxyz)
