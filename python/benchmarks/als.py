"""How fast `insnav.noise` is against autocovariance least squares as the papers write it, in numpy.

The same identification twice: :func:`insnav.noise.als_design` and :func:`insnav.noise.als_solve`, and the published construction
([Odelson06]: the covariance of all innovations in a window by Kronecker products, ``numpy.linalg.lstsq``), written apart. Runs take turns,
and each counts with the least of its times, which is what it takes where nothing else wants the machine; both designs and both estimates have
to agree to 1e-9. What insnav solves has standard errors by Bartlett's formula and a test of the model besides, which the other has not and which
are most of its time: both are given. The bar, 100 times, is that of the construction of the design alone.

    (cd python && maturin develop --release)
    python python/benchmarks/als.py [--check]
"""

from __future__ import annotations

import os

# Before numpy: what is measured is one core.
for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(threads, "1")

import argparse
import json
import platform
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import insnav
from insnav import noise

Array = NDArray[np.float64]

# What is asked for, of the construction.
LEAST_SPEEDUP = 100.0
AGREEMENT = 1e-9


@dataclass(frozen=True)
class Model:
    """x₊ = F x + G w, y = H x + v, and a gain that corrects the predicted state."""

    name: str
    F: Array
    G: Array
    H: Array
    L: Array
    lags: int


def chain(name: str, axes: int, order: int, lags: int) -> Model:
    """So many axes, each a chain of `order` states (position, velocity, attitude, …) of which the first is measured, weakly coupled."""
    n, dt = axes * order, 0.1
    one = np.eye(order) + dt * np.eye(order, k=1)
    one[-1, -1] = 0.98
    F = np.kron(np.eye(axes), one) + 1e-3 * np.random.default_rng(0).normal(size=(n, n))
    H = np.asarray(np.kron(np.eye(axes), np.eye(order)[:1]), dtype=np.float64)
    G = np.eye(n)
    # The stationary gain of some guess at Q and R: stable, and no better than a guess.
    P: Array = np.eye(n)
    L: Array = np.zeros((n, axes))
    for _ in range(2000):
        L = np.asarray(P @ H.T @ np.linalg.inv(H @ P @ H.T + 10 * np.eye(axes)), dtype=np.float64)
        P = F @ (P - L @ H @ P) @ F.T + 0.01 * np.eye(n)
    return Model(name, F, G, H, L, lags)


def published_design(m: Model) -> Array:
    """What vec(Q) and vec(R), diagonal, add to vec of the covariance of `lags` innovations in a row: [Odelson06] eq. (13).

    The sums over the blocks of Γ are taken block by block: the Γ ⊗ Γ of the equation would have 10⁸ elements.
    """
    n, p, g = m.F.shape[0], m.H.shape[0], m.G.shape[1]
    FL = m.F @ m.L
    closed = m.F - FL @ m.H
    rows = [m.H]
    for _ in range(1, m.lags):
        rows.append(rows[-1] @ closed)
    observability = np.vstack(rows)
    # vec stacks columns: vec(A X Aᵀ) = (A ⊗ A) vec(X).
    of_p = np.kron(observability, observability) @ np.linalg.inv(np.eye(n * n) - np.kron(closed, closed))
    of_q = of_p @ np.kron(m.G, m.G)
    of_r = of_p @ np.kron(FL, FL)
    for k in range(m.lags):
        # How the state noise of step k, and its measurement noise, reach all innovations.
        gamma = np.zeros((m.lags * p, n))
        gamma[(k + 1) * p :] = observability[: (m.lags - k - 1) * p]
        psi = -gamma @ FL
        psi[k * p : (k + 1) * p] += np.eye(p)
        of_q += np.kron(gamma @ m.G, gamma @ m.G)
        of_r += np.kron(psi, psi)
    return np.hstack([of_q[:, [i * (g + 1) for i in range(g)]], of_r[:, [i * (p + 1) for i in range(p)]]])


def by_lag(m: Model, A: Array) -> Array:
    """Of its rows those of the first innovation with all others, in the order of C.ravel()."""
    p = m.H.shape[0]
    first = A.reshape(m.lags * p, m.lags * p, -1)[:p]
    return np.ascontiguousarray(first.reshape(p, m.lags, p, -1).transpose(1, 2, 0, 3).reshape(m.lags * p * p, -1))


def stacked(m: Model, C: Array) -> Array:
    """Covariance of `lags` innovations in a row, of those by lag."""
    p = m.H.shape[0]
    R = np.empty((m.lags * p, m.lags * p))
    for i in range(m.lags):
        for j in range(m.lags):
            R[i * p : (i + 1) * p, j * p : (j + 1) * p] = C[i - j] if i >= j else C[j - i].T
    return R


def by_numpy(m: Model, R: Array) -> tuple[Array, Array]:
    A = published_design(m)
    # Columns scaled to one length: unknowns differ by powers of ten.
    scale = np.linalg.norm(A, axis=0)
    theta = np.linalg.lstsq(A / scale, R.ravel(order="F"), rcond=None)[0] / scale
    return A, theta


def by_insnav(m: Model, C: Array, counts: Array) -> tuple[noise.Design, Array]:
    design = noise.als_design(m.F, m.G, m.H, m.L, None, m.lags)
    found = noise.als_solve(design, C, counts, weight="identity", constraint="none", reweights=0)
    return design, found.theta


def seconds(run: Callable[[], object]) -> float:
    begin = time.perf_counter()
    run()
    return time.perf_counter() - begin


def compare(m: Model, repeats: int) -> dict[str, float | str]:
    truth = np.random.default_rng(1).uniform(0.5, 2.0, m.G.shape[1] + m.H.shape[0])
    A = published_design(m)
    C = (by_lag(m, A) @ truth).reshape(m.lags, len(m.H), len(m.H))
    R, counts = stacked(m, C), np.full(m.lags, 1e6)
    design, ours = by_insnav(m, C, counts)
    _, theirs = by_numpy(m, R)
    ours_by_lag = by_lag(m, A)
    off_design = float(np.max(np.abs(design.matrix - ours_by_lag) / np.abs(ours_by_lag).max(axis=0)))
    off_theta = float(np.max(np.abs(ours / theirs - 1)))
    fast, slow, fast_design, slow_design = [], [], [], []
    for _ in range(repeats):
        slow.append(seconds(lambda: by_numpy(m, R)))
        slow_design.append(seconds(lambda: published_design(m)))
        # Short ones need many tries until nothing else wanted the machine.
        for _ in range(30):
            fast.append(seconds(lambda: by_insnav(m, C, counts)))
            fast_design.append(seconds(lambda: noise.als_design(m.F, m.G, m.H, m.L, None, m.lags)))
    return {
        "model": m.name,
        "states": len(m.F),
        "channels": len(m.H),
        "lags": m.lags,
        "insnav_ms": 1e3 * min(fast),
        "numpy_ms": 1e3 * min(slow),
        "speedup": min(slow) / min(fast),
        "insnav_design_ms": 1e3 * min(fast_design),
        "numpy_design_ms": 1e3 * min(slow_design),
        "design_speedup": min(slow_design) / min(fast_design),
        "design_disagreement": off_design,
        "estimate_disagreement": off_theta,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=10)
    parser.add_argument("--check", action="store_true", help="fail where the speed asked for is missed")
    parser.add_argument("--small", action="store_true", help="few lags: to see that both agree")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    lags = [8, 8, 8] if arguments.small else [40, 40, 30]
    models = [
        chain("attitude, one axis", 1, 2, lags[0]),
        chain("attitude, three axes", 3, 2, lags[1]),
        chain("strapdown filter", 3, 5, lags[2]),
    ]
    rows = [compare(m, arguments.repeats) for m in models]
    if arguments.json:
        print(json.dumps({"python": platform.python_version(), "numpy": np.__version__, "insnav": insnav.__version__, "rows": rows}))
    else:
        for row in rows:
            print(
                f"{row['model']:22} n={row['states']:<3} p={row['channels']} lags={row['lags']}: "
                f"design {row['insnav_design_ms']:.3f} / {row['numpy_design_ms']:.1f} ms ({row['design_speedup']:.0f} times), "
                f"with its solution {row['insnav_ms']:.2f} / {row['numpy_ms']:.1f} ms ({row['speedup']:.0f} times); "
                f"agree to {row['design_disagreement']:.0e}, {row['estimate_disagreement']:.0e}"
            )
    wrong = [r for r in rows if not (float(r["design_disagreement"]) < AGREEMENT and float(r["estimate_disagreement"]) < AGREEMENT)]
    for row in wrong:
        print(f"error: {row['model']}: the two disagree by more than {AGREEMENT}", file=sys.stderr)
    slow = [r for r in rows if arguments.check and float(r["design_speedup"]) < LEAST_SPEEDUP]
    for row in slow:
        print(f"error: {row['model']}: the construction takes 1/{row['design_speedup']:.0f} of the time, 1/{LEAST_SPEEDUP:.0f} is asked for", file=sys.stderr)
    return 1 if wrong or slow else 0


if __name__ == "__main__":
    sys.exit(main())
