"""What `insnav.noise` takes one innovation at a time, the design of a channel, stability at rest: against numpy."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from test_noise import LAGS, F, G, H, L, Q, R, covariances, innovations, measured

import insnav
from insnav import noise

Array = NDArray[np.float64]


def products(nu: Array, lag: int) -> Array:
    """Sum of nu[k + lag] nu[k]ᵀ, written out."""
    return np.asarray(sum(np.outer(nu[k + lag], nu[k]) for k in range(len(nu) - lag)))


def test_lag_sums_are_those_of_the_definition() -> None:
    rng = np.random.default_rng(0)
    for p in (1, 2, 5):
        nu = rng.normal(size=(80, p))
        sums = noise.LagAccumulator(p, 7)
        sums.run(nu)
        for lag in range(7):
            np.testing.assert_allclose(sums.covariance[lag], products(nu, lag) / (80 - lag), rtol=1e-12, atol=1e-14)
        assert sums.counts.tolist() == [80 - lag for lag in range(7)]
        batch, counts = noise.lag_covariance(nu, 7)
        np.testing.assert_allclose(sums.covariance, batch, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(sums.counts, counts)
        steps = noise.LagAccumulator(p, 7)
        for row in nu:
            steps.step(row)
        assert steps.covariance.tobytes() == sums.covariance.tobytes()


def test_no_product_spans_a_hole_and_sums_add_up() -> None:
    rng = np.random.default_rng(1)
    nu = rng.normal(size=(60, 2))
    holes = nu.copy()
    holes[25] = np.nan
    joined, first, second = (noise.LagAccumulator(2, 5) for _ in range(3))
    joined.run(holes)
    first.run(nu[:25])
    second.run(nu[26:])
    first.merge(second)
    np.testing.assert_allclose(joined.covariance, first.covariance, rtol=1e-12, atol=1e-14)
    assert joined.counts.tolist() == first.counts.tolist() == [59 - 2 * lag for lag in range(5)]
    ended = noise.LagAccumulator(2, 5)
    ended.run(nu[:25])
    ended.end_run()
    ended.run(nu[26:])
    assert ended.covariance.tobytes() == joined.covariance.tobytes()
    # Negative control: without the end of the run some products do.
    spans = noise.LagAccumulator(2, 5)
    spans.run(np.delete(nu, 25, axis=0))
    assert not np.allclose(spans.covariance[1], joined.covariance[1])
    forgets = noise.LagAccumulator(1, 3, retention=0.9)
    forgets.run(np.where(np.arange(500) < 400, 100.0, 1.0))
    # 0.9^100 of 10⁴ is left; it is as good as (1 + t) / (1 - t) products.
    assert forgets.covariance[0, 0, 0] == pytest.approx(1 + 0.9**100 * (1e4 - 1), abs=1e-9)
    assert forgets.counts[0] == pytest.approx(19, abs=1e-9)


def test_sums_identify_noise_as_a_record_does() -> None:
    q, r = np.diag([2.0, 1.0]), np.diag([3.0, 1.5])
    nu = innovations(measured(q, r, 20_000, 11), L)[100:]
    sums = noise.LagAccumulator(2, 24)
    sums.run(nu)
    design = noise.als_design(F, G, H, L, None, 24)
    found = noise.als_solve(design, sums.covariance, sums.counts)
    assert np.all(np.abs(found.theta - [2, 1, 3, 1.5]) < 4 * found.se) and found.fits


def test_mohamed_and_schwarz_by_their_formulas() -> None:
    rng = np.random.default_rng(2)
    nu = rng.normal(size=(30, 2))
    P = np.array([[2.0, 0.1], [0.1, 1.0]])
    method = noise.MohamedSchwarz(2, 8)
    assert method.covariance is None and method.process_noise(L) is None
    means = method.run(nu[:7])
    assert means.shape == (7, 2, 2) and np.isnan(means).all() and method.covariance is None
    for row in nu[7:]:
        method.step(row)
    c = np.mean([np.outer(v, v) for v in nu[-8:]], axis=0)
    np.testing.assert_allclose(np.asarray(method.covariance), c, rtol=1e-13)
    np.testing.assert_allclose(np.asarray(method.process_noise(L)), L @ c @ L.T, rtol=1e-12)
    np.testing.assert_allclose(np.asarray(method.measurement_noise(H, P)), c - H @ P @ H.T, rtol=1e-12)
    np.testing.assert_allclose(np.asarray(method.measurement_noise_of_residuals(H, P)), c + H @ P @ H.T, rtol=1e-12)
    again = noise.MohamedSchwarz(2, 8)
    every = again.run(nu)
    np.testing.assert_array_equal(every[-1], np.asarray(method.covariance))
    np.testing.assert_allclose(every[15], np.mean([np.outer(v, v) for v in nu[8:16]], axis=0), rtol=1e-13)
    # Of one channel Q has rank one, whatever the window: why it is no method to use.
    one = noise.MohamedSchwarz(1, 20)
    one.run(rng.normal(size=50))
    q = one.process_noise([[0.5], [0.1]])
    assert q is not None and abs(np.linalg.det(q)) < 1e-15


def test_the_forgetting_recursion() -> None:
    rng = np.random.default_rng(3)
    nu = rng.normal(size=(12, 2))
    method = noise.ForgettingProcessNoise(np.diag([10.0, 5.0]))
    assert method.retention == 0.3
    q = np.diag([10.0, 5.0])
    for row in nu:
        method.step(L, row)
        correction = L @ row
        q = 0.3 * q + 0.7 * np.outer(correction, correction)
        np.testing.assert_allclose(method.Q, q, rtol=1e-12, atol=1e-14)
    batch = noise.ForgettingProcessNoise(np.diag([10.0, 5.0]))
    every = batch.run(L, nu)
    stacked = noise.ForgettingProcessNoise(np.diag([10.0, 5.0])).run(np.tile(L, (12, 1, 1)), nu)
    assert every.shape == (12, 2, 2) and every[-1].tobytes() == method.Q.tobytes() and np.array_equal(every, stacked)


def test_the_design_of_a_channel_is_that_of_the_model() -> None:
    f, h, gain = np.array([[1.0, -0.032], [0.0, 0.99]]), np.array([1.0, 0.0]), np.array([0.3, -0.05])
    channel = noise.ChannelDesign(f, h, gain, lags=20)
    design = noise.als_design(f, np.eye(2), h[None, :], gain[:, None], None, 20)
    np.testing.assert_allclose(channel.matrix, design.matrix, rtol=1e-9, atol=1e-12)
    theta = np.array([2e-3, 3e-4, 0.5])
    c = channel.covariances(theta)
    np.testing.assert_allclose(c, channel.matrix @ theta, rtol=1e-14)
    np.testing.assert_allclose(channel.solve(c), theta, rtol=1e-9)
    np.testing.assert_allclose(channel.solve(c, (None, 3e-4, None)), theta, rtol=1e-9)
    # A variance is not negative.
    assert channel.solve(channel.covariances([-2e-3, 3e-4, 0.5]))[0] == 0
    with pytest.raises(insnav.IdentificationError, match="not stable"):
        noise.ChannelDesign(f, h, [0.0, 0.0])


def test_designs_and_sums_pickle_to_the_last_bit() -> None:
    rng = np.random.default_rng(4)
    nu = rng.normal(size=(50, 2))
    sums, window, forgets = noise.LagAccumulator(2, 6, retention=0.98), noise.MohamedSchwarz(2, 9), noise.ForgettingProcessNoise(Q)
    sums.run(nu)
    window.run(nu)
    forgets.run(L, nu)
    forgets.step(L, [np.inf, 1.0])
    design = noise.als_design(F, G, H, L, "symmetric", LAGS)
    channel = noise.ChannelDesign([[1.0, -0.032], [0.0, 0.99]], [1.0, 0.0], [0.3, -0.05], lags=9)
    ways: list[Callable[[Any], Any]] = [lambda x: pickle.loads(pickle.dumps(x)), copy.deepcopy, copy.copy]
    for copied in ways:
        other = copied(sums)
        other.run(nu[:3])
        same = copied(sums)
        for row in nu[:3]:
            same.step(row)
        assert other.covariance.tobytes() == same.covariance.tobytes() != sums.covariance.tobytes()
        assert copied(window).covariance.tobytes() == np.asarray(window.covariance).tobytes()
        # Infinities and NaN are kept.
        assert copied(forgets).Q.tobytes() == forgets.Q.tobytes() and not np.isfinite(forgets.Q).all()
        assert copied(channel).matrix.tobytes() == channel.matrix.tobytes()
        again = copied(design)
        assert again.matrix.tobytes() == design.matrix.tobytes() and again.names == design.names
        c, counts = covariances(Q, R), np.full(LAGS, 1e4)
        assert noise.als_solve(again, c, counts).theta.tobytes() == noise.als_solve(design, c, counts).theta.tobytes()


def test_stability_of_a_unit_at_rest() -> None:
    rng = np.random.default_rng(5)
    rate_hz, n = 50.0, 20_000
    white = np.array([1e-4, 2e-4, 3e-4])
    t = np.arange(n) / rate_hz
    gyro = rng.normal(0, white * np.sqrt(rate_hz), (n, 3))
    accel = rng.normal([0, 0, -9.81], 2e-3 * np.sqrt(rate_hz), (n, 3))
    found = noise.rest_stability(t, gyro, accel)
    assert found.begin_s == 0 and found.step_s == pytest.approx(0.02) and found.end_s == pytest.approx(t[-1])
    for axis, ((deviation, fit), truth) in enumerate(zip(found.gyro, white, strict=True)):
        assert abs(fit.white - truth) < 4 * fit.white_se < 0.1 * truth
        direct = noise.overlapping_allan(gyro[:, axis], found.step_s, deviation.samples.tolist())
        np.testing.assert_allclose(direct.deviation, deviation.deviation, rtol=1e-9)
    assert len(found.accel) == 3 and found.accel[0][1].white == pytest.approx(2e-3, rel=0.1)
    assert pickle.loads(pickle.dumps(found)).gyro[2][1].white == found.gyro[2][1].white
    with pytest.raises(insnav.InsnavError) as caught:
        noise.rest_stability(t[:100], gyro[:100], accel[:100])
    assert "10 s" in str(caught.value)


def test_the_benchmark_agrees_with_the_papers_construction() -> None:
    script = Path(__file__).parents[1] / "benchmarks" / "als.py"
    done = subprocess.run([sys.executable, str(script), "--repeats", "1", "--small"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("agree to") == 3


@pytest.mark.parametrize(
    ("call", "argument", "words"),
    [
        (lambda: noise.LagAccumulator(2, 3).step([1.0]), "nu", ["(1,)", "(2,)"]),
        (lambda: noise.LagAccumulator(2, 3).run(np.zeros((4, 3))), "nu", ["(4, 3)", "(n, 2)"]),
        (lambda: noise.LagAccumulator(2, 0), None, ["lags"]),
        (lambda: noise.LagAccumulator(0, 3), None, ["channels"]),
        (lambda: noise.LagAccumulator(1, 3, retention=2.0), None, ["retention"]),
        (lambda: noise.LagAccumulator(10**6, 10), "channels", ["1000000"]),
        (lambda: noise.LagAccumulator(1, 3).merge(noise.LagAccumulator(1, 4)), None, ["3 lags", "4 lags"]),
        (lambda: noise.MohamedSchwarz(2, 0), None, ["window"]),
        (lambda: noise.MohamedSchwarz(1, 10**12), "window", ["1000000000000"]),
        (lambda: noise.MohamedSchwarz(10**5, 2), "window", ["100000 channels"]),
        (lambda: noise.MohamedSchwarz(2, 3).process_noise(np.zeros((2, 3))), "L", ["(2, 3)", "(n, 2)"]),
        (lambda: noise.MohamedSchwarz(2, 3).measurement_noise(H, np.zeros((3, 3))), "P", ["(3, 3)", "(2, 2)"]),
        (lambda: noise.ForgettingProcessNoise(np.zeros((2, 3))), "Q", ["(2, 3)", "(2, 2)"]),
        (lambda: noise.ForgettingProcessNoise(Q, retention=-0.1), "retention", ["-0.1"]),
        (lambda: noise.ForgettingProcessNoise(Q).step(np.zeros((3, 2)), [1, 2]), "L", ["(3, 2)", "(2, 2)"]),
        (lambda: noise.ChannelDesign(np.eye(3), [1, 0], [0, 0]), "F", ["(3, 3)", "(2, 2)"]),
        (lambda: noise.ChannelDesign(np.eye(2), [1, 0], [0.1, 0], lags=2), "lags", ["2", "three"]),
        (lambda: noise.rest_stability([0, 1], np.zeros((2, 3)), np.zeros((3, 3))), "accel", ["(3, 3)", "(2, 3)"]),
    ],
)
def test_names_the_argument_and_what_was_expected(call: Any, argument: str | None, words: list[str]) -> None:
    with pytest.raises(insnav.ArgumentError) as caught:
        call()
    if argument is not None:
        assert caught.value.argument == argument
    for word in words:
        assert word in str(caught.value)
