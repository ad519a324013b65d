"""What the user is told when something is wrong."""

from __future__ import annotations

import copy
import datetime as dt
import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from simulation import drive

import insnav

T = np.arange(5.0)
XYZ = np.zeros((5, 3))


@pytest.mark.parametrize(
    ("arrays", "code", "words"),
    [
        ({"imu": (T, XYZ, np.zeros((4, 3)))}, "wrong_shape", ["imu: specific_force_b_m_per_s2", "(4, 3)", "(5, 3)"]),
        ({"imu": (T, XYZ.T, XYZ)}, "wrong_shape", ["imu: angular_rate_b_rad_per_s", "(3, 5)", "(5, 3)"]),
        ({"imu": (XYZ, XYZ, XYZ)}, "wrong_shape", ["imu: time_s", "(5, 3)", "(n,)"]),
        ({"imu": (T.astype("M8[s]").reshape(5, 1), XYZ, XYZ)}, "wrong_shape", ["imu: time_s", "(5, 1)", "(n,)"]),
        ({"imu": (T, 1.0, XYZ)}, "wrong_shape", ["imu: angular_rate_b_rad_per_s", "()", "(5, 3)"]),
        ({"imu": (T, XYZ)}, "wrong_shape", ["imu", "2 columns", "specific_force_b_m_per_s2"]),
        ({"gnss_position": (T, XYZ, np.zeros(5))}, "wrong_shape", ["sigma_n_m", "(5,)", "(5, 3), (3,) or one number", "(5, 3, 3) or (3, 3)"]),
        ({"heading": (T, T, T[:2])}, "wrong_shape", ["heading: sigma_deg", "(2,)", "(5,)"]),
        ({"imu": (T, [["x", "y", "z"]] * 5, XYZ)}, "not_numbers", ["imu: angular_rate_b_rad_per_s", "could not convert"]),
        ({"imu": (T, [[1.0], [1.0, 2.0]], XYZ)}, "not_numbers", ["imu: angular_rate_b_rad_per_s", "inhomogeneous"]),
        ({"imu": ([0, 1, np.nan, 3, 4], XYZ, XYZ)}, "not_finite", ["imu: time_s[2]"]),
        ({"imu": (np.array(["2026-01-01", "NaT"], "M8[ns]"), XYZ[:2], XYZ[:2])}, "not_finite", ["imu: time_s[1]"]),
        ({"imu": ([0, 1, 2, 1.5, 4], XYZ, XYZ)}, "backward_stamps", ["imu: time_s[3]", "1.5", "2.0"]),
        ({"imu": (T, XYZ, XYZ), "imu_increment": (T, XYZ, XYZ)}, "two_imus", ["imu_increment"]),
        ({"acc": (T, XYZ)}, "unknown_stream", ["`acc`", "gnss_position"]),
    ],
)
def test_names_the_argument_and_what_was_expected(arrays: Any, code: str, words: list[str]) -> None:
    with pytest.raises(insnav.ArgumentError) as caught:
        insnav.run(arrays)
    assert caught.value.code == code
    assert caught.value.argument and caught.value.received and caught.value.expected
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("log", [5, None, [1, 2], XYZ, {"imu": 3}, {"imu": "drive"}, {"imu": XYZ}, {"imu": {"time_s": T}}])
def test_refuses_other_types(log: Any) -> None:
    with pytest.raises(TypeError):
        insnav.run(log)


@pytest.mark.parametrize(
    ("config", "words"),
    [
        ({"gnss": {"lever_arm": [0, 0, 0]}}, ["lever_arm", "lever_arm_b_m"]),
        ("nowhere.toml", ["nowhere.toml", "cannot be read"]),
        ({"gnns": {}}, ["gnns", "gnss"]),
        ({"imu": {"grade": "toy"}}, ["toy", "consumer"]),
        ({"stationary": {"mode": "zup"}}, ["stationary.mode", "heading_hold", "did you mean `zupt`?"]),
        ({"alignment": {"heading_deg": 9999}}, ["alignment.heading_deg", "between -360 and 360"]),
        ({"gnss": {"lever_arm_b_m": [0, 0]}}, ["lever_arm_b_m"]),
        ({"gnss": {"sigma_scale": "big"}}, ["sigma_scale"]),
        ({"gnss": {"sigma_scale": -1.0}}, ["gnss.sigma_scale", "-1"]),
        ({"gnss": {"time_offset_s": float("nan")}}, ["gnss.time_offset_s", "NaN"]),
    ],
)
def test_names_the_key_of_a_bad_setting(config: Any, words: list[str]) -> None:
    with pytest.raises(insnav.ConfigError) as caught:
        insnav.run(drive(5.0).arrays(np.random.default_rng(0)), config)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("config", [5, {5: {}}, {"gnss": 5j}, {"gnss": {"lever_arm_b_m": object()}}])
def test_refuses_settings_of_other_types(config: Any) -> None:
    with pytest.raises(TypeError):
        insnav.run({}, config)


def test_none_and_numpy_are_settings_too() -> None:
    # Gyros that repeat one value at rest would be told of.
    arrays: Any = drive(60.0).arrays(np.random.default_rng(0), gyro_white=1e-6)
    # The drive has no arm: one within the noise of its fixes is contradicted by none.
    plain = insnav.run(arrays, {"gnss": {"lever_arm_b_m": [0.02, 0.0, -0.03], "sigma_scale": 1}})
    other = insnav.run(
        arrays,
        {"gnss": {"lever_arm_b_m": np.array([0.02, 0.0, -0.03]), "sigma_scale": np.float64(1.0), "time_offset_s": None}},
    )
    assert np.array_equal(plain.latitude_deg, other.latitude_deg)


def test_the_attributes_say_what_the_message_says() -> None:
    with pytest.raises(insnav.ArgumentError) as caught:
        insnav.run({"imu": (T, XYZ, XYZ[:4])})
    error = caught.value
    assert (error.argument, error.received, error.expected) == ("imu: specific_force_b_m_per_s2", "shape (4, 3)", "(5, 3)")
    assert error.message == f"{error.argument}: {error.received}, expected {error.expected}"
    assert error.time_s is None and error.time_ns is None and error.measurement is None
    with pytest.raises(insnav.ArgumentError) as caught:
        insnav.run({"imu": ([0, 1, 2, 1.5, 4], XYZ, XYZ)})
    assert caught.value.time_ns == 1_500_000_000


def bad_argument() -> None:
    insnav.run({"imu": (T, XYZ, XYZ[:1])})


def bad_config() -> None:
    insnav.run({}, {"gnss": {"lever_arm": 0}})


def bad_file(path: Path) -> None:
    insnav.run(path / "nowhere.mcap")


def no_rest() -> None:
    """Without GNSS a run begins at rest: this one turns from the first sample on."""
    t = np.arange(0, 20, 0.01)
    turning = np.column_stack([0.3 * np.sin(t), 0.2 * np.cos(3 * t), np.full(len(t), 0.2)])
    insnav.run({"imu": (t, turning, turning * 3 - [0, 0, 9.81])}, imu_only=True)


def no_data() -> None:
    insnav.run({"gnss_position": (T, XYZ)})


def unidentifiable() -> None:
    """Two process noises that enter at the same place: no record tells one from the other."""
    nu = np.random.default_rng(0).standard_normal(5000)
    insnav.noise.als_estimate(nu, [[0.9]], [[1.0, 1.0]], [[1.0]], [1.0, 1.0, 1.0], lags=20)


@pytest.mark.parametrize(
    ("error", "cause"),
    [
        (insnav.ArgumentError, bad_argument),
        (insnav.ConfigError, bad_config),
        (insnav.AlignmentError, no_rest),
        (insnav.NavigationError, no_data),
        (insnav.IdentificationError, unidentifiable),
    ],
)
def test_the_class_says_what_is_wrong(error: type[insnav.InsnavError], cause: Any) -> None:
    with pytest.raises(insnav.InsnavError) as caught:
        cause()
    assert type(caught.value) is error
    assert isinstance(caught.value, ValueError)
    assert caught.value.code != "error" and caught.value.message and "`--" not in caught.value.remedy
    same(caught.value, pickle.loads(pickle.dumps(caught.value)))
    same(caught.value, copy.deepcopy(caught.value))


def same(error: insnav.InsnavError, again: insnav.InsnavError) -> None:
    assert type(again) is type(error)
    assert (str(again), again.args, vars(again)) == (str(error), error.args, vars(error))


def test_a_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(insnav.LogError) as caught:
        bad_file(tmp_path)
    assert caught.value.path == str(tmp_path / "nowhere.mcap") and caught.value.topic is None
    same(caught.value, pickle.loads(pickle.dumps(caught.value)))
    (tmp_path / "text.mcap").write_text("no log at all\n" * 10)
    with pytest.raises(insnav.LogError) as caught:
        insnav.run(tmp_path / "text.mcap")
    assert caught.value.code == "not_an_mcap"


def test_a_key_is_named() -> None:
    with pytest.raises(insnav.ConfigError) as caught:
        bad_config()
    assert caught.value.key == "gnss.lever_arm"


def test_remedies_speak_python(tmp_path: Path) -> None:
    output = tmp_path / "there.mcap"
    output.write_bytes(b"")
    with pytest.raises(insnav.LogError) as caught:
        insnav.run(drive(60.0).arrays(np.random.default_rng(0)), output=output)
    assert caught.value.code == "output_exists"
    assert "overwrite=True" in caught.value.remedy and "--force" not in caught.value.remedy


def test_an_instant_is_told() -> None:
    t = np.arange(0.0, 60.0, 0.01)
    t[3000:] += np.tile([0.0, 0.004], 1500)
    noise = np.random.default_rng(0).standard_normal((6000, 6))
    with pytest.raises(insnav.IdentificationError) as caught:
        insnav.noise.identify_noise(t + 100.0, noise[:, :3] * 1e-3, noise[:, 3:] * 1e-2 - [0, 0, 9.81])
    assert caught.value.code == "uneven_steps"
    assert caught.value.time_s is not None and 29.9 < caught.value.time_s - 100.0 < 31.0


def test_user_classes_and_attributes_survive() -> None:
    error = insnav.NavigationError("m", "c", "r", time_s=1.5, time_ns=7, measurement="GNSS position")
    error.add_note("while it rained") if sys.version_info >= (3, 11) else None
    again = pickle.loads(pickle.dumps(error))
    same(error, again)
    assert (again.time_s, again.time_ns, again.measurement) == (1.5, 7, "GNSS position")


def test_a_log_is_not_written_over_by_its_solution(tmp_path: Path) -> None:
    log = tmp_path / "in.mcap"
    insnav.write_mcap(log, insnav.sim.Scenario.standing(5.0, 45.0).simulate(1))
    before = log.read_bytes()
    with pytest.raises(insnav.ArgumentError, match="is the log itself") as raised:
        insnav.run(log, output=tmp_path / "." / "in.mcap", overwrite=True)
    assert raised.value.argument == "output" and log.read_bytes() == before


def stamps_of(time_s: Any) -> list[int]:
    """What the package makes of stamps, ns."""
    zero = np.zeros((len(time_s), 3))
    return [round(float(t) * 1e9) for t in insnav.mechanization.increments(time_s, zero, zero).time_s]


def test_dates_durations_and_seconds_are_the_same_stamps() -> None:
    naive = np.datetime64("2022-01-01T00:00:00") + np.arange(4) * np.timedelta64(10, "ms")
    own = [dt.datetime(2022, 1, 1) + dt.timedelta(milliseconds=10 * i) for i in range(4)]
    seconds = naive.astype("datetime64[ns]").astype(np.int64) * 1e-9
    assert stamps_of(naive) == stamps_of(own)
    # A float of seconds has steps of a quarter of a microsecond there.
    assert np.allclose(np.subtract(stamps_of(naive), stamps_of(seconds)), 0, atol=512)
    assert stamps_of(np.arange(4) * np.timedelta64(250, "ms")) == [250_000_000, 500_000_000, 750_000_000]


def test_dates_with_a_zone_are_instants() -> None:
    pandas = pytest.importorskip("pandas")
    naive = pandas.date_range("2022-01-01", periods=4, freq="10ms")
    for zone in ["UTC", "Asia/Tokyo"]:
        there = naive.tz_localize("UTC").tz_convert(zone)
        assert stamps_of(there) == stamps_of(pandas.Series(there)) == stamps_of(naive)


@pytest.mark.parametrize("factor", [1e3, 1e9])
def test_seconds_that_are_none_are_named(factor: float) -> None:
    t = (1.7e9 + np.arange(4.0)) * factor * 10
    with pytest.raises(insnav.ArgumentError, match="more than 290 years"):
        stamps_of(t)


@pytest.mark.parametrize("r", [[[-0.5]], [[1.0, 0.9], [0.0, 1.0]], [[1.0, 2.0], [2.0, 1.0]]])
def test_a_noise_that_is_no_covariance_is_refused(r: list[list[float]]) -> None:
    start = insnav.mechanization.NavState.from_degrees(45.0, 7.0, 300.0)
    filter = insnav.Eskf(start, "industrial", position_sigma=1.0, velocity_sigma=0.1, attitude_sigma=0.1)
    before = filter.covariance.copy()
    rows = np.eye(3)[: len(r)]
    with pytest.raises(insnav.ArgumentError, match="r: .*expected a symmetric matrix without negative variances"):
        filter.update_linear("own", np.ones(len(r)), {"position": rows}, r)
    assert np.array_equal(filter.covariance, before)
    filter.update_linear("own", np.ones(len(r)), {"position": rows}, np.eye(len(r)))


def test_remedies_can_be_pasted() -> None:
    t = np.arange(0.0, 30.0, 0.01)
    rng = np.random.default_rng(0)
    accel = np.array([0.0, 0.0, -1.0]) + rng.normal(0, 1e-3, (len(t), 3))
    arrays = {"imu": (t, rng.normal(0, 1e-3, (len(t), 3)), accel), "gnss_position": ([1.0, 20.0], [[45.0, 7.0, 300.0]] * 2)}
    with pytest.raises(insnav.InsnavError) as raised:
        insnav.run(arrays)
    assert "rad/s and m/s² in arrays" in raised.value.remedy and "`--" not in raised.value.remedy


def test_a_start_that_is_none_is_refused_by_name() -> None:
    t = np.arange(100) / 100
    arrays: Any = {"imu": (t, np.zeros((100, 3)), np.tile([0.0, 0.0, -9.81], (100, 1)))}
    for call in (lambda: insnav.run(arrays, start=5), lambda: insnav.Navigator(start=5)):  # type: ignore[arg-type]
        with pytest.raises(insnav.ArgumentError, match="insnav.Start") as caught:
            call()
        assert caught.value.argument == "start"


def _heading(value: float) -> object:
    state = insnav.mechanization.NavState.from_degrees(50.0, 14.0, 300.0)
    eskf = insnav.Eskf(state, "consumer", position_sigma=10.0, velocity_sigma=1.0, attitude_sigma=0.1)
    return eskf.update_heading(value, sigma=0.1)


RECORD = np.random.default_rng(0).normal(size=1000)


@pytest.mark.parametrize(
    ("call", "argument", "part"),
    [
        (lambda: insnav.noise.overlapping_allan(RECORD, 0.01, [-1]), "samples", "not negative"),
        (lambda: insnav.noise.overlapping_allan(np.where(np.arange(1000) == 7, np.nan, RECORD), 0.01), "x", r"x\[7\]: is not finite"),
        (lambda: insnav.noise.lag_covariance(RECORD[:, None], -1), "lags", "not negative"),
        (lambda: insnav.noise.LagAccumulator(-1, 2), "channels", "not negative"),
        (lambda: insnav.noise.als_estimate(RECORD, [[0.5]], [[1.0]], [[1.0]], [-1.0, 1.0]), "start", "variances"),
        (lambda: insnav.noise.als_estimate(RECORD, [[0.5]], [[1.0]], [[1.0]], [1.0, 1.0], rounds=0), "rounds", "at least 1"),
        (lambda: insnav.sim.white_noise(-1, 1), "count", "not negative"),
        (lambda: insnav.filter.Gate(patience=-1), "patience", "not negative"),
        (lambda: insnav.filter.Gate((1.0, 2.0)), "limit", r"\(2,\), expected \(3,\)"),  # type: ignore[arg-type]
        (lambda: insnav.filter.Gate((-1.0, 2.0, 3.0)), "limit", "not negative"),
        (lambda: insnav.filter.ImuNoise.from_data_sheet(-1, 1, 1, 1), "gyro_arw_deg_per_sqrt_hour", "not negative"),
        (lambda: insnav.filter.ImuNoise.from_data_sheet(1, 1, 1, 1, gyro_bias_tau_s=0), "gyro_bias_tau_s", "above 0"),
        (lambda: _heading(130.0), "heading", r"radians.*np\.radians\(130\)"),
        (lambda: insnav.stationary.quantile_of_squares(-1, 2, 3), "mean", "above 0"),
        (lambda: insnav.Navigator().step_standstill(1.0, float("nan")), "standing", "True or False"),  # type: ignore[arg-type]
        (lambda: insnav.Navigator().step("standstill", 1.0, float("nan")), "standing", "True or False"),
        (
            lambda: insnav.mechanization.increments(T, np.where(np.arange(5)[:, None] == 3, np.nan, XYZ), XYZ),
            "angular_rate_b",
            r"angular_rate_b\[3\]: is not finite",
        ),
    ],
)
def test_what_cannot_be_is_refused_by_name(call: Any, argument: str, part: str) -> None:
    with pytest.raises(insnav.ArgumentError, match=part) as caught:
        call()
    assert caught.value.argument == argument


def test_what_is_at_the_edge_is_taken() -> None:
    """The negative control of the refusals above."""
    assert insnav.filter.Gate((0.0, np.inf, 3.0), patience=0).patience == 0
    assert insnav.filter.ImuNoise.from_data_sheet(0, 0, 0, 0).gyro_white == 0
    assert _heading(-6.2) is not None
    assert insnav.sim.white_noise(0, 1).shape == (0, 3)
    navigator = insnav.Navigator()
    for standing in (True, np.True_, 1.0, 0):
        navigator.step_standstill(1.0, standing)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="withhold: expected intervals"):
        insnav.run({"imu": (T, XYZ, XYZ)}, withhold=[(1, 2)])  # type: ignore[arg-type]


def test_settings_are_taken_as_text() -> None:
    """That of another run, or one's own; a mistake in it is told as in a file."""
    drive = insnav.sim.Scenario.car_drive(40.0).simulate(1)
    first = insnav.run(drive.arrays, {"gnss": {"sigma_floor_m": 0.05}}, start=drive.start)
    again = insnav.run(drive.arrays, first.summary["config"], start=drive.start)
    assert again.summary["config"] == first.summary["config"]
    assert np.array_equal(again.latitude_deg, first.latitude_deg)
    with pytest.raises(insnav.ConfigError, match="unknown key `gnss.sigma_flor_m`"):
        insnav.run(drive.arrays, "[gnss]\nsigma_flor_m = 0.05")
    # What has one line is a path still.
    with pytest.raises(insnav.ConfigError, match="car.toml"):
        insnav.run(drive.arrays, "car.toml")


def test_remedies_for_arrays_do_not_speak_of_logs() -> None:
    drive = insnav.sim.Scenario.car_drive(120.0).simulate(1)
    t, velocity, sigma = drive.arrays["gnss_velocity"]
    as_enu = np.asarray(velocity)[:, [1, 0, 2]] * [1.0, 1.0, -1.0]
    with pytest.warns(insnav.InsnavWarning) as caught:
        insnav.run({**drive.arrays, "gnss_velocity": (t, as_enu, sigma)}, start=drive.start)
    texts = [str(w.message) for w in caught]
    told = [text for text in texts if "only when it is taken as" in text]
    assert len(told) == 1 and "taken as enu" in told[0], texts
    assert "columns of `gnss_velocity` as north, east, down: these look like enu" in told[0]
    assert not any("`--" in text or "insnav info" in text for text in texts), texts
    with pytest.raises(insnav.InsnavError) as none:
        insnav.run({"gnss_position": drive.arrays["gnss_position"]})
    assert "`imu`" in none.value.remedy and "topic" not in none.value.remedy
    position = drive.arrays["gnss_position"]
    with pytest.raises(insnav.InsnavError) as later:
        insnav.run({**drive.arrays, "gnss_position": (np.asarray(position[0]) + 1e6, *position[1:])})
    assert "stamps" in later.value.remedy and "time_source" not in later.value.remedy


def test_intervals_outside_the_data_are_told() -> None:
    drive = insnav.sim.Scenario.car_drive(40.0).simulate(1)
    with pytest.warns(insnav.InsnavWarning, match=r"nothing is withheld in 1000:2000 s: the data last from 0\.0 to 40\.0 s"):
        insnav.run(drive.arrays, start=drive.start, withhold="30:35,1000:2000")


def test_an_outage_that_ends_before_it_begins_is_refused() -> None:
    scenario = insnav.sim.Scenario.car_drive(40.0)
    with pytest.raises(insnav.ConfigError, match=r"gnss\.outages.*later"):
        scenario.replace(gnss={"outages": [{"begin_s": 30.0, "end_s": 20.0}]}).simulate(1)
    assert len(scenario.replace(gnss={"outages": [{"begin_s": 20.0, "end_s": 30.0}]}).simulate(1).arrays["gnss_position"][0])
