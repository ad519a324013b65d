"""`insnav.AttitudeFilter`: by sample, over arrays, and what `insnav.ahrs` gives."""

from __future__ import annotations

import copy
import pickle
import warnings
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from test_ahrs import FIELD_N, body_to_north, rest

import insnav

Array = NDArray[np.float64]

CONSUMER = {"imu": {"grade": "consumer"}}
COLUMNS = ["quaternion_nb_wxyz", "attitude_covariance_n_rad2", "heading_deg", "roll_deg", "pitch_deg", "time_ns"]


def moving(seconds: float = 40.0) -> tuple[Array, Array, Array, Array]:
    """At rest, then turned to and fro and shaken; the field comes with every third sample."""
    t, gyro, accel, mag = rest(seconds, seed=3)
    since = np.maximum(t - seconds / 4, 0.0)
    rate_n = 0.9 * np.sin(2 * since)
    c = body_to_north(np.radians(10.0), np.radians(-20.0), np.radians(130.0) + 0.45 * (1 - np.cos(2 * since)))
    still = body_to_north(np.radians(10.0), np.radians(-20.0), np.radians(130.0))
    gyro = gyro + np.einsum("nji,nj->ni", c, np.outer(rate_n, [0, 0, 1]))
    accel = accel + np.outer((since > 0) * np.cos(5 * t), [0.5, 0.8, -0.3])
    mag = mag + np.einsum("nji,j->ni", c, FIELD_N) - still.T @ FIELD_N
    return t, gyro, accel, np.where((np.arange(len(t)) % 3 == 0)[:, None], mag, np.nan)


def step(filter: insnav.AttitudeFilter, t: Array, gyro: Array, accel: Array, mag: Array) -> list[insnav.AttitudeEpoch]:
    out = []
    for k in range(len(t)):
        epoch = filter.step(float(t[k]), gyro[k], accel[k], mag[k] if np.isfinite(mag[k]).all() else None)
        if epoch is not None:
            out.append(epoch)
    return out


def test_steps_are_the_batch_and_what_ahrs_gives_bit_for_bit() -> None:
    data = moving()
    batch = insnav.AttitudeFilter(CONSUMER).run(*data)
    steps = step(insnav.AttitudeFilter(CONSUMER), *data)
    assert len(steps) == len(batch) > 3900
    for name in (*COLUMNS, "gyro_bias_rad_per_s", "rests", "saturated", "magnetic", "time_s"):
        assert np.array_equal(getattr(batch, name), np.array([getattr(e, name) for e in steps])), name
    # In two parts.
    parts = insnav.AttitudeFilter(CONSUMER)
    halves = [parts.run(*(a[s] for a in data)) for s in (slice(0, 1777), slice(1777, None))]
    for name in COLUMNS:
        assert np.array_equal(np.concatenate([getattr(h, name) for h in halves]), getattr(batch, name)), name
    whole = insnav.ahrs(*data, noise="datasheet", config=CONSUMER, gyro_range_deg_per_s=None)
    smooth = insnav.ahrs(*data, noise="datasheet", config=CONSUMER, gyro_range_deg_per_s=None, smooth=True)
    smoothed = insnav.AttitudeFilter(CONSUMER).smooth(*data)
    for name in COLUMNS:
        assert np.array_equal(getattr(whole, name), getattr(batch, name)), name
        assert np.array_equal(getattr(smooth, name), getattr(smoothed, name)), name
    np.testing.assert_allclose(batch.sigma_attitude_n_deg, whole.sigma_attitude_n_deg, rtol=1e-14)
    # Negative control: another unit is another answer.
    other = insnav.AttitudeFilter({"imu": {"grade": "industrial"}}).run(*data)
    assert not np.array_equal(other.quaternion_nb_wxyz, batch.quaternion_nb_wxyz)
    carried = insnav.AttitudeFilter(CONSUMER, carrier_speed_m_per_s=8.0).run(*data)
    same = insnav.ahrs(*data, noise="datasheet", config=CONSUMER, gyro_range_deg_per_s=None, carrier_speed_m_per_s=8.0)
    assert np.array_equal(carried.quaternion_nb_wxyz, same.quaternion_nb_wxyz)


def test_a_pickled_filter_goes_on_bit_for_bit() -> None:
    data = moving()
    for cut in (5, 500, 1777, 3001):
        filter = insnav.AttitudeFilter(CONSUMER, gyro_range_deg_per_s=250.0)
        filter.run(*(a[:cut] for a in data))
        others = [pickle.loads(pickle.dumps(filter)), copy.deepcopy(filter), copy.copy(filter)]
        rest_of_it = filter.run(*(a[cut:] for a in data))
        for other in others:
            again = other.run(*(a[cut:] for a in data))
            for name in COLUMNS:
                assert getattr(again, name).tobytes() == getattr(rest_of_it, name).tobytes(), name
            assert other.covariance.tobytes() == filter.covariance.tobytes()
            assert pickle.dumps(other) == pickle.dumps(filter)
    back = pickle.loads(pickle.dumps(rest_of_it))
    assert np.array_equal(back.quaternion_nb_wxyz, rest_of_it.quaternion_nb_wxyz) and len(back) == len(rest_of_it)


def test_state_and_covariance_by_block() -> None:
    t, gyro, accel, mag = rest(60.0, bias_rad_per_s=np.radians(0.1))
    filter = insnav.AttitudeFilter(CONSUMER)
    found = filter.run(t, gyro, accel, mag)
    blocks, covariance, state = filter.blocks, filter.covariance, filter.state
    assert covariance.shape == (21, 21) and blocks.keys() == state.keys()
    assert sorted(i for s in blocks.values() for i in range(21)[s]) == list(range(21))
    np.testing.assert_allclose(covariance, covariance.T, rtol=0, atol=1e-12 * np.abs(covariance).max())
    assert np.linalg.eigvalsh(covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))).min() > 0
    assert np.array_equal(state["attitude"], found.quaternion_nb_wxyz[-1])
    np.testing.assert_allclose(state["gyro_bias"], np.radians(0.1), atol=np.radians(0.01))
    assert np.array_equal(covariance[blocks["attitude"], blocks["attitude"]], found.attitude_covariance_n_rad2[-1])
    # Horizontal and downward field, within what is allowed for iron and surroundings.
    np.testing.assert_allclose(state["field"], [20e-6, 44e-6], atol=1.5e-6)
    assert state["delay"].shape == (1,) and filter.field_changes == 0
    assert found.rests[-1] and found.magnetic[-1] and not found.saturated.any()


def test_settings_are_those_of_the_core_and_can_be_replaced() -> None:
    plain = insnav.AttitudeFilter(CONSUMER)
    assert plain.settings["update_interval"] == 0.05 and plain.settings["field"]["delay_sigma"] == 0.01
    changed = insnav.AttitudeFilter(CONSUMER, settings={"update_interval": 0.02, "field": {"delay_sigma": 0.001}})
    assert changed.settings["field"]["delay_sigma"] == 0.001 and changed.settings["update_interval"] == 0.02
    assert changed.settings["field"]["sigma"] == plain.settings["field"]["sigma"]
    assert insnav.AttitudeFilter(gyro_range_deg_per_s=180.0).settings["gyro_range"] == pytest.approx(np.pi)
    data = moving(10.0)
    assert len(changed.run(*data)) == len(plain.run(*data))
    with pytest.raises(insnav.ArgumentError, match="delay_sgima"):
        insnav.AttitudeFilter(settings={"field": {"delay_sgima": 1.0}})
    with pytest.raises(insnav.ConfigError, match="update_interval"):
        insnav.AttitudeFilter(settings={"update_interval": -1.0})
    with pytest.raises(insnav.ConfigError, match="declination"):
        insnav.AttitudeFilter({"alignment": {"declination_deg": 3.0}})
    with pytest.raises(TypeError, match="settings"):
        insnav.AttitudeFilter(settings=[1])  # type: ignore[arg-type]


def test_a_mounting_is_the_same_by_step_and_by_batch() -> None:
    t, gyro, accel, mag = rest(10)
    turned = [np.column_stack([a[:, 1], -a[:, 0], a[:, 2]]) for a in (gyro, accel, mag)]
    config = {**CONSUMER, "imu": {"grade": "consumer", "mounting_rpy_deg": [0.0, 0.0, 90.0]}}
    mounted = insnav.AttitudeFilter(config).run(t, *turned)
    straight = insnav.AttitudeFilter(CONSUMER).run(t, gyro, accel, mag)
    np.testing.assert_allclose(mounted.heading_deg, straight.heading_deg, atol=1e-6)
    stepped = step(insnav.AttitudeFilter(config), t, turned[0], turned[1], turned[2])
    assert np.array_equal([e.heading_deg for e in stepped], mounted.heading_deg)


def test_a_wrong_sign_is_seen() -> None:
    """Gyros with the wrong sign turn the other way; a body on its head is on its head."""
    t = np.arange(0, 20, 0.01)
    rate = np.where((t > 5) & (t < 8), np.radians(30.0), 0.0)
    up = np.tile([0.0, 0.0, -9.80665], (len(t), 1))
    headings = [insnav.AttitudeFilter(CONSUMER).run(t, np.outer(s * rate, [0, 0, 1]), up).heading_deg[-1] for s in (1, -1)]
    assert headings[0] == pytest.approx(90, abs=1) and headings[1] == pytest.approx(270, abs=1)
    down = insnav.AttitudeFilter(CONSUMER).run(t, np.zeros((len(t), 3)), -up)
    assert abs(abs(down.roll_deg[-1]) - 180) < 1
    q = down.quaternion_nb_wxyz[-1]
    roll, pitch, heading = np.radians([down.roll_deg[-1], down.pitch_deg[-1], down.heading_deg[-1]])
    z = body_to_north(roll, pitch, heading)[2, 2]
    assert z == pytest.approx(1 - 2 * (q[1] ** 2 + q[2] ** 2), abs=1e-12) and z < -0.99


def test_fields_with_stamps_of_their_own() -> None:
    t, gyro, accel, mag = rest(20)
    every = slice(None, None, 4)
    late = t[every] + 0.003
    batch = insnav.AttitudeFilter(CONSUMER).run(t, gyro, accel, (late, mag[every]))
    filter, at, out = insnav.AttitudeFilter(CONSUMER), 0, []
    for k in range(len(t)):
        while at < len(late) and late[at] <= t[k]:
            filter.field(float(late[at]), mag[every][at])
            at += 1
        out.append(filter.step(float(t[k]), gyro[k], accel[k]))
    assert np.array_equal(batch.heading_deg, [e.heading_deg for e in out if e is not None])


def test_refuses_and_stays_as_it_was() -> None:
    t, gyro, accel, mag = rest(5)
    filter = insnav.AttitudeFilter(CONSUMER)
    filter.run(t, gyro, accel, mag)
    before = pickle.dumps(filter)
    calls: list[tuple[Any, type[insnav.InsnavError], str]] = [
        (lambda: filter.step(4.0, gyro[0], accel[0], mag[0]), insnav.NavigationError, "is not after"),
        (lambda: filter.run(t, gyro, accel, mag), insnav.NavigationError, "is not after"),
        (lambda: filter.run(t + 5, gyro[:4], accel), insnav.ArgumentError, r"gyro: shape \(4, 3\), expected \(500, 3\)"),
        (lambda: filter.step(6.0, [1, 2], accel[0]), insnav.ArgumentError, r"gyro: shape \(2,\), expected \(3,\)"),
        (lambda: filter.step(6.0, [np.nan, 0, 0], accel[0], mag[0]), insnav.ArgumentError, "gyro"),
        (lambda: filter.step(np.inf, gyro[0], accel[0]), insnav.ArgumentError, "t"),
        (lambda: filter.field(6.0, [0, np.nan, 0]), insnav.ArgumentError, "mag"),
    ]
    for call, error, match in calls:
        with pytest.raises(error, match=match):
            call()
        assert pickle.dumps(filter) == before
    with pytest.raises(insnav.NavigationError) as caught:
        filter.step(4.0, gyro[0], accel[0])
    assert caught.value.time_ns == 4_000_000_000


def test_the_first_attitude_comes_when_the_documentation_says() -> None:
    """At rest after 0.3 s with a field and 1 s without; in motion later, after 2 s at the latest. `ahrs` has the same start."""
    t = np.arange(300) * 0.01
    rng = np.random.default_rng(0)
    gyro, accel = rng.normal(0, 1e-3, (300, 3)), rng.normal(0, 1e-2, (300, 3)) + [0, 0, -9.81]
    field = np.tile([2e-5, 0, 4e-5], (300, 1))
    shaken = accel + np.outer(np.sin(9 * t), [3.0, 2.0, 1.0])
    config = {"imu": {"grade": "consumer"}}

    def first(*arrays: NDArray[np.float64]) -> float:
        alone = insnav.AttitudeFilter(config).run(t, *arrays).time_s[0]
        with warnings.catch_warnings():
            # Three seconds do not tell the noise.
            warnings.simplefilter("ignore", insnav.InsnavWarning)
            assert insnav.ahrs(t, *arrays, config=config).time_s[0] == alone
        return float(alone)

    assert first(gyro, accel) == pytest.approx(1.0, abs=0.011)
    assert first(gyro, accel, field) == pytest.approx(0.3, abs=0.011)
    assert 1.0 < first(gyro, shaken, field) <= 2.01
    for documented in (insnav.AttitudeFilter.__doc__, insnav.ahrs.__doc__):
        assert documented and "0.3 s" in documented and "1 s" in documented and "up to 2 s" in documented
