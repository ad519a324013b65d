"""A start that is known, in place of one found in the data."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from simulation import HEIGHT, Drive, drive

import insnav

CONFIG: dict[str, Any] = {
    "imu": {"grade": "tactical"},
    "gnss": {"lever_arm_b_m": [0.0, 0.0, 0.0]},
    "output": {"rate_hz": 10.0},
}


@pytest.fixture(scope="module")
def truth() -> Drive:
    return drive(60.0)


def start(truth: Drive, **changes: Any) -> Any:
    known = {
        "latitude_deg_longitude_deg_height_m": [truth.latitude_deg[0], truth.longitude_deg[0], HEIGHT],
        "velocity_n_m_per_s": [0.0, 0.0, 0.0],
        "roll_deg_pitch_deg_heading_deg": [0.0, 0.0, truth.heading_deg[0]],
        "sigma_position_n_m": [0.5, 0.5, 1.0],
        "sigma_velocity_n_m_per_s": [0.02] * 3,
        "sigma_attitude_n_deg": [0.05, 0.05, 0.1],
    }
    return {key: value for key, value in {**known, **changes}.items() if value is not None}


def test_begins_with_what_is_known(truth: Drive) -> None:
    # Gyros that repeat one value at rest would be told of.
    arrays: Any = truth.arrays(np.random.default_rng(1), gyro_white=1e-6)
    # No fix in the first seconds, so that nothing but the start can tell.
    for kind in ("gnss_position", "gnss_velocity"):
        t, values, sigma = arrays[kind]
        arrays[kind] = (t[t > 5], values[t > 5], sigma[: np.sum(t > 5)] if sigma.ndim == 2 else sigma)
    s = insnav.run(arrays, CONFIG, start=start(truth), time_offset_s=0.0)
    assert s.time_s[0] == 0.0
    assert s.latitude_deg[0] == pytest.approx(truth.latitude_deg[0], abs=1e-12)
    assert s.heading_deg[0] == pytest.approx(truth.heading_deg[0], abs=1e-9)
    np.testing.assert_allclose(s.sigma_position_n_m[0], [0.5, 0.5, 1.0], rtol=1e-12)
    np.testing.assert_allclose(s.sigma_velocity_n_m_per_s[0], 0.02, rtol=1e-12)
    np.testing.assert_allclose(s.sigma_attitude_n_deg[0], [0.05, 0.05, 0.1], rtol=1e-12)
    np.testing.assert_allclose(s.sigma_gyro_bias_deg_per_hour[0], 3.0, rtol=1e-9)  # the grade's
    assert s.summary["alignment"] is None
    # Without noise in the inertial data, what is left before the first fix is the first sample's own.
    before = s.time_s < 5
    assert np.abs(s.velocity_n_m_per_s[before]).max() < 1e-4


def test_a_later_start_begins_later(truth: Drive) -> None:
    arrays = truth.arrays(np.random.default_rng(1), gyro_white=1e-6)
    s = insnav.run(arrays, CONFIG, start=start(truth, time_s=3.0), time_offset_s=0.0)
    assert s.time_s[0] == pytest.approx(3.0, abs=0.1) and s.time_s[0] >= 3.0


@pytest.mark.parametrize(
    ("changes", "code", "words"),
    [
        ({"velocity_n_m_per_s": None}, "bad_start", ["velocity_n_m_per_s", "missing"]),
        ({"velocity": [0, 0, 0]}, "bad_start", ["`velocity`", "velocity_n_m_per_s"]),
        ({"sigma_position_n_m": [1, 1, 0]}, "bad_start", ["sigma_position_n_m", "above 0"]),
        ({"sigma_position_n_m": [1, 1]}, "wrong_shape", ["sigma_position_n_m", "(2,)", "(3,)"]),
        ({"latitude_deg_longitude_deg_height_m": [95, 0, 0]}, "bad_start", ["latitude_deg_longitude_deg_height_m", "95"]),
        ({"roll_deg_pitch_deg_heading_deg": [0, 0, np.nan]}, "bad_start", ["roll_deg_pitch_deg_heading_deg", "finite"]),
        ({"time_s": 100.0}, "start_outside", ["100.000 s", "59.990"]),
        ({"time_s": -1.0}, "start_outside", ["-1.000 s", "0.000"]),
    ],
)
def test_says_what_is_wrong_with_a_start(truth: Drive, changes: Any, code: str, words: list[str]) -> None:
    with pytest.raises(insnav.InsnavError) as caught:
        insnav.run(truth.arrays(np.random.default_rng(1)), CONFIG, start=start(truth, **changes))
    assert caught.value.code == code
    for word in words:
        assert word in f"{caught.value} {caught.value.remedy}"
