"""`insnav.run` on arrays, held against a drive simulated apart from the program."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulation import Drive, drive, metres_per_degree

import insnav
from insnav.sim import Scenario

CONFIG: dict[str, Any] = {
    "imu": {"grade": "industrial"},
    "gnss": {"lever_arm_b_m": [0.0, 0.0, 0.0]},
    "output": {"rate_hz": 10.0},
}
# White noise of the grade "industrial": 0.15 °/√h and 0.05 m/s/√h.
GYRO_WHITE = np.radians(0.15) / 60
ACCEL_WHITE = 0.05 / 60


@pytest.fixture(scope="module")
def truth() -> Drive:
    return drive()


def errors_m(solution: insnav.Solution, truth: Drive) -> NDArray[np.float64]:
    """True minus estimated position, north-east-down, m, shape (n, 3)."""
    t = solution.time_s
    north, east = metres_per_degree()
    return np.column_stack(
        [
            (truth.at(t, truth.latitude_deg) - solution.latitude_deg) * north,
            (truth.at(t, truth.longitude_deg) - solution.longitude_deg) * east,
            solution.height_m - truth.height_m,
        ]
    )


def nees(solutions: list[insnav.Solution], truth: Drive) -> float:
    """Mean normalised squared error of the position over a few instants far apart, per degree of freedom."""
    values = []
    for s in solutions:
        e = errors_m(s, truth)
        for instant in [60.0, 90.0, 120.0, 150.0]:
            i = int(np.argmin(np.abs(s.time_s - instant)))
            values.append(e[i] @ np.linalg.solve(s.position_covariance_n_m2[i], e[i]) / 3)
    return float(np.mean(values))


def noisy(truth: Drive, seed: int, **changes: Any) -> Any:
    return truth.arrays(np.random.default_rng(seed), gyro_white=GYRO_WHITE, accel_white=ACCEL_WHITE, **changes)


def test_finds_the_way_of_the_drive(truth: Drive) -> None:
    s = insnav.run(noisy(truth, 1), CONFIG)
    # Ten epochs per second for three minutes, the first at the first sample.
    assert len(s) == pytest.approx(1800, abs=1)
    assert s.time_s[0] == 0.0
    later = s.time_s > 60
    assert np.abs(errors_m(s, truth)[later]).max() < 0.1  # fixes are good to 0.02 m
    v = np.column_stack([truth.at(s.time_s, truth.velocity_n_m_per_s[:, k]) for k in range(3)])
    assert np.abs(s.velocity_n_m_per_s - v)[later].max() < 0.1  # 0.02 m/s
    turn = (truth.at(s.time_s, truth.heading_deg) - s.heading_deg + 180) % 360 - 180
    z = turn / s.sigma_attitude_n_deg[:, 2]
    assert np.abs(z[later]).max() < 4
    assert np.abs(turn[later]).max() < 1.0
    assert np.abs(s.roll_deg[later]).max() < 0.2 and np.abs(s.pitch_deg[later]).max() < 0.2
    assert s.standing[(s.time_s > 5) & (s.time_s < 19)].all() and not s.standing[later].any()


def test_sigmas_of_the_position_are_honest(truth: Drive) -> None:
    seeds = range(8)
    matched = [insnav.run(noisy(truth, k), CONFIG) for k in seeds]
    # 8 runs x 4 instants x 3 axes = 96 degrees of freedom: the mean is 1 ± sqrt(2 / 96); four of those.
    assert abs(nees(matched, truth) - 1) < 4 * np.sqrt(2 / 96)
    # Negative control: a receiver three times worse than it says.
    believing = {**CONFIG, "gnss": {**CONFIG["gnss"], "sigma_scale": 1.0}}
    overconfident = []
    for k in seeds:
        arrays = noisy(truth, k, position_sigma_m=0.06)
        stamps, positions, sigma = arrays["gnss_position"]
        arrays["gnss_position"] = (stamps, positions, sigma / 3)
        with pytest.warns(insnav.InsnavWarning, match="sigmas of gnss_position|positions scatter"):
            overconfident.append(insnav.run(arrays, believing))
    assert nees(overconfident, truth) > 1 + 4 * np.sqrt(2 / 96)


def test_columns_agree_with_each_other(truth: Drive) -> None:
    s = insnav.run(noisy(truth, 2), CONFIG)
    n = len(s)
    w, x, y, z = s.quaternion_nb_wxyz.T
    assert np.allclose(w * w + x * x + y * y + z * z, 1, atol=1e-12)
    heading = np.degrees(np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))) % 360
    assert np.allclose((heading - s.heading_deg + 180) % 360, 180, atol=1e-9)
    assert np.allclose(np.degrees(np.arctan2(2 * (y * z + w * x), 1 - 2 * (x * x + y * y))), s.roll_deg, atol=1e-9)
    for covariance, sigma in [
        (s.position_covariance_n_m2, s.sigma_position_n_m),
        (s.velocity_covariance_n_m2_per_s2, s.sigma_velocity_n_m_per_s),
        (s.attitude_covariance_n_rad2, np.radians(s.sigma_attitude_n_deg)),
    ]:
        assert covariance.shape == (n, 3, 3)
        assert np.array_equal(covariance, covariance.transpose(0, 2, 1))
        assert np.allclose(np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)), sigma, rtol=1e-12)
        assert (np.linalg.eigvalsh(covariance) > 0).all()
    for column in [s.gyro_bias_deg_per_hour, s.accel_bias_mg, s.sigma_gyro_bias_deg_per_hour, s.sigma_accel_bias_mg]:
        assert column.shape == (n, 3) and np.isfinite(column).all()
    assert np.array_equal((s.time_ns - s.t0_ns) * 1e-9, s.time_s)
    assert s.standing.dtype == np.bool_


def as_lists(arrays: Any) -> dict[str, Any]:
    return {key: [np.asarray(c).tolist() for c in columns] for key, columns in arrays.items()}


def as_strided(arrays: Any) -> dict[str, Any]:
    def strided(column: NDArray[np.float64]) -> NDArray[np.float64]:
        view = np.asfortranarray(np.repeat(column, 2, axis=-1))[..., ::2]
        assert not view.flags.c_contiguous
        return view

    return {key: tuple(strided(c) for c in columns) for key, columns in arrays.items()}


@pytest.mark.parametrize("form", [as_lists, as_strided])
def test_takes_whatever_numpy_takes(truth: Drive, form: Any) -> None:
    arrays = noisy(truth, 3)
    expected = insnav.run(arrays, CONFIG)
    got = insnav.run(form(arrays), CONFIG)
    assert np.array_equal(got.latitude_deg, expected.latitude_deg)
    assert np.array_equal(got.position_covariance_n_m2, expected.position_covariance_n_m2)


def test_dates_keep_stamps_exact(truth: Drive) -> None:
    arrays = noisy(truth, 4)
    start = np.datetime64("2026-03-01T12:00:00.000000001", "ns")
    dated = {
        key: (start + np.round(np.asarray(columns[0]) * 1e9).astype("timedelta64[ns]"), *columns[1:])
        for key, columns in arrays.items()
    }
    expected = insnav.run(arrays, CONFIG)
    got = insnav.run(dated, CONFIG)
    assert np.array_equal(got.time_ns - start.astype(np.int64), expected.time_ns)
    assert np.array_equal(got.latitude_deg, expected.latitude_deg)
    # Negative control: Unix seconds in a float are good to a quarter of a microsecond only.
    every = {**CONFIG, "output": {"rate_hz": 0.0}}
    floats = insnav.run(noisy(truth, 4, start_s=1772366400.0), every)
    assert not np.array_equal(floats.time_ns - floats.time_ns[0], insnav.run(dated, every).time_ns - start.astype(np.int64))


def test_increments_do_as_well_as_rates(truth: Drive) -> None:
    arrays = noisy(truth, 5)
    stamps, rates, forces = arrays.pop("imu")
    dt = stamps[1] - stamps[0]

    def gained(a: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.vstack([a[:1], (a[1:] + a[:-1]) / 2]) * dt)

    arrays["imu_increment"] = (stamps, gained(rates), gained(forces))
    s = insnav.run(arrays, CONFIG)
    assert np.abs(errors_m(s, truth)[s.time_s > 60]).max() < 0.1


def test_unknown_sigmas_are_not_believed_to_be_small(truth: Drive) -> None:
    arrays = noisy(truth, 6)
    stamps, positions, _ = arrays["gnss_position"]
    for unknown in [(stamps, positions), (stamps, positions, None), (stamps, positions, np.full(3, np.nan))]:
        with pytest.warns(insnav.InsnavWarning, match="900 of 900 positions state no sigma"):
            s = insnav.run({**arrays, "gnss_position": unknown}, CONFIG)
        assert (s.sigma_position_n_m[:, 0] > 0.1).all()
    s = insnav.run(arrays, CONFIG)
    assert (s.sigma_position_n_m[s.time_s > 60, 0] < 0.1).all()


def test_horizontal_velocity_alone_is_used(truth: Drive) -> None:
    arrays = noisy(truth, 7)
    stamps, velocities, sigma = arrays["gnss_velocity"]
    flat = velocities.copy()
    flat[:, 2] = np.nan
    with_flat = insnav.run({**arrays, "gnss_velocity": (stamps, flat, sigma)}, CONFIG)
    with pytest.warns(insnav.InsnavWarning, match="no GNSS velocity"):
        without = insnav.run({k: v for k, v in arrays.items() if k != "gnss_velocity"}, CONFIG)
    assert with_flat.sigma_velocity_n_m_per_s[-1, 0] < without.sigma_velocity_n_m_per_s[-1, 0]


def test_heading_from_outside_is_used(truth: Drive) -> None:
    arrays = noisy(truth, 8)
    stamps = truth.time_s[::100]
    arrays["heading"] = (stamps, truth.heading_deg[::100], np.full(stamps.shape, 0.01))
    with_heading = insnav.run(arrays, CONFIG)
    del arrays["heading"]
    without = insnav.run(arrays, CONFIG)
    assert with_heading.sigma_attitude_n_deg[-1, 2] < 0.01 < without.sigma_attitude_n_deg[-1, 2]


def test_time_offset_moves_the_epochs(truth: Drive) -> None:
    arrays = noisy(truth, 9)
    late = {**arrays, "imu": (arrays["imu"][0] + 0.25, *arrays["imu"][1:])}
    s = insnav.run(late, CONFIG, time_offset_s=-0.25)
    assert s.time_s[0] == pytest.approx(0, abs=1e-9)
    assert np.abs(errors_m(s, truth)[s.time_s > 60]).max() < 0.1
    # Negative control: a quarter of a second at 12 m/s is 3 m, of which the user is told.
    with pytest.warns(insnav.InsnavWarning):
        s = insnav.run(late, CONFIG)
    assert np.abs(errors_m(s, truth)[s.time_s > 60]).max() > 0.1


def auto(scenario: Scenario, seed: int, offset: float) -> insnav.Solution:
    """Run a simulated drive with stamps of the IMU that are off, the offset to be found."""
    arrays: dict[str, Any] = dict(scenario.simulate(seed).arrays)
    time_s, *rest = arrays["imu"]
    return insnav.run({**arrays, "imu": (time_s - offset, *rest)}, time_offset_s="auto")


@pytest.mark.filterwarnings("ignore::insnav.InsnavWarning")
def test_an_offset_is_found_under_a_plain_receiver() -> None:
    # Fixes of 1.5 m and 0.05 m/s once a second: positions alone know the offset to 0.12 s.
    plain = Scenario.car_drive(300.0).replace(imu={"rate_hz": 100.0})
    squares = 0.0
    for seed, offset in enumerate([-1.0, -0.3, -0.1, 0.05, 0.2, 0.3], start=1):
        summary = auto(plain, seed, offset).summary
        found, lag = summary["time_offset_s"], summary["gnss_velocity_lag_s"]
        assert found["sigma"] < 0.02 and lag["value"] == 0, (offset, found, lag)
        squares += ((found["value"] - offset) / found["sigma"]) ** 2
        codes = [w["code"] for w in summary["warnings"]]
        assert ("time_offset_large" in codes) == (abs(offset) > 0.5), codes
    # Chi-square of 6: 0.1 % is above 22.5.
    assert squares < 22.5


def test_no_offset_is_made_of_none() -> None:
    plain = Scenario.car_drive(300.0).replace(imu={"rate_hz": 100.0})
    summary = auto(plain, 1, 0.0).summary
    assert summary["time_offset_s"]["value"] == 0 and summary["time_offset_s"]["sigma"] < 0.02
    assert not any(w["code"].startswith("time_offset") for w in summary["warnings"])


@pytest.mark.filterwarnings("ignore::insnav.InsnavWarning")
def test_an_offset_that_is_not_found_is_told_as_such() -> None:
    poor = {"position_sigma_m": [5.0, 5.0, 10.0], "velocity_rate_hz": 0.0}
    summary = auto(Scenario.car_drive(300.0).replace(gnss=poor), 1, 0.2).summary
    assert summary["time_offset_s"] == {"value": 0.0, "sigma": None}
    (told,) = [w for w in summary["warnings"] if w["code"] == "time_offset_unknown"]
    assert "left as the settings have it" in told["message"]



def test_other_threads_run_meanwhile(truth: Drive) -> None:
    # A thousand samples a second, so that the run takes a while on any machine.
    arrays = noisy(drive(rate_hz=1000.0), 10)
    ticks: list[float] = []
    done = threading.Event()

    def tick() -> None:
        while not done.wait(0.001):
            ticks.append(time.perf_counter())

    thread = threading.Thread(target=tick)
    thread.start()
    begin = time.perf_counter()
    try:
        insnav.run(arrays, CONFIG)
    finally:
        end = time.perf_counter()
        done.set()
        thread.join()
    # Reading the arrays holds the interpreter for a few hundredths of a second; the loop must not.
    longest = np.diff([begin, *[t for t in ticks if begin < t < end], end]).max()
    assert longest < 0.7 * (end - begin), f"{longest:.3f} s of {end - begin:.3f} s"


def test_mounting_turns_the_axes(truth: Drive) -> None:
    arrays = noisy(truth, 11)
    stamps, rates, forces = arrays["imu"]
    # The unit lies on its side: its y axis points down, its z axis to the left.
    c_unit_body = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    turned = {**arrays, "imu": (stamps, rates @ c_unit_body.T, forces @ c_unit_body.T)}
    config = {**CONFIG, "imu": {"grade": "industrial", "mounting_rpy_deg": [90.0, 0.0, 0.0]}}
    expected, got = insnav.run(arrays, CONFIG), insnav.run(turned, config)
    # The cosine of 90 degrees is 6e-17 and not 0.
    assert np.allclose(got.latitude_deg, expected.latitude_deg, rtol=0, atol=1e-10)
    assert np.allclose(got.roll_deg, expected.roll_deg, rtol=0, atol=1e-6)


def test_summary_has_the_keys_of_the_command(truth: Drive) -> None:
    s = insnav.run(noisy(truth, 12), CONFIG)
    assert s.summary["imu_samples"] == len(truth.time_s)
    assert s.summary["final"]["latitude_deg"] == s.latitude_deg[-1]
    assert s.summary["warnings"] == []
    (stop,) = s.summary["stops"]
    # A stop at the very begin is seen once the detector's low-pass has settled; begins are good to a second.
    assert stop["begin_s"] == pytest.approx(0, abs=1) and stop["end_s"] == pytest.approx(20, abs=1)
    assert stop["pieces"] == 1
    names = {aid["name"]: aid for aid in s.summary["aiding"]}
    assert names["gnss_position"]["used"] + names["gnss_position"]["rejected"] > 890


def test_withheld_fixes_are_not_used(truth: Drive) -> None:
    s = insnav.run(noisy(truth, 13), CONFIG, withhold="100:110")
    # Both ends of ten seconds at five fixes a second.
    assert s.summary["withheld"] == 51
    before, end = (int(np.argmin(np.abs(s.time_s - t))) for t in [99.0, 109.9])
    assert s.sigma_position_n_m[end, 0] > 3 * s.sigma_position_n_m[before, 0]


def test_without_gnss_the_way_counts_from_the_start(truth: Drive) -> None:
    arrays = noisy(truth, 3)
    time_s, rate, force = arrays["imu"]
    at_rest = time_s < 5.0
    # Gyros that repeat one value at rest would be told of: a trace of noise.
    hum = np.random.default_rng(4).normal(0, 1e-7, rate[at_rest].shape)
    still = (time_s[at_rest], hum, 0.0 * force[at_rest] + [0.0, 0.0, -9.81])
    # Without a heading the Earth's rate is about an unknown axis, and that is said.
    with pytest.warns(insnav.InsnavWarning, match="heading"):
        s = insnav.run({"imu": still}, CONFIG, imu_only=True)
    assert s.summary["imu_only"]["gnss_left_out"] == []
    # A level unit without noise falls along its own vertical alone.
    assert s.summary["final"]["closure_horizontal_m"] < 0.01
    assert s.summary["alignment"]["heading_source"] == "relative"
    with pytest.raises(insnav.InsnavError, match="GNSS"):
        insnav.run({"imu": still}, CONFIG, imu_only=True, withhold="1:2")
    with pytest.raises(insnav.InsnavError, match="GNSS"):
        insnav.run({"imu": still}, CONFIG)


def test_stops_are_set_and_told(truth: Drive) -> None:
    known = {**CONFIG, "stationary": {"mode": "zupt", "detector": "none", "intervals_s": [[5.0, 15.0]]}}
    s = insnav.run(noisy(truth, 14), known)
    (stop,) = s.summary["stops"]
    assert stop["begin_s"] == pytest.approx(5, abs=0.02) and stop["end_s"] == pytest.approx(15, abs=0.1)
    assert stop["evidence"]["witness"] == "interval" and stop["evidence"]["speed_ratio"] is None
    assert "intervals_s = [[5.0, 15.0]]" in s.summary["config"]
    inside = (s.time_s > 5.1) & (s.time_s < 14.9)
    assert np.all(s.standing[inside]) and not np.any(s.standing[s.time_s > 16])
    assert np.allclose(s.standing_s[inside], s.time_s[inside] - stop["begin_s"])
    assert s.stop_ratios.shape == (len(s), 4)
    with pytest.raises(insnav.InsnavError, match=r"stationary\.mode"):
        insnav.run(noisy(truth, 14), {**CONFIG, "stationary": {"mode": "hold"}})
    with pytest.raises(insnav.InsnavError, match="window_s"):
        insnav.run(noisy(truth, 14), {**CONFIG, "stationary": {"window_s": 1e4}})


def test_standing_is_declared_by_arrays(truth: Drive) -> None:
    config = {**CONFIG, "stationary": {"detector": "none"}}
    declared = {**noisy(truth, 15), "standstill": ([5.0, 15.0], [True, False]), "speed": ([5.0, 15.0], [0.0, 0.0])}
    s = insnav.run(declared, config)
    (stop,) = s.summary["stops"]
    assert stop["begin_s"] == pytest.approx(5, abs=0.02)
    assert stop["evidence"]["witness"] == "declared"
    wheels = ([4.0, 7.0, 9.0], [0.0, float("nan"), float("nan")])
    with pytest.warns(insnav.InsnavWarning, match=r"2 samples .* the first at 7\.000 s: .*speed"):
        insnav.run({**declared, "speed": wheels}, config)
    with pytest.raises(insnav.InsnavError, match="neither true nor false"):
        insnav.run({**declared, "standstill": ([5.0], [float("nan")])}, config)


def test_one_uncertainty_for_all_rows_in_any_form() -> None:
    """A number, three, a covariance, and the same for every row give one solution to the last bit."""
    drive = insnav.sim.Scenario.car_drive(40.0).simulate(1)
    t, places = drive.arrays["gnss_position"][:2]
    n = len(np.asarray(t))

    def solved(stated: Any) -> NDArray[np.float64]:
        return insnav.run({**drive.arrays, "gnss_position": (t, places, stated)}, start=drive.start).latitude_deg

    expected = solved(np.full((n, 3), 2.0))
    for stated in (2.0, np.array(2.0), [2.0, 2.0, 2.0], 4.0 * np.eye(3), np.tile(4.0 * np.eye(3), (n, 1, 1))):
        assert np.array_equal(solved(stated), expected)
    assert not np.array_equal(solved(3.0), expected)
    with pytest.raises(insnav.ArgumentError, match="not negative"):
        solved(-1.0)
