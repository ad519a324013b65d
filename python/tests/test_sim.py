"""`insnav.sim`: held against the command, against kinematics written apart, and against what its noise is said to be."""

from __future__ import annotations

import copy
import csv
import json
import pickle
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulation import EARTH_RATE, gravity

import insnav
from insnav.sim import Scenario

Array = NDArray[np.float64]

START = {"latitude_deg": 50.0, "longitude_deg": 14.0, "height_m": 300.0, "heading_deg": 90.0}
QUIET: dict[str, Any] = {
    "grade": "navigation",
    "noise": {
        "gyro_arw_deg_per_sqrt_hour": 0.0,
        "accel_vrw_m_per_s_per_sqrt_hour": 0.0,
        "gyro_bias_deg_per_hour": 0.0,
        "accel_bias_mg": 0.0,
    },
}


def same(a: Any, b: Any) -> bool:
    """All arrays of two mappings or objects equal to the last bit."""
    a, b = (x if isinstance(x, dict) else vars(x) for x in (a, b))
    return a.keys() == b.keys() and all(np.array_equal(x, y, equal_nan=True) for k in a for x, y in zip(a[k], b[k], strict=True))


def standing(duration_s: float, **imu: Any) -> Scenario:
    """Level, heading 90 degrees at latitude 50."""
    return Scenario.from_dict({"start": START, "route": [{"duration_s": duration_s}], "imu": imu, "gnss": {"position_rate_hz": 1.0}})


def test_the_same_seed_gives_the_same_bits_and_another_gives_others() -> None:
    scenario = Scenario.car_drive(30.0)
    a, b, other = scenario.simulate(5), scenario.simulate(5), scenario.simulate(6)
    assert same(a.arrays, b.arrays) and same(a.truth, b.truth)
    assert not np.array_equal(a.arrays["imu"][1], other.arrays["imu"][1])
    # The motion does not depend on the seed, the biases do.
    assert np.array_equal(a.truth.latitude_deg, other.truth.latitude_deg)
    assert not np.array_equal(a.truth.gyro_bias_deg_per_hour, other.truth.gyro_bias_deg_per_hour)


def test_what_the_truth_is_told_of_is_written_apart() -> None:
    """At rest the gyros feel the Earth alone, the accelerometers gravity alone."""
    truth = standing(10.0, **QUIET).simulate(1).truth
    assert len(truth) == 101 and truth.standing.all()
    latitude = np.radians(50.0)
    # Heading 90 degrees: forward is east, right is south.
    earth = EARTH_RATE * np.array([0.0, -np.cos(latitude), -np.sin(latitude)])
    assert np.allclose(truth.angular_rate_b_rad_per_s, earth, rtol=0, atol=1e-18)
    down = gravity(np.array([latitude]))[0]
    # Somigliana's constant in the formula here has seven digits: 5e-10 of 9.8 m/s².
    assert np.allclose(truth.specific_force_b_m_per_s2, [0.0, 0.0, -down], rtol=0, atol=5e-9)
    assert np.allclose(truth.heading_deg, 90.0) and np.allclose(truth.velocity_n_m_per_s, 0.0)
    # A unit without errors says what is true.
    arrays = standing(10.0, **QUIET).simulate(1).arrays
    assert np.array_equal(arrays["imu"][1], np.broadcast_to(truth.angular_rate_b_rad_per_s[0], (1001, 3)))
    assert np.array_equal(arrays["imu"][2], np.broadcast_to(truth.specific_force_b_m_per_s2[0], (1001, 3)))


def test_truth_is_kinematics() -> None:
    """Position is the integral of velocity, velocity over ground is speed times course, and the turn is the one that was asked for."""
    route = [{"duration_s": 10.0, "speed_m_per_s": 12.0}, {"duration_s": 20.0, "turn_deg": 180.0}]
    scenario = Scenario.from_dict({"start": START, "route": route, "imu": QUIET})
    truth = scenario.simulate(1, truth_rate_hz=100.0).truth
    t, v = truth.time_s, truth.velocity_n_m_per_s
    course = np.radians(truth.heading_deg)
    speed = np.hypot(v[:, 0], v[:, 1])
    assert np.allclose(v[:, :2], speed[:, None] * np.column_stack([np.cos(course), np.sin(course)]), atol=1e-12)
    assert np.allclose(speed[t >= 10.0], 12.0) and np.isclose(truth.heading_deg[-1], 270.0)
    # Cumulative Simpson over steps of 0.02 s, metres per radian on the ellipsoid at this height.
    e2 = 1 / 298.257223563 * (2 - 1 / 298.257223563)
    s2 = np.sin(np.radians(truth.latitude_deg)) ** 2
    meridian = 6378137.0 * (1 - e2) / (1 - e2 * s2) ** 1.5 + truth.height_m
    rate = v[:, 0] / meridian
    north = np.cumsum((rate[:-2:2] + 4 * rate[1:-1:2] + rate[2::2]) * 0.02 / 6)
    gained = np.radians(truth.latitude_deg[2::2] - truth.latitude_deg[0])
    # Latitude in degrees has steps of 7e-15 degrees, 1e-9 m; Simpson leaves less.
    assert np.abs(gained - north).max() * 6.4e6 < 2e-8
    # The specific force turns with the velocity: v' = f + g - (2 w_ie + w_en) x v, and the last is below 2 mm/s².
    sin, cos = np.sin(course), np.cos(course)
    f = truth.specific_force_b_m_per_s2
    force_n = np.column_stack([cos * f[:, 0] - sin * f[:, 1], sin * f[:, 0] + cos * f[:, 1]])
    accel = np.gradient(v[:, :2], t, axis=0)
    assert np.abs(force_n - accel)[1:-1].max() < 4e-3
    # Negative control: without the turn it is not.
    assert np.abs(f[:, :2] - accel)[1:-1].max() > 1.0


def test_noise_is_what_the_settings_say() -> None:
    """White noise N has the Allan deviation N / sqrt(tau), here of an hour at rest."""
    arw, vrw = 0.3, 0.2
    noise = {"gyro_arw_deg_per_sqrt_hour": arw, "accel_vrw_m_per_s_per_sqrt_hour": vrw, "gyro_bias_deg_per_hour": 0.0, "accel_bias_mg": 0.0}
    imu = standing(3600.0, rate_hz=50.0, noise=noise).simulate(7).arrays["imu"]
    for record, density in [(imu[1], np.radians(arw) / 60), (imu[2], vrw / 60)]:
        for axis in range(3):
            allan = insnav.noise.overlapping_allan(record[:, axis], 0.02, [1, 50, 500])
            # Overlapping estimates of white noise at m samples scatter by about sqrt(0.75 m / n); five of those.
            scatter = np.sqrt(0.75 * allan.samples / len(record))
            ratio = allan.deviation * np.sqrt(allan.tau_s) / density
            assert np.all(np.abs(ratio - 1) < 5 * scatter), ratio


def test_biases_wander_as_a_gauss_markov_process() -> None:
    """The measured rate is the true rate and the bias that the truth tells."""
    noise = {**QUIET["noise"], "gyro_bias_deg_per_hour": 100.0, "gyro_bias_tau_s": 50.0}
    drive = standing(20.0, rate_hz=10.0, noise=noise).simulate(3, truth_rate_hz=10.0)
    bias = np.radians(drive.truth.gyro_bias_deg_per_hour) / 3600
    assert np.allclose(drive.arrays["imu"][1] - drive.truth.angular_rate_b_rad_per_s, bias, rtol=0, atol=1e-15)
    assert np.ptp(bias[:, 0]) > 0


def test_gauss_markov_has_its_sigma_and_correlation() -> None:
    step, tau, sigma = 0.5, 20.0, 3.0
    x = insnav.sim.gauss_markov(200_000, step, sigma=sigma, tau_s=tau, seed=2)
    lag = int(tau / step)
    # 5000 correlation times, three axes: independent squares are about n dt / tau each.
    independent = 3 * len(x) * step / tau
    assert abs(np.var(x) / sigma**2 - 1) < 5 * np.sqrt(2 / independent)
    correlation = np.mean(x[lag:] * x[:-lag]) / sigma**2
    assert abs(correlation - np.exp(-1)) < 5 * np.sqrt(1 / independent)
    first = insnav.sim.gauss_markov(2, step, sigma=sigma, tau_s=tau, seed=2, initial_sigma=[0.0, 1.0, 3.0])
    assert first[0, 0] == 0.0 and first[0, 2] == x[0, 2]


def test_white_noise_is_standard_and_by_stream() -> None:
    x = insnav.sim.white_noise(100_000, seed=1)
    assert abs(np.mean(x)) < 5 / np.sqrt(x.size) and abs(np.var(x) - 1) < 5 * np.sqrt(2 / x.size)
    assert abs(np.mean(x[:, 0] * x[:, 1])) < 5 / np.sqrt(len(x))
    assert not np.array_equal(x[:10], insnav.sim.white_noise(10, seed=1, stream="gyro_white"))
    assert np.array_equal(x[:10], insnav.sim.white_noise(10, seed=1, stream="initial"))
    with pytest.raises(insnav.ArgumentError, match="gyro_white"):
        insnav.sim.white_noise(1, seed=1, stream="gyros")


def test_fixes_scatter_by_their_sigmas_and_are_missing_in_outages() -> None:
    gnss = {
        "position_rate_hz": 10.0,
        "velocity_rate_hz": 10.0,
        "position_sigma_m": [1.0, 2.0, 3.0],
        "velocity_sigma_m_per_s": [0.1, 0.1, 0.2],
        "outages": [{"begin_s": 100.0, "end_s": 200.0}],
    }
    scenario = Scenario.standing(400.0).replace(gnss=gnss)
    drive = scenario.simulate(4)
    time_s, position, sigma = drive.arrays["gnss_position"]
    assert len(time_s) == 3001 and not np.any((time_s >= 100) & (time_s < 200))
    assert np.array_equal(sigma, np.broadcast_to([1.0, 2.0, 3.0], sigma.shape))
    degree = 6.38e6 * np.pi / 180
    metres = np.array([degree, degree * np.cos(np.radians(50.1)), 1.0])
    error = (position - [50.1, 14.4, 250.0]) * metres
    # 3001 fixes: a standard deviation is known to 1/sqrt(2 n), and radii to 0.5 %.
    assert np.all(np.abs(error.std(axis=0) / [1.0, 2.0, 3.0] - 1) < 5 / np.sqrt(2 * 3001) + 0.005)
    bare = scenario.replace(gnss={"states_covariance": False}).simulate(4).arrays
    assert len(bare["gnss_position"]) == 2 and np.array_equal(bare["gnss_position"][1], position)


def test_increments_are_integrals() -> None:
    scenario = Scenario.car_drive(70.0).replace(imu={**QUIET, "rate_hz": 100.0})
    truth = scenario.simulate(1, truth_rate_hz=1000.0).truth
    time_s, angle, _ = scenario.replace(imu={"output": "increments"}).simulate(1).arrays["imu_increment"]
    w = truth.angular_rate_b_rad_per_s
    for row in range(1, len(time_s)):
        part = w[10 * (row - 1) : 10 * row + 1]
        simpson = (part[0] + part[-1] + 4 * part[1::2].sum(axis=0) + 2 * part[2:-1:2].sum(axis=0)) * 1e-3 / 3
        # Simpson leaves h⁴/180 T w'''', with h = 1 ms, T = 10 ms and, of 0.4° + 0.25° + 0.15° at 1 to 2.5 Hz, w'''' up to 4300 rad/s⁵.
        assert np.abs(angle[row] - simpson).max() < 2.5e-13


def test_truth_at_is_the_truth() -> None:
    scenario = Scenario.car_drive(80.0).replace(gnss={"time_offset_s": 0.25})
    drive = scenario.simulate(9)
    assert drive.truth.time_s[0] == 0.25
    again = scenario.truth_at(drive.truth.time_s, seed=9)
    for name, column in vars(drive.truth).items():
        assert np.allclose(getattr(again, name), column, rtol=0, atol=1e-12), name


def test_a_drawn_start_is_honest() -> None:
    scenario = Scenario.car_drive(10.0)
    true = scenario.start()
    sigma: dict[str, Any] = {"sigma_position_n_m": [1.0, 2.0, 3.0], "sigma_velocity_n_m_per_s": 0.1, "sigma_attitude_n_deg": [0.1, 0.1, 1.0]}
    starts = [scenario.start(seed=k, **sigma) for k in range(400)]
    assert np.array_equal(starts[0]["sigma_position_n_m"], [1.0, 2.0, 3.0])
    heading = np.array([s["roll_deg_pitch_deg_heading_deg"][2] for s in starts]) - true["roll_deg_pitch_deg_heading_deg"][2]
    height = np.array([s["latitude_deg_longitude_deg_height_m"][2] for s in starts]) - 250.0
    for errors, s in [(heading, 1.0), (height, 3.0)]:
        # 400 draws: a standard deviation to 3.5 %, a mean to s / 20.
        assert abs(errors.std() / s - 1) < 4 / np.sqrt(800) and abs(errors.mean()) < 4 * s / 20
    assert np.array_equal(true["velocity_n_m_per_s"], [0, 0, 0])


def test_scenarios_are_values() -> None:
    demo = Scenario.demo()
    assert demo == Scenario.from_toml(demo.to_toml()) == Scenario.from_dict(demo.to_dict())
    assert demo == pickle.loads(pickle.dumps(demo)) == copy.deepcopy(demo)
    assert demo != demo.replace(duration_s=100.0)
    assert demo.replace() == demo and demo.replace(seed=3).seed == 3
    example = Scenario.from_toml(insnav.sim.EXAMPLE)
    assert example.seed == 1 and same(example.replace(duration_s=5.0).simulate().arrays, example.replace(duration_s=5.0).simulate(1).arrays)
    # A new route is as long as it is.
    assert demo.replace(route=[{"duration_s": 1000.0}]).duration_s == 1000.0
    assert demo.replace(route=[{"duration_s": 1000.0}], duration_s=20.0).duration_s == 20.0
    assert demo.replace(imu={"rate_hz": 50.0}).to_dict()["imu"]["grade"] == "consumer"
    drive = Scenario.car_drive(5.0).simulate(2)
    for again in [pickle.loads(pickle.dumps(drive)), copy.deepcopy(drive)]:
        assert again.scenario == drive.scenario and same(again.arrays, drive.arrays) and same(again.truth, drive.truth)


def test_mistakes_are_named_with_their_key(tmp_path: Path) -> None:
    scenario = Scenario.car_drive(10.0)
    with pytest.raises(insnav.ConfigError, match="gnss.position_sigma_m"):
        scenario.replace(gnss={"position_sigma": [1, 1, 1]})
    with pytest.raises(insnav.ConfigError, match=r"imu\.rate_hz"):
        scenario.replace(imu={"rate_hz": -1.0}).simulate(1)
    with pytest.raises(insnav.ConfigError, match="held in memory"):
        scenario.replace(imu={"rate_hz": 1e9})
    with pytest.raises(insnav.ArgumentError) as caught:
        Scenario.car_drive(-1.0)
    assert caught.value.argument == "duration_s"
    with pytest.raises(insnav.ArgumentError, match="truth_rate_hz"):
        scenario.simulate(1, truth_rate_hz=0.0)
    with pytest.raises(insnav.ArgumentError, match="sigma"):
        insnav.sim.gauss_markov(2, 1.0, sigma=[1.0, 2.0], tau_s=1.0, seed=1)
    with pytest.raises(insnav.ArgumentError, match="row 1"):
        scenario.truth_at([0.0, np.nan])
    with pytest.raises(insnav.InsnavError, match=r"none\.toml"):
        Scenario.from_toml(tmp_path / "none.toml")
    with pytest.raises(TypeError, match="expected a path"):
        Scenario.from_toml(3)  # type: ignore[arg-type]
    for seeded in (
        lambda: scenario.simulate(-1),
        lambda: scenario.truth_at([0.0], seed=2**64),
        lambda: scenario.start(seed=-1),
        lambda: insnav.sim.white_noise(1, seed=1.5),  # type: ignore[arg-type]
        lambda: insnav.sim.gauss_markov(1, 1.0, sigma=1.0, tau_s=1.0, seed=-1),
        lambda: insnav.sim.kozadaev2017(2, seed=-1),
    ):
        with pytest.raises(insnav.ArgumentError) as caught:
            seeded()
        assert caught.value.argument == "seed"
    assert scenario.simulate(None).seed == 1 and insnav.sim.white_noise(1, 2**64 - 1).shape == (1, 3)
    with pytest.raises(MemoryError, match="count"):
        insnav.sim.white_noise(2**60, 1)


def test_truth_is_that_of_the_command(command: Path, tmp_path: Path) -> None:
    scenario = Scenario.car_drive(90.0).replace(imu={"grade": "tactical"}, gnss={"time_offset_s": 0.1})
    (tmp_path / "drive.toml").write_text(scenario.to_toml())
    table = tmp_path / "truth.csv"
    arguments = ["simulate", "drive.toml", "-o", "drive.mcap", "--truth", str(table), "--seed", "3"]
    subprocess.run([str(command), *arguments], cwd=tmp_path, check=True, capture_output=True)
    truth = scenario.simulate(3).truth
    with table.open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == len(truth)
    # As many digits as the table has.
    for name, column, digits in [
        ("t_s", truth.time_s, 9),
        ("lat_deg", truth.latitude_deg, 11),
        ("h_m", truth.height_m, 5),
        ("vn", truth.velocity_n_m_per_s[:, 0], 6),
        ("yaw_deg", truth.heading_deg, 7),
    ]:
        assert [float(r[name]) for r in rows] == [float(f"{x:.{digits}f}") for x in column], name


def test_papers_are_made_as_the_command_makes_them(command: Path, data: Path) -> None:
    for paper, made, options in [
        ("lobusov2014", insnav.sim.lobusov2014(2, seed=3), ["--runs", "2", "--seed", "3", "--jobs", "1"]),
        ("kozadaev2017", insnav.sim.kozadaev2017(2, seed=4), ["--runs", "2", "--seed", "4"]),
    ]:
        said = subprocess.run([str(command), "reproduce", paper, *options, "--format", "json"], capture_output=True, text=True, check=True)
        assert made == json.loads(said.stdout), paper
        assert made["paper"] == paper and any(row["published"] is not None for row in made["rows"])
    assert insnav.sim.lobusov2014(2, seed=5)["rows"] != insnav.sim.lobusov2014(2, seed=3)["rows"]
    with pytest.raises(insnav.ArgumentError, match="at least 2"):
        insnav.sim.belokurov2018(1)
    with pytest.raises(insnav.ArgumentError, match="does not drive"):
        insnav.sim.kozadaev2017(2, imu=data, multi_stop=True)
    with pytest.raises(insnav.ArgumentError, match="jobs"):
        insnav.sim.kozadaev2017(2, jobs=0)
