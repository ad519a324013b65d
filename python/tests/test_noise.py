"""`insnav.noise`, held against matrices and simulations in numpy."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import insnav
from insnav import noise

Array = NDArray[np.float64]

F = np.array([[0.9, 0.2], [0.0, 0.7]])
G = np.eye(2)
H = np.array([[1.0, 0.0], [0.3, 1.0]])
# Of no optimal filter, but stable.
L = np.array([[0.4, 0.1], [-0.1, 0.5]])
Q = np.array([[2.0, 0.5], [0.5, 1.0]])
R = np.array([[3.0, -0.4], [-0.4, 1.5]])
LAGS = 12


def covariances(q: Array, r: Array, lags: int = LAGS) -> Array:
    """Lag covariances of the innovations, the Lyapunov equation solved as one system of equations."""
    n = len(F)
    closed, fl = F - F @ L @ H, F @ L
    right = G @ q @ G.T + fl @ r @ fl.T
    p = np.linalg.solve(np.eye(n * n) - np.kron(closed, closed), right.ravel()).reshape(n, n)
    c = [H @ p @ H.T + r]
    for lag in range(1, lags):
        power = np.linalg.matrix_power(closed, lag - 1)
        c.append(H @ power @ (closed @ p @ H.T - fl @ r))
    return np.array(c)


def measured(q: Array, r: Array, samples: int, seed: int) -> Array:
    """Measurements of the model, begun in its stationary state or near it."""
    rng = np.random.default_rng(seed)
    w = rng.multivariate_normal(np.zeros(2), q, samples + 200)
    v = rng.multivariate_normal(np.zeros(2), r, samples + 200)
    x, y = np.zeros(2), np.empty((samples + 200, 2))
    for k in range(samples + 200):
        y[k] = H @ x + v[k]
        x = F @ x + G @ w[k]
    return y[200:]


def innovations(y: Array, gain: Array) -> Array:
    x, nu = np.zeros(2), np.empty_like(y)
    for k, value in enumerate(y):
        nu[k] = value - H @ x
        x = F @ (x + gain @ nu[k])
    return nu


def symmetric(q: Array, r: Array) -> Array:
    """In the order of the unknowns of the basis "symmetric"."""
    return np.array([q[0, 0], q[0, 1], q[1, 1], r[0, 0], r[0, 1], r[1, 1]])


def test_the_design_gives_the_covariances_of_the_model() -> None:
    design = noise.als_design(F, G, H, L, "symmetric", LAGS)
    assert design.names == ("Q[0,0]", "Q[0,1]", "Q[1,1]", "R[0,0]", "R[0,1]", "R[1,1]")
    assert design.lags == LAGS and design.matrix.shape == (LAGS * 4, 6)
    exact = covariances(Q, R)
    # Not the same for C and its transpose, so that rows and columns cannot be mistaken.
    assert np.abs(exact[1] - exact[1].T).max() > 1e-3
    np.testing.assert_allclose((design.matrix @ symmetric(Q, R)).reshape(-1, 2, 2), exact, rtol=0, atol=1e-12)


@pytest.mark.parametrize("weight", ["identity", "bartlett"])
@pytest.mark.parametrize("constraint", ["none", "psd"])
def test_exact_covariances_return_q_and_r(weight: Any, constraint: Any) -> None:
    design = noise.als_design(F, G, H, L, "symmetric", LAGS)
    found = noise.als_solve(design, covariances(Q, R), np.full(LAGS, 1e5), weight=weight, constraint=constraint)
    least = 1e-9
    np.testing.assert_allclose(found.Q, Q, rtol=0, atol=least * np.abs(Q).max())
    np.testing.assert_allclose(found.R, R, rtol=0, atol=least * np.abs(R).max())
    # C[0] is symmetric: one of its elements tells nothing new.
    assert found.fits and found.dof == LAGS * 4 - 1 - 6
    assert found.rank == 6 and found.verdicts == ("estimated",) * 6


def test_other_forms_of_unknowns() -> None:
    q, r = np.diag([2.0, 2.0]), np.diag([3.0, 1.5])
    c, counts = covariances(q, r), np.full(LAGS, 1e5)
    grouped = noise.als_solve(noise.als_design(F, G, H, L, {"Q": [[0, 1]], "R": "diagonal"}, LAGS), c, counts)
    assert grouped.names == ("Q[0=1]", "R[0,0]", "R[1,1]")
    np.testing.assert_allclose(grouped.theta, [2.0, 3.0, 1.5], rtol=1e-9)
    own = noise.als_solve(noise.als_design(F, G, H, L, {"Q": np.array([q]), "R": np.array([r])}, LAGS), c, counts)
    np.testing.assert_allclose(own.theta, [1.0, 1.0], rtol=1e-9)
    known = noise.als_solve(noise.als_design(F, G, H, L, None, LAGS), c, counts, known={"Q[0,0]": 2.0})
    np.testing.assert_allclose(known.theta, [2.0, 2.0, 3.0, 1.5], rtol=1e-9)
    assert known.verdicts[0] == "known" and known.se[0] == 0


def test_lag_covariances_are_the_means_of_products() -> None:
    nu = np.random.default_rng(3).normal(size=(40, 2))
    runs = [(0, 15), (20, 40)]
    c, counts = noise.lag_covariance(nu, 4, runs)
    for lag in range(4):
        products = [np.outer(nu[k + lag], nu[k]) for a, b in runs for k in range(a, b - lag)]
        np.testing.assert_allclose(c[lag], np.mean(products, axis=0), rtol=1e-13, atol=1e-15)
        assert counts[lag] == len(products)
    one, _ = noise.lag_covariance(nu[:, 0], 4)
    both, _ = noise.lag_covariance(nu, 4)
    # The sums of several channels are taken in another order.
    np.testing.assert_allclose(one[:, 0, 0], both[:, 0, 0], rtol=1e-13)


def test_estimates_are_as_near_as_they_say() -> None:
    q, r = np.diag([2.0, 1.0]), np.diag([3.0, 1.5])
    truth = np.array([2.0, 1.0, 3.0, 1.5])
    z = []
    for seed in range(20):
        found = noise.als_estimate(measured(q, r, 4000, seed), F, G, H, truth * [100, 0.01, 1, 10], lags=24)
        assert found.fits and found.gain is not None and found.rounds is not None and found.rounds.shape == (3, 4)
        z.append((found.theta - truth) / found.se)
    # Eighty values that are hardly correlated: none beyond four sigmas, at most three beyond three; the root of their mean square
    # scatters by 8 %.
    deviations = np.abs(z)
    assert deviations.max() < 4 and np.sum(deviations > 3) <= 3
    assert 0.75 < np.sqrt(np.mean(deviations**2)) < 1.25


def test_the_gain_is_that_of_the_riccati_equation() -> None:
    q, r = np.diag([2.0, 1.0]), np.diag([3.0, 1.5])
    found = noise.als_estimate(measured(q, r, 4000, 1), F, G, H, [1, 1, 1, 1], lags=24)
    p = np.eye(2)
    for _ in range(500):
        gain = p @ H.T @ np.linalg.inv(H @ p @ H.T + found.R)
        p = F @ (p - gain @ H @ p) @ F.T + found.Q
    assert found.gain is not None
    np.testing.assert_allclose(found.gain, gain, rtol=1e-9)


def test_innovations_serve_as_well_as_measurements() -> None:
    q, r = np.diag([2.0, 1.0]), np.diag([3.0, 1.5])
    y = measured(q, r, 4000, 5)
    direct = noise.als_estimate(y, F, G, H, [1, 1, 1, 1], lags=24)
    through = noise.als_estimate(innovations(y, L), F, G, H, [1, 1, 1, 1], lags=24, gain=L)
    np.testing.assert_allclose(through.theta, direct.theta, rtol=1e-9)


def test_coloured_noise_does_not_fit() -> None:
    y = measured(np.diag([2.0, 1.0]), np.diag([3.0, 1.5]), 4000, 6)
    rng = np.random.default_rng(7)
    colour = np.zeros_like(y)
    for k in range(1, len(y)):
        colour[k] = -0.8 * colour[k - 1] + rng.normal(0, 3, 2)
    assert not noise.als_estimate(y + colour, F, G, H, [1, 1, 1, 1], lags=24).fits


def test_changing_models_and_no_filter_at_all() -> None:
    q, r, truth = np.diag([2.0, 1.0]), np.diag([3.0, 1.5]), np.array([2.0, 1.0, 3.0, 1.5])
    y = measured(q, r, 4000, 8)
    nu = innovations(y, L)[100:]
    alone = noise.als_estimate_ltv(F, G, H, L, nu, 5 * np.eye(2), lags=12)
    stacked = noise.als_estimate_ltv(np.tile(F, (len(nu), 1, 1)), G, H, L, nu, 5 * np.eye(2), lags=12)
    assert np.array_equal(alone.theta, stacked.theta) and alone.gain is None
    without = noise.mdm_estimate(y, F, G, H, span=20)
    for found in (alone, without):
        assert np.all(np.abs(found.theta - truth) < 4 * found.se)
        assert np.all(found.se < truth)


def test_allan_deviation_of_the_definition_and_its_fit() -> None:
    step, n = 0.01, 1.0
    x = np.random.default_rng(9).normal(0, n / np.sqrt(step), 200_000)
    found = noise.overlapping_allan(x, step, [1, 10, 500])
    for m, value in zip([1, 10, 500], found.deviation, strict=True):
        means = np.convolve(x, np.full(m, 1 / m), mode="valid")
        differences = means[m:] - means[:-m]
        assert value == pytest.approx(np.sqrt(np.mean(differences**2) / 2), rel=1e-9)
        assert found.differences[found.samples == m] == len(differences)
    points = noise.overlapping_allan(x, step)
    np.testing.assert_allclose(points.tau_s, points.samples * step)
    fit = noise.fit_allan(points)
    assert abs(fit.white - n) < 3 * fit.white_se < 0.05
    assert fit.flicker < 3 * fit.flicker_se and fit.random_walk < 3 * fit.random_walk_se
    assert fit.fitted.shape == points.tau_s.shape and fit.interval.shape == (len(points.tau_s), 2)
    again = noise.fit_allan(pickle.loads(pickle.dumps(points)))
    assert again.white == fit.white


def test_estimates_can_be_pickled_and_printed() -> None:
    found = noise.als_solve(noise.als_design(F, G, H, L, None, LAGS), covariances(Q, R), np.full(LAGS, 1e4))
    again = pickle.loads(pickle.dumps(found))
    assert np.array_equal(again.theta, found.theta) and again.verdicts == found.verdicts
    assert "R[1,1]" in str(found) and "chi2/dof" in str(found)


@pytest.mark.parametrize(
    ("call", "code", "words"),
    [
        (lambda: noise.als_design(F[:1], G, H, L), "wrong_shape", ["F", "(1, 2)", "(1, 1)"]),
        (lambda: noise.als_design(F, G[0], H, L), "wrong_shape", ["G", "(2,)", "(2, m)"]),
        (lambda: noise.als_design(F, G, H[:, :1], L), "wrong_shape", ["H", "(2, 1)", "(n, 2)"]),
        (lambda: noise.als_design(F, G, H, L[:1]), "wrong_shape", ["L", "(1, 2)", "(2, 2)"]),
        (lambda: noise.als_design(F, G, H, L, "full"), "bad_option", ["basis", "full", "diagonal"]),  # type: ignore[arg-type]
        (lambda: noise.als_design(F, G, H, L, {"Q": Q}), "wrong_shape", ["basis", "Q", "(2, 2)", "(k, 2, 2)"]),
        (lambda: noise.als_design(F, G, H, L, {"S": Q}), "bad_option", ["basis", "S"]),  # type: ignore[dict-item]
        (lambda: noise.als_design(F, G, H, L, None, 0), "bad_option", ["lags", "0"]),
        (lambda: noise.als_design(1.1 * np.eye(2), G, H, np.zeros((2, 2))), "unstable_filter", ["spectral radius 1.1"]),
        (lambda: noise.als_design(F * np.nan, G, H, L), "not_finite", ["F"]),
        (lambda: noise.als_design("F", G, H, L), "not_numbers", ["F"]),
        (lambda: noise.lag_covariance(np.zeros((3, 2, 2)), 2), "wrong_shape", ["nu", "(3, 2, 2)"]),
        (lambda: noise.lag_covariance(np.zeros((9, 2)), 2, [0, 9]), "wrong_shape", ["runs", "(2,)", "(k, 2)"]),
        (lambda: noise.lag_covariance(np.zeros((9, 2)), 2, [(0, 10)]), "bad_option", ["runs[0]", "10", "9"]),
        (lambda: noise.lag_covariance(np.zeros((9, 2)), 20), "wrong_shape", ["9 samples", "20"]),
        (
            lambda: noise.als_solve(noise.als_design(F, G, H, L, None, 3), np.zeros((3, 2)), np.ones(3)),
            "wrong_shape",
            ["C", "(3, 2)", "(3, 2, 2)"],
        ),
        (
            lambda: noise.als_solve(noise.als_design(F, G, H, L, None, 3), np.zeros((3, 2, 2)), np.ones(2)),
            "wrong_shape",
            ["counts", "(2,)", "(3,)"],
        ),
        (
            lambda: noise.als_solve(noise.als_design(F, G, H, L, None, LAGS), covariances(Q, R), np.ones(LAGS), known={"q": 1}),
            "bad_option",
            ["known", "q", "Q[0,0]"],
        ),
        (
            lambda: noise.als_solve(noise.als_design(F, G, H, L, None, 1), covariances(Q, R, 1), np.full(1, 1e4)),
            "rank_deficient",
            ["Q[0,0]"],
        ),
        (lambda: noise.als_estimate(np.zeros((500, 3)), F, G, H, np.ones(4)), "wrong_shape", ["y", "(500, 3)", "(n, 2)"]),
        (lambda: noise.als_estimate(measured(Q, R, 500, 1), F, G, H, np.ones(3)), "wrong_shape", ["start", "(3,)", "(4,)"]),
        (lambda: noise.als_estimate(np.zeros((500, 2)), F, G, H, np.ones(4)), "flat_channel", ["channel 0"]),
        (lambda: noise.als_estimate(measured(Q, R, 150, 1), F, G, H, np.ones(4), lags=149), "too_short", ["lag"]),
        (lambda: noise.als_estimate_ltv(np.zeros((4, 2, 2)), G, H, L, np.zeros((9, 2)), Q), "wrong_shape", ["F", "(9, 2, 2)"]),
        (lambda: noise.mdm_estimate(np.zeros((500, 2)), F, G, H, span=400), "too_short", ["400"]),
        (lambda: noise.overlapping_allan(np.zeros((9, 2)), 0.1), "wrong_shape", ["x", "(9, 2)", "(n,)"]),
        (lambda: noise.overlapping_allan(np.arange(9.0), 0.0), "bad_option", ["step"]),
        (lambda: noise.overlapping_allan(np.arange(9.0), 0.01, [2**63]), "bad_option", ["half the record"]),
        (lambda: noise.als_estimate(measured(Q, R, 500, 1), F, G, H, np.ones(4), rounds=2**31), "bad_option", ["rounds", "2147483648", "10000"]),
        (lambda: noise.als_estimate(measured(Q, R, 500, 1), F, G, H, np.ones(4), reweights=10_001), "bad_option", ["reweights", "10001", "10000"]),
        (lambda: noise.mdm_estimate(np.zeros((500, 2)), F, G, H, reweights=2**40), "bad_option", ["reweights", "1099511627776"]),
        (lambda: noise.identify_noise(np.arange(5.0), np.zeros((4, 3)), np.zeros((5, 3))), "wrong_shape", ["gyro", "(4, 3)"]),
    ],
)
def test_names_the_argument_and_what_was_expected(call: Any, code: str, words: list[str]) -> None:
    with pytest.raises(ValueError) as caught:
        call()
    assert isinstance(caught.value, insnav.InsnavError)
    assert caught.value.code == code, str(caught.value)
    for word in words:
        assert word in str(caught.value)
