"""Writes noise_values.json: what other programs say about the quantities that tests/als and tests/allan.rs check.

    python3 -m venv venv && venv/bin/pip install -r noise_requirements.txt && venv/bin/python make_noise_values.py

Autocovariance least squares is written out with Kronecker products, a dense solve of the Lyapunov equation, scipy's
non-negative least squares and Bartlett's double sums: nothing of the way that the Rust code takes. Allan deviations are those of
allantools. Data come from a generator of integers that the tests repeat; the versions used are written into the file.
"""

import json
import pathlib
import sys

import allantools
import numpy as np
import scipy
from scipy.linalg import solve_discrete_are
from scipy.optimize import nnls


class Noise:
    """Sum of twelve uniform numbers less six, from a linear congruential generator of 64 bits."""

    def __init__(self, seed):
        self.state = seed

    def __call__(self):
        total = 0.0
        for _ in range(12):
            self.state = (6364136223846793005 * self.state + 1442695040888963407) % 2**64
            total += (self.state >> 11) / 2.0**53
        return total - 6.0


def simulate(f, g, h, q, r, count, seed):
    noise = Noise(seed)
    x = np.zeros(len(f))
    y = []
    for k in range(count + 200):
        if k >= 200:
            y.append(h @ x + np.sqrt(r) * np.array([noise() for _ in r]))
        x = f @ x + g @ (np.sqrt(q) * np.array([noise() for _ in q]))
    return np.array(y)


def innovations(f, h, gain, y):
    x = np.zeros(len(f))
    out = []
    for value in y:
        nu = value - h @ x
        out.append(nu)
        x = f @ (x + gain @ nu)
    return np.array(out)


def design(f, g, h, gain, lags):
    n, p = len(f), len(h)
    fl = f @ gain
    closed = f - fl @ h
    inverse = np.linalg.inv(np.eye(n * n) - np.kron(closed, closed))
    of_q, of_r = inverse @ np.kron(g, g), inverse @ np.kron(fl, fl)
    pick_q = np.eye(g.shape[1] ** 2)[:, :: g.shape[1] + 1]
    pick_r = np.eye(p * p)[:, :: p + 1]
    blocks, power, before = [], np.eye(n), None
    for lag in range(lags):
        observe = np.kron(h, h @ power)
        direct = np.eye(p * p) if lag == 0 else -np.kron(np.eye(p), h @ before @ fl)
        blocks.append(np.hstack([observe @ of_q @ pick_q, (observe @ of_r + direct) @ pick_r]))
        before, power = power, power @ closed
    return np.vstack(blocks)


def weight(a_long, theta, lags, p, count):
    """Covariance of the distinct lag covariances, by Bartlett's sums with nothing rearranged."""
    flat = a_long @ theta
    far = len(flat) // (p * p)
    c = flat.reshape(far, p, p).transpose(0, 2, 1)  # columns first

    def series(a, b):
        return np.concatenate([c[:0:-1, b, a], c[:, a, b]])

    rows = [(j, a, b) for j in range(lags) for b in range(p) for a in range(p) if j > 0 or a >= b]
    w = np.zeros((len(rows), len(rows)))
    for i, (j, a, b) in enumerate(rows):
        for m, (k, cc, d) in enumerate(rows):
            def product(x, y, shift):
                # sum over t of x(t + shift) y(t)
                if shift < 0:
                    x, y, shift = y, x, -shift
                return float(np.dot(x[shift:], y[: len(y) - shift]))
            w[i, m] = product(series(a, cc), series(b, d), j - k) + product(series(a, d), series(b, cc), j + k)
            w[i, m] /= max(count - j, count - k)
    return [(j * p + b) * p + a for j, a, b in rows], w


def als(name, f, g, h, q, r, guess, lags, count, seed):
    f, g, h, q, r = (np.array(v, dtype=float) for v in (f, g, h, q, r))
    p = len(h)
    qg, rg = np.eye(g.shape[1]) * guess[0], np.eye(p) * guess[1]
    predicted = solve_discrete_are(f.T, h.T, g @ qg @ g.T, rg)
    gain = predicted @ h.T @ np.linalg.inv(h @ predicted @ h.T + rg)
    nu = innovations(f, h, gain, simulate(f, g, h, q, r, count, seed))
    c = [nu[j:].T @ nu[: len(nu) - j] / (len(nu) - j) for j in range(lags)]
    b = np.concatenate([m.flatten(order="F") for m in c])
    a = design(f, g, h, gain, lags)
    theta, _ = nnls(a, b)
    row = {"name": name, "f": f.flatten().tolist(), "g": g.flatten().tolist(), "h": h.flatten().tolist(), "q": q.tolist(),
           "r": r.tolist(), "guess": guess, "lags": lags, "count": count, "seed": seed, "gain": gain.flatten().tolist(),
           "identity": theta.tolist()}
    a_long = design(f, g, h, gain, 120)
    for _ in range(2):
        index, w = weight(a_long, theta, lags, p, count)
        lower = np.linalg.cholesky(w)
        wa, wb = np.linalg.solve(lower, a[index]), np.linalg.solve(lower, b[index])
        theta, _ = nnls(wa, wb)
    row["bartlett"] = theta.tolist()
    row["standard_errors"] = np.sqrt(np.diag(np.linalg.inv(wa.T @ wa))).tolist()
    row["chi2"] = float(np.sum((wa @ theta - wb) ** 2))
    return row


def allan(seed, count, rate, walk):
    noise = Noise(seed)
    level, record = 0.0, []
    for _ in range(count):
        level += walk * noise()
        record.append(level + noise())
    averaged = [1, 2, 3, 5, 10, 30, 100, 300, 1000]
    taus, deviations, _, _ = allantools.oadev(np.array(record), rate=rate, data_type="freq", taus=np.array(averaged) / rate)
    return {"seed": seed, "count": count, "rate": rate, "walk": walk, "averaged": [round(t * rate) for t in taus],
            "deviation": deviations.tolist()}


A = ([[0.1, 0, 0.1], [0, 0.2, 0], [0, 0, 0.3]], [[1], [2], [3]], [[0.1, 0.2, 0]], [0.5], [0.1])
B = ([[0.1, 0.1, 0.1], [0, 0.2, 0], [0, 0, 0.3]], np.eye(3), np.eye(3), [0.5, 0.2, 0.1], [0.5, 0.2, 0.8])
C = ([[0.9, 0.3], [-0.2, 0.8]], [[0.3], [1.0]], [[1, 0.4], [-0.1, 2]], [0.4], [1.0, 0.3])

values = {
    "versions": {"python": sys.version.split()[0], "numpy": np.__version__, "scipy": scipy.__version__,
                 "allantools": allantools.__version__},
    "als": [als("A", *A, [0.2, 0.4], 15, 1000, s) for s in range(1, 5)]
    + [als("B", *B, [0.5, 0.5], 6, 3000, s) for s in range(5, 8)]
    + [als("C", *C, [5.0, 0.2], 10, 2000, s) for s in range(8, 11)],
    "allan": [allan(20, 5000, 100.0, 0.0), allan(21, 5001, 31.25, 0.02), allan(22, 3000, 1.0, 1.0)],
}
path = pathlib.Path(__file__).with_name("noise_values.json")
path.write_text(json.dumps(values, indent=1) + "\n")
