"""`insnav.stationary` against numpy, by sample and over arrays."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulation import drive

import insnav
from insnav import stationary

Array = NDArray[np.float64]

STEP_S, G = 0.01, 9.80665
ACCEL, GYRO = 0.008, np.radians(0.05)
# Densities as data sheets have them, per root hour.
UNIT = {
    "imu": {"grade": "consumer"},
    "noise": {
        "gyro_arw_deg_per_sqrt_hour": 0.05 * 60,
        "accel_vrw_m_per_s_per_sqrt_hour": ACCEL * 60,
        "gyro_bias_deg_per_hour": 0.0,
        "accel_bias_mg": 0.0,
    },
}


def rest(seconds: float, seed: int = 0) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    n = round(seconds / STEP_S)
    root = float(1 / np.sqrt(STEP_S))
    return (
        np.arange(n, dtype=np.float64) * STEP_S,
        rng.normal(0, GYRO * root, (n, 3)),
        rng.normal([0.0, 0.0, -G], ACCEL * root, (n, 3)),
    )


def shaken(seconds: float = 60.0) -> tuple[Array, Array, Array]:
    """At rest, but from a third to two thirds of it."""
    t, gyro, accel = rest(seconds, 5)
    moves = (t >= seconds / 3) & (t < seconds * 2 / 3)
    gyro = gyro + np.outer(moves * np.sin(9 * t), [0.1, 0.0, 0.05])
    accel = accel + np.outer(moves * np.cos(7 * t), [1.0, 0.5, 0.2])
    return t, gyro, accel


def windows(x: Array, n: int) -> Array:
    return np.lib.stride_tricks.sliding_window_view(x, n, axis=0).transpose(0, 2, 1)


@pytest.mark.parametrize("n", [1, 7, 100])
def test_statistics_are_those_of_the_definition(n: int) -> None:
    _, gyro, accel = shaken(6.0)
    expected = np.array([0.01, -0.02, 0.03])
    f, w = windows(accel, n), windows(gyro, n)
    va, vg = ACCEL**2 / STEP_S, GYRO**2 / STEP_S
    mean = f.mean(axis=1, keepdims=True)
    u = mean / np.linalg.norm(mean, axis=2, keepdims=True)
    rate = np.sum((w - expected) ** 2, axis=(1, 2)) / (n * vg)
    definition = {
        "mv": np.sum((f - mean) ** 2, axis=(1, 2)) / (n * va),
        "mag": np.sum((np.linalg.norm(f, axis=2) - G) ** 2, axis=1) / (n * va),
        "are": rate,
        "glrt": np.sum((f - G * u) ** 2, axis=(1, 2)) / (n * va) + rate,
    }
    options: dict[str, Any] = {"window_s": n * STEP_S, "config": UNIT}
    found = {
        "mv": stationary.mv(accel, STEP_S, **options),
        "mag": stationary.mag(accel, STEP_S, **options),
        "are": stationary.are(gyro, STEP_S, **options, expected_rate_b_rad_per_s=expected),
        "glrt": stationary.glrt(gyro, accel, STEP_S, **options, expected_rate_b_rad_per_s=expected),
    }
    for name, values in definition.items():
        statistic = found[name]
        assert statistic.detector == name and statistic.window == n
        assert statistic.value.shape == (len(gyro),) and np.all(np.isnan(statistic.value[: n - 1]))
        # The mean square less the square of the mean of forces of 10 m/s²: 1e-16 of 100 over a variance of 6e-3.
        np.testing.assert_allclose(statistic.value[n - 1 :], values, rtol=1e-10, atol=1e-10)


def test_thresholds_are_quantiles_at_rest() -> None:
    _, gyro, accel = rest(2000.0)
    n = 100
    # Windows that do not overlap.
    every = slice(n - 1, None, n)
    options: dict[str, Any] = {"window_s": n * STEP_S, "config": UNIT, "normal_quantile": 1.2816}
    for found in (
        stationary.mv(accel, STEP_S, **options),
        stationary.are(gyro, STEP_S, **options, sigma_rate_rad_per_s=0.0),
    ):
        share = np.mean(~found.standing[every])
        # One in ten of 2000: scatters by 0.7 %.
        assert abs(share - 0.1) < 0.021, found.detector
    # 3 (N - 1) degrees of freedom; the cube of Wilson and Hilferty.
    dof = 3 * (n - 1)
    expected = dof * (1 - 2 / (9 * dof) + 3.090 * np.sqrt(2 / (9 * dof))) ** 3 / n
    options["normal_quantile"] = 3.090
    assert stationary.mv(accel, STEP_S, **options).threshold == pytest.approx(expected, rel=1e-12)
    # [Abramowitz64] table 26.8: 30 degrees of freedom, 1e-3 and 1e-4.
    for z, tabulated in ((3.090, 59.703), (3.719, 67.633)):
        assert stationary.quantile_of_squares(30, 60, z) == pytest.approx(tabulated, rel=0.015)
    # A foot that rolls on is allowed more than the unit's noise.
    small: dict[str, Any] = {"window_s": 0.1, "config": UNIT}
    plain, foot = (stationary.glrt(gyro, accel, STEP_S, **small, stance=s) for s in (False, True))
    assert np.nanmax(foot.value) < 0.1 * np.nanmax(plain.value)
    assert np.isnan(stationary.mv(accel[:5], STEP_S, **small).threshold)


def test_stops_of_arrays_are_those_of_the_samples() -> None:
    t, gyro, accel = shaken()
    found = stationary.detect({"imu": (t, gyro, accel)}, UNIT)
    assert len(found) == 2 and found.witness == ("detector", "detector")
    assert found.lasts.tolist() == [False, True] and found.end_s[1] == t[-1]
    assert 19 <= found.end_s[0] <= 20 and 40 <= found.begin_s[1] < 42.5
    # The stance of each row follows from the intervals.
    inside = np.zeros(len(t), bool)
    for begin, end, lasts in zip(found.begin_s, found.end_s, found.lasts, strict=True):
        inside |= (found.time_s >= begin) & ((found.time_s < end) | (lasts & (found.time_s == end)))
    assert np.array_equal(found.standing, inside)
    np.testing.assert_allclose(found.time_s, t, rtol=0, atol=1e-9)
    assert not found.standing[(t >= 20) & (t < 40)].any()
    detector = stationary.StopDetector(UNIT)
    ratios = np.empty((len(t), 4))
    since = []
    for k, time in enumerate(t):
        detector.step(float(time), gyro[k], accel[k])
        ratios[k] = detector.ratios
        since.append(detector.standing_since_s)
    assert np.array_equal(ratios, found.sample_ratios, equal_nan=True)
    # What is said now is of half a second before, and a stop is believed a window (2 s) and half a second after its begin.
    said = np.array([s is not None for s in since])[50:]
    assert found.standing[:-50][said].all()
    assert np.sum(found.standing[:-50] & ~said) <= 2 * 260
    assert {s for s in since if s is not None} == set(found.begin_s)


def test_negative_controls() -> None:
    t, gyro, accel = rest(30.0)
    assert len(stationary.detect({"imu": (t, gyro, accel)}, UNIT)) == 1
    # A steady turn of 0.5 °/s shows in the mean rate alone, and a gyro bias that is known to be so is none.
    turn = gyro + np.radians([0.0, 0.0, 0.5])
    sure: dict[str, Any] = {"sigma_rate_rad_per_s": 1e-4}
    assert len(stationary.detect({"imu": (t, turn, accel)}, UNIT, **sure)) == 0
    known = stationary.detect({"imu": (t, turn, accel)}, UNIT, **sure, rate_b_rad_per_s=np.radians([0.0, 0.0, 0.5]))
    assert len(known) == 1
    # Moving variance does not see it, angular rate energy does.
    options: dict[str, Any] = {"window_s": 1.0, "config": UNIT}
    assert np.mean(stationary.mv(accel, STEP_S, **options).standing[100:]) > 0.9
    assert np.mean(stationary.are(gyro, STEP_S, **options, sigma_rate_rad_per_s=0.0).standing[100:]) > 0.9
    fast = gyro + np.radians([0.0, 0.0, 2.0])
    assert np.mean(stationary.are(fast, STEP_S, **options, sigma_rate_rad_per_s=0.0).standing[100:]) < 0.01
    # Wheels that turn forbid it.
    wheels = (t[::10], np.full(len(t[::10]), 1.0))
    assert len(stationary.detect({"imu": (t, gyro, accel), "speed": wheels}, UNIT)) == 0
    # A unit that is ten times better than its noise says is no unit of that class.
    better = {"imu": {"grade": "navigation"}}
    assert len(stationary.detect({"imu": (t, gyro, accel)}, {**better, "vehicle": {"kind": "any"}})) == 0


def test_what_is_declared_and_what_the_receiver_says() -> None:
    t, gyro, accel = rest(20.0)
    moving = accel + np.outer(np.cos(7 * t), [1.0, 0.5, 0.2])
    config = {**UNIT, "stationary": {"detector": "none", "intervals_s": [[3.0, 7.0]]}}
    found = stationary.detect({"imu": (t, gyro, moving)}, config)
    assert found.begin_s.tolist() == [3.0] and found.end_s.tolist() == [7.0] and found.witness == ("interval",)
    assert found.standing.sum() == 400
    said = {"imu": (t, gyro, moving), "standstill": ([5.0, 12.0], [1.0, 0.0])}
    found = stationary.detect(said, {**UNIT, "stationary": {"detector": "none"}})
    assert found.witness == ("declared",) and found.begin_s[0] == pytest.approx(5, abs=0.02)
    # What is taken back ends half a second before.
    assert found.end_s[0] == pytest.approx(11.5, abs=0.02)
    # A receiver that repeats itself says nothing.
    noise = np.random.default_rng(8).normal(0, 0.02, (len(t[::20]), 3))
    velocity = (t[::20], noise, np.full(3, 0.05))
    found = stationary.detect({"imu": (t, gyro, accel), "gnss_velocity": velocity}, UNIT)
    assert len(found) == 1 and found.ratios[0, 3] < 1
    drives = (t[::20], noise + [3.0, 0.0, 0.0], np.full(3, 0.05))
    assert len(stationary.detect({"imu": (t, gyro, accel), "gnss_velocity": drives}, UNIT)) == 0


def test_a_drive_begins_with_a_stop() -> None:
    truth = drive(60.0)
    arrays = truth.arrays(np.random.default_rng(2), gyro_white=1e-4, accel_white=1e-3)
    config = {"imu": {"grade": "industrial"}, "gnss": {"lever_arm_b_m": [0.0, 0.0, 0.0]}}
    found = stationary.detect(arrays, config)
    # It stands for twenty seconds and then speeds up smoothly.
    assert len(found) == 1 and found.begin_s[0] < 1 and 18.5 < found.end_s[0] < 21
    run = insnav.run(arrays, config)
    assert abs(run.stops.end_s[0] - found.end_s[0]) < 1.0


@pytest.mark.parametrize("down", [0.0, np.nan])
def test_velocities_by_sample_are_those_of_arrays(down: float) -> None:
    """A receiver without a Down component tells as well whether the body moves."""
    t, gyro, accel = rest(30.0, 5)
    noise = np.random.default_rng(8).normal(0, 0.02, (len(t[::20]), 3))
    for north, stands in [(0.0, True), (3.0, False)]:
        velocity = noise + [north, 0.0, down]
        arrays = {"imu": (t, gyro, accel), "gnss_velocity": (t[::20], velocity, np.full(3, 0.05))}
        detector = stationary.StopDetector(UNIT, gnss=True)
        for k, (w, f) in enumerate(zip(gyro, accel)):
            detector.step(float(t[k]), w, f)
            if k % 20 == 0:
                detector.gnss_velocity(float(t[k]), velocity[k // 20], [0.05, 0.05, 0.05])
        found = stationary.detect(arrays, UNIT)
        assert (detector.standing_since_s is not None) == stands == (len(found) == 1)


def test_a_detector_pickles_in_mid_stop() -> None:
    t, gyro, accel = shaken()
    detector = stationary.StopDetector(UNIT, gnss=True)

    def go(d: stationary.StopDetector, rows: range) -> list[Any]:
        out: list[Any] = []
        for k in rows:
            d.step(float(t[k]), gyro[k], accel[k])
            if k % 20 == 0:
                d.gnss_velocity(float(t[k]), [0.01, 0.0, 0.0], [0.05, 0.05, 0.05])
            if k == 1500:
                d.believe(rate_b_rad_per_s=[1e-4, 0, 0], velocity_covariance_n_m2_per_s2=np.eye(3) * 1e-4)
            out.append((d.standing_since_s, d.ratios.tobytes(), d.witness, d.rocks))
        return out

    go(detector, range(0, 1234))
    others = [pickle.loads(pickle.dumps(detector)), copy.deepcopy(detector), copy.copy(detector)]
    expected = go(detector, range(1234, 4500))
    assert any(e[0] is not None for e in expected)
    for other in others:
        assert go(other, range(1234, 4500)) == expected
        assert pickle.dumps(other) == pickle.dumps(detector)
    assert "StopDetector" in repr(detector)


@pytest.mark.parametrize(
    ("call", "argument", "words"),
    [
        (lambda: stationary.mv(np.zeros((5, 2)), 0.01, window_s=1.0), "accel", ["(5, 2)", "(n, 3)"]),
        (lambda: stationary.glrt(np.zeros((5, 3)), np.zeros((4, 3)), 0.01, window_s=1.0), "accel", ["(4, 3)", "(5, 3)"]),
        (lambda: stationary.are(np.full((5, 3), np.nan), 0.01, window_s=1.0), "gyro", ["gyro[0]"]),
        (lambda: stationary.mv(np.zeros((5, 3)), 0.0, window_s=1.0), "step_s", ["step_s"]),
        (lambda: stationary.mv(np.zeros((5, 3)), 0.01, window_s=np.nan), "window_s", ["window_s"]),
        (lambda: stationary.StopDetector().step(0.0, [0, 0], [0, 0, 1]), "gyro", ["(2,)", "(3,)"]),
        (lambda: stationary.StopDetector().step(np.nan, [0, 0, 0], [0, 0, 1]), "t", ["t"]),
        (lambda: stationary.StopDetector().believe(rate_covariance_b_rad2_per_s2=[1.0]), "rate_covariance_b_rad2_per_s2", ["(1,)"]),
        (lambda: stationary.StopDetector().gnss_velocity(0.0, [1, 0, 0], [0.1, -0.1, 0.1]), "sigma_n_m_per_s", ["-0.1", "not negative"]),
        (lambda: stationary.StopDetector().gnss_velocity(0.0, [1, 0, 0], -0.1), "sigma_n_m_per_s", ["-0.1"]),
        (lambda: stationary.StopDetector().gnss_velocity(0.0, [1, 0], [0.1] * 3), "velocity_n_m_per_s", ["(2,)", "(3,)"]),
        (lambda: stationary.detect({}, sigma_rate_rad_per_s=-1.0), "sigma_rate_rad_per_s", ["-1"]),
    ],
)
def test_names_the_argument_and_what_was_expected(call: Any, argument: str, words: list[str]) -> None:
    with pytest.raises(insnav.ArgumentError) as caught:
        call()
    assert caught.value.argument == argument
    for word in words:
        assert word in str(caught.value)
