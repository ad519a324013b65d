"""`insnav.align` against numpy, published numbers and the command."""

from __future__ import annotations

import copy
import json
import pickle
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulation import EARTH_RATE, HEIGHT, drive, gravity

import insnav
from insnav import align

Array = NDArray[np.float64]

LATITUDE_DEG, AZIMUTH_DEG, RATE_HZ = 60.0, 45.0, 100.0
G = float(gravity(np.radians(np.array(LATITUDE_DEG))))
UG = 9.80665e-6
# The stops of [Lobusov14], without the samples at the edges of the turn between.
STOPS = [(40.0, 199.0), (221.0, 380.0)]
DRIFT = np.array([1e-7, 1e-7, 1e-7])
# 0.001 °/√h, 5 µg/√Hz, biases of 1e-7 rad/s and 50 µg that do not wander within the record.
UNIT = {
    "imu": {"grade": "navigation"},
    "noise": {
        "gyro_arw_deg_per_sqrt_hour": 0.001,
        "accel_vrw_m_per_s_per_sqrt_hour": 5 * UG * 60,
        "gyro_bias_deg_per_hour": np.degrees(1e-7) * 3600,
        "accel_bias_mg": 0.05,
        "gyro_bias_tau_s": 1e9,
        "accel_bias_tau_s": 1e9,
    },
}
WHERE: dict[str, Any] = {"latitude_deg": LATITUDE_DEG, "height_m": HEIGHT, "config": UNIT}


def turntable(
    turn_deg: float = 180.0, drift: Array = DRIFT, bias: float = 0.0, pitch_deg: float = 0.0
) -> tuple[Array, Array, Array]:
    """A body that stands, and is turned about the vertical between 200 and 220 s; no noise."""
    t = np.arange(0, 390 * RATE_HZ + 1) / RATE_HZ
    rate = np.radians(turn_deg) / 20
    turning = (t >= 200) & (t < 220)
    heading = np.radians(AZIMUTH_DEG) + rate * np.clip(t - 200, 0, 20)
    c, s = np.cos(heading), np.sin(heading)
    north, down = EARTH_RATE * np.cos(np.radians(LATITUDE_DEG)), -EARTH_RATE * np.sin(np.radians(LATITUDE_DEG))
    level = np.column_stack([c * north, -s * north, down + rate * turning])
    tilt = np.radians(pitch_deg)
    to_body = np.array([[np.cos(tilt), 0, -np.sin(tilt)], [0, 1, 0], [np.sin(tilt), 0, np.cos(tilt)]])
    force = np.tile([0.0, 0.0, -G], (len(t), 1))
    return t, level @ to_body.T + drift, force @ to_body.T + bias


@pytest.mark.parametrize("method", ["joint", "kalman", "multi_position"])
@pytest.mark.parametrize("drift", [[1e-7, -1e-7, 1e-7], [1e-7, 1e-7, 1e-7]])
def test_drifts_and_azimuth_of_two_positions(method: str, drift: list[float]) -> None:
    record = align.Record(*turntable(drift=np.array(drift), bias=50 * UG))
    function = getattr(align, method)
    found = function(record, STOPS, **WHERE)
    # Rates of 100 Hz with corners at the turn; the prior of the filter holds it back by the square of its sigma over that beforehand.
    share = 1e-3 if found.method == "joint" else 0.05
    np.testing.assert_allclose(found.gyro_bias_rad_per_s, drift, rtol=0, atol=share * 1e-7)
    assert found.azimuth_deg == pytest.approx(AZIMUTH_DEG, abs=0.002 if found.method == "joint" else 0.01)
    assert found.heading_deg == pytest.approx(AZIMUTH_DEG + 180, abs=0.01)
    assert found.at_s == pytest.approx(380, abs=0.11) and len(found.stops) == 2
    assert found.covariance.shape == (9, 9) and found.summary is None
    np.testing.assert_allclose(found.covariance, found.covariance.T, rtol=0, atol=0)
    sigma = np.sqrt(np.diag(found.covariance))
    np.testing.assert_allclose(np.radians(found.sigma_attitude_n_deg), sigma[:3], rtol=1e-12)
    np.testing.assert_allclose(found.sigma_gyro_bias_rad_per_s, sigma[3:6], rtol=1e-12)
    # What two stops of this length can do: N/√(2T) of drift, 18 nrad/s by the Cramér–Rao limit (design/zupt.md).
    assert 10e-9 < sigma[3] < 30e-9 and found.observable.dtype == np.bool_ and found.observable[2]
    assert found.sigma_azimuth_deg == pytest.approx(1.7 / 60, rel=0.5)
    w, x, y, z = found.quaternion_nb_wxyz
    assert np.degrees(np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))) % 360 == pytest.approx(found.heading_deg)


def test_the_papers_equations_give_the_papers_order() -> None:
    """6.5, 1.4 and 0.5 % are published ([Lobusov14]); the joint regression of the same data is a thousand times nearer."""
    record = align.Record(*turntable())
    off = np.abs(align.paper(record, STOPS, **WHERE).gyro_bias_rad_per_s / DRIFT - 1)
    assert 0.002 < off[:2].max() < 0.12
    assert np.abs(align.joint(record, STOPS, **WHERE).gyro_bias_rad_per_s / DRIFT - 1).max() < 1e-3
    # It knows no accelerometer bias.
    biased = align.paper(align.Record(*turntable(bias=500 * UG)), STOPS, **WHERE)
    assert np.abs(biased.gyro_bias_rad_per_s / DRIFT - 1).max() > 0.2


def test_a_known_azimuth_tells_the_drifts() -> None:
    record = align.Record(*turntable())
    exact = align.zupt2(record, STOPS[:1], **WHERE, heading_deg=AZIMUTH_DEG, heading_sigma_deg=1e-6)
    np.testing.assert_allclose(exact.gyro_bias_rad_per_s, DRIFT, rtol=0, atol=1e-11)
    # One minute of arc is 10.6 nrad/s about east: Ω cos L (design/zupt.md, A8).
    wrong = align.zupt2(record, STOPS[:1], **WHERE, heading_deg=AZIMUTH_DEG + 1 / 60, heading_sigma_deg=1 / 60)
    c = s = np.sqrt(0.5)
    shift = wrong.gyro_bias_rad_per_s - exact.gyro_bias_rad_per_s
    assert s * shift[0] + c * shift[1] == pytest.approx(10.61e-9, abs=0.1e-9)
    axis = np.array([s, c, 0])
    assert np.sqrt(axis @ wrong.covariance[3:6, 3:6] @ axis) > 10.6e-9


@pytest.mark.parametrize("method", ["two_vector", "coarse", "gyrocompass", "fine"])
def test_one_stop_finds_north(method: str) -> None:
    record = align.Record(*turntable(drift=np.zeros(3), pitch_deg=10.0))
    found = getattr(align, method)(record, STOPS[:1], **WHERE)
    # The loop leaves hundredths of a minute of arc, the others less (design/zupt.md).
    assert found.heading_deg == pytest.approx(AZIMUTH_DEG, abs=0.01)
    assert found.pitch_deg == pytest.approx(10, abs=1e-4) and found.roll_deg == pytest.approx(0, abs=1e-3)
    # A bias of 1e-7 rad/s along east over Ω cos L.
    least = np.degrees(1e-7 / (EARTH_RATE * np.cos(np.radians(LATITUDE_DEG))))
    assert least < found.sigma_azimuth_deg < 1.5 * least


def test_a_poor_unit_is_levelled_and_told_why() -> None:
    t, gyro, accel = turntable(pitch_deg=-20.0)
    source = {"imu": (t, gyro, accel)}
    config = {"imu": {"grade": "consumer"}}
    with pytest.warns(insnav.InsnavWarning, match="heading is not found.*`heading_deg`"):
        found = align.by_stops(source, config, stops=STOPS, latitude_deg=LATITUDE_DEG)
    assert found.method == "levelling" and found.heading_deg is None and found.azimuth_deg is None
    assert found.pitch_deg == pytest.approx(-20, abs=0.01) and not found.observable[2]
    with pytest.raises(insnav.AlignmentError) as caught:
        align.coarse(align.Record(t, gyro, accel), STOPS[:1], latitude_deg=LATITUDE_DEG, config=config)
    assert caught.value.code == "low_grade" and caught.value.remedy


def test_refusals_name_the_stop() -> None:
    record = align.Record(*turntable())
    cases: list[tuple[list[tuple[float, float]], str, float | None]] = [
        # In the turn.
        ([(190.0, 260.0)], "not_stationary", 190.0),
        ([(40.0, 60.0)], "stop_too_short", 40.0),
        ([(40.0, 200.0), (150.0, 380.0)], "stops_overlap", 150.0),
        ([(300.0, 500.0)], "outside_data", 300.0),
        ([(40.0, 200.0), (80.0, 100.0)], "stops_overlap", 80.0),
    ]
    for stops, code, time_s in cases:
        with pytest.raises(insnav.AlignmentError) as caught:
            align.joint(record, stops, **WHERE)
        assert caught.value.code == code, str(caught.value)
        assert caught.value.time_s == pytest.approx(time_s, abs=0.11)
    # South is not north: the Earth's rate contradicts it.
    with pytest.raises(insnav.AlignmentError) as caught:
        align.joint(record, STOPS, latitude_deg=-LATITUDE_DEG, height_m=HEIGHT, config=UNIT)
    assert caught.value.code == "latitude_inconsistent"
    # Rates with the wrong sign are another Earth.
    t, gyro, accel = turntable()
    with pytest.raises(insnav.AlignmentError) as caught:
        align.joint(align.Record(t, -gyro, accel), STOPS, **WHERE)
    assert caught.value.code in ("latitude_inconsistent", "not_stationary")


def test_increments_are_the_same_record() -> None:
    t, gyro, accel = turntable(turn_deg=0.0)
    dt = 1 / RATE_HZ
    rates = align.Record(t, gyro, accel)
    increments = align.Record(t, gyro * dt, accel * dt, increments=True)
    found = [align.coarse(r, STOPS[:1], **WHERE).heading_deg for r in (rates, increments)]
    assert found[0] == pytest.approx(found[1], abs=1e-6)
    assert rates.span_s == pytest.approx((0.0, 390.0))


def test_records_and_results_pickle_to_the_last_bit() -> None:
    record = align.Record(*turntable())
    found = align.joint(record, STOPS, **WHERE)
    for again in (pickle.loads(pickle.dumps(record)), copy.deepcopy(record)):
        assert repr(again) == repr(record)
        same = align.joint(again, STOPS, **WHERE)
        assert np.array_equal(same.covariance, found.covariance) and same.azimuth_deg == found.azimuth_deg
    back = pickle.loads(pickle.dumps(found))
    assert np.array_equal(back.quaternion_nb_wxyz, found.quaternion_nb_wxyz) and back.method == found.method
    assert back.stops[1].begin_s == found.stops[1].begin_s
    with pytest.raises(ValueError, match="version"):
        align.Record._from_state(b"\x05other")  # type: ignore[attr-defined]


def test_gives_what_the_command_gives(command: Path, tmp_path: Path) -> None:
    t, gyro, accel = turntable()
    rng = np.random.default_rng(3)
    gyro = gyro + rng.normal(0, np.radians(0.001) / 60 * np.sqrt(RATE_HZ), gyro.shape)
    accel = accel + rng.normal(0, 5 * UG * np.sqrt(RATE_HZ), accel.shape)
    rows = np.column_stack([t, gyro, accel])
    np.savetxt(tmp_path / "imu.csv", rows, fmt="%.17g", delimiter=",", header="t_s,gx,gy,gz,ax,ay,az", comments="")
    config = tmp_path / "unit.toml"
    config.write_text('[imu]\ngrade = "navigation"\n')
    log = tmp_path / "log.mcap"
    stops = [word for begin, end in STOPS for word in ("--stop", f"{begin}:{end}")]
    for words in (
        ["convert", tmp_path / "imu.csv", "-o", log],
        ["align", log, "--config", config, "--latitude-deg", LATITUDE_DEG, *stops, "--format", "json"],
    ):
        done = subprocess.run([str(w) for w in (command, *words)], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    of_log = align.by_stops(log, config, stops=STOPS, latitude_deg=LATITUDE_DEG)
    assert of_log.summary == told
    of_arrays = align.by_stops({"imu": (t, gyro, accel)}, config, stops=STOPS, latitude_deg=LATITUDE_DEG)
    assert of_arrays.summary is not None and of_arrays.summary.keys() == told.keys()
    # The file has forward-left-up axes and stamps since 1970, whole nanoseconds both.
    assert of_arrays.summary["azimuth_deg"] == pytest.approx(told["azimuth_deg"], abs=1e-9)
    np.testing.assert_allclose(of_arrays.covariance, told["covariance"], rtol=1e-6, atol=1e-30)
    np.testing.assert_allclose(of_log.gyro_bias_rad_per_s, told["gyro_bias_rad_per_s"], rtol=0, atol=0)


def test_level_is_the_direction_of_gravity() -> None:
    rng = np.random.default_rng(0)
    f = rng.normal(0, 5, (50, 3))
    roll, pitch = align.level(f)
    np.testing.assert_allclose(roll, np.degrees(np.arctan2(-f[:, 1], -f[:, 2])), atol=1e-9)
    np.testing.assert_allclose(pitch, np.degrees(np.arctan2(f[:, 0], np.hypot(f[:, 1], f[:, 2]))), atol=1e-9)
    one = align.level([float(x) for x in f[7]])
    assert isinstance(one[0], float) and one == (roll[7], pitch[7])
    assert align.level(f.astype(np.float32)[::2])[0].shape == (25,)
    with pytest.raises(insnav.ArgumentError, match=r"specific_force_b: shape \(2, 2\), expected \(n, 3\) or \(3,\)"):
        align.level(np.zeros((2, 2)))
    with pytest.raises(insnav.ArgumentError, match="no direction"):
        align.level([0.0, 0.0, 0.0])


def test_a_drive_begins_by_its_course() -> None:
    truth = drive(60.0)
    arrays = truth.arrays(np.random.default_rng(0), start_s=1000.0)
    found = align.start(arrays)
    assert found.heading_source == "course_velocity" and not found.reversing and found.standing_s > 15
    assert found.heading_deg is not None and found.time_s == pytest.approx(1000, abs=1e-9)
    off = (found.heading_deg - truth.heading_deg[0] + 180) % 360 - 180
    assert abs(off) < 3 * found.sigma_attitude_n_deg[2] < 30
    np.testing.assert_allclose(found.latitude_deg_longitude_deg_height_m[:2], [50, 14], atol=1e-5)
    # Who drives backwards has its course behind.
    backwards = dict(arrays)
    t, gyro, accel = arrays["imu"]
    turned = np.array([-1.0, -1.0, 1.0])
    backwards["imu"] = (t, gyro * turned, accel * turned)
    again = align.start(backwards)
    assert again.reversing and again.heading_deg is not None
    assert (again.heading_deg - found.heading_deg) % 360 == pytest.approx(180, abs=3)
    given = align.start(arrays, {"alignment": {"heading_deg": 33.0}})
    assert given.heading_source == "given" and given.heading_deg == pytest.approx(33)
    with pytest.raises(insnav.AlignmentError, match="no inertial sample"):
        align.start({"gnss_position": arrays["gnss_position"]})


def test_velocities_tell_the_attitude_of_a_body_that_looks_elsewhere() -> None:
    truth = drive(120.0)
    arrays = truth.arrays(np.random.default_rng(1), velocity_sigma_m_per_s=0.02)
    t, gyro, accel = arrays["imu"]
    # The body looks 70° to the right of where it goes.
    c, s = np.cos(np.radians(70)), np.sin(np.radians(70))
    to_body = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    crab = {"imu": (t, gyro @ to_body.T, accel @ to_body.T), "gnss_velocity": arrays["gnss_velocity"]}
    config = {"imu": {"grade": "consumer"}}
    found = align.moving_base(crab, latitude_deg=50.0, height_m=HEIGHT, config=config)
    assert found is not None
    off = (found.heading_deg - truth.heading_deg[0] - 70 + 180) % 360 - 180
    assert abs(off) < 3 * found.sigma_heading_deg < 9
    assert found.attitude_covariance_n_rad2.shape == (3, 3)
    # Nothing is told by velocities of a body that stands.
    still = truth.time_s < 18
    velocity = arrays["gnss_velocity"]
    waits = velocity[0] < 18
    standing = {
        "imu": tuple(column[still] for column in crab["imu"]),
        "gnss_velocity": tuple(column[waits] for column in velocity),
    }
    assert align.moving_base(standing, latitude_deg=50.0, config=config) is None


def test_a_compass_tells_heading_with_its_declination() -> None:
    t = np.arange(0, 15, 0.01)
    roll, pitch, heading = np.radians([8.0, -15.0, 130.0])
    rz = np.array([[np.cos(heading), -np.sin(heading), 0], [np.sin(heading), np.cos(heading), 0], [0, 0, 1]])
    ry = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    rx = np.array([[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]])
    c_nb = rz @ ry @ rx
    declination = np.radians(6.0)
    field = c_nb.T @ [20e-6 * np.cos(declination), 20e-6 * np.sin(declination), 45e-6]
    ones = np.ones((len(t), 1))
    still, force = 0 * ones * field, ones * (c_nb.T @ [0, 0, -9.80665])
    found = align.magnetic(t, still, force, ones * field, declination_deg=6.0, sigma_deg=10.0)
    assert found is not None and found.heading_deg == pytest.approx(130, abs=1e-9)
    assert found.roll_deg == pytest.approx(8, abs=1e-9) and found.pitch_deg == pytest.approx(-15, abs=1e-9)
    assert 10 < found.sigma_heading_deg < 20
    magnetic = align.magnetic(t, still, force, (t, ones * field))
    assert magnetic is not None and magnetic.heading_deg == pytest.approx(124, abs=1e-9)
    # Not in tesla.
    assert align.magnetic(t, still, force, ones * field * 1e4) is None


@pytest.mark.parametrize(
    ("call", "argument", "words"),
    [
        (lambda r: align.Record(np.arange(5.0), np.zeros((4, 3)), np.zeros((5, 3))), "gyro", ["(4, 3)", "(5, 3)"]),
        (lambda r: align.Record([0, 1, np.nan], np.zeros((3, 3)), np.zeros((3, 3))), "t", ["t[2]"]),
        (lambda r: align.Record([0, 1], np.zeros((2, 3)), np.full((2, 3), np.inf)), "accel", ["accel[0]"]),
        (lambda r: align.joint(r, [1.0, 2.0], **WHERE), "stops", ["(2,)", "(k, 2)"]),
        (lambda r: align.align(r, STOPS, method="guess", **WHERE), "method", ["guess", "joint"]),
        (lambda r: align.joint(r, STOPS, **WHERE, taper="hann"), "taper", ["hann", "hann_squared"]),  # type: ignore[arg-type]
        (lambda r: align.joint(r, STOPS, **WHERE, heading_deg=3.0), "heading_sigma_deg", ["both"]),
        (lambda r: align.joint(r, STOPS, latitude_deg=60.0, config={}), "config", ["imu"]),
        (lambda r: align.align(r, STOPS, method="zupt2", **WHERE), "heading_deg", ["zupt2"]),
    ],
)
def test_names_the_argument_and_what_was_expected(call: Any, argument: str, words: list[str]) -> None:
    record = align.Record(*[a[:5000] for a in turntable()])
    with pytest.raises(insnav.ArgumentError) as caught:
        call(record)
    assert caught.value.argument == argument
    for word in words:
        assert word in str(caught.value)
