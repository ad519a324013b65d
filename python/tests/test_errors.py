"""What the user is told when something is wrong."""

from __future__ import annotations

import pickle
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
        ({"gnss_position": (T, XYZ, np.zeros(5))}, "wrong_shape", ["sigma_n_m", "(5,)", "(5, 3) or (3,)"]),
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
    with pytest.raises(insnav.InsnavError) as caught:
        insnav.run(arrays)
    assert caught.value.code == code
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
    with pytest.raises(insnav.InsnavError) as caught:
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


def test_the_exception_can_be_pickled() -> None:
    with pytest.raises(insnav.InsnavError) as caught:
        insnav.run({"imu": (T, XYZ, XYZ[:1])})
    again = pickle.loads(pickle.dumps(caught.value))
    assert (again.code, again.message, again.remedy, str(again)) == (
        caught.value.code,
        caught.value.message,
        caught.value.remedy,
        str(caught.value),
    )
