"""What the functions of `insnav.noise` return."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Estimate:
    """Q and R as identified, with what they are worth.

    Attributes
    ----------
    names : tuple of str
        The unknowns: ``"Q[0,0]"``, …, ``"R[0,0]"``, ….
    theta : (k,)
        Their values, known ones included: variances per step of the model, in squared units of the model.
    se : (k,)
        Standard errors, one sigma; 0 for what is known or held.
    covariance : (k, k)
        Covariance of theta.
    verdicts : tuple of str
        ``"estimated"``; ``"on_bound"``: at the end of what is possible; ``"known"``: given; ``"held"``: not identifiable from these
        data, kept at what it was before.
    Q : (g, g)
        Covariance of the process noise, per step.
    R : (p, p)
        Covariance of the measurement noise.
    chi2 : float
        Weighted sum of squares of what the model leaves of the lag covariances.
    dof : int
        Lag covariances less unknowns.
    fits : bool
        Whether chi2 is at most three times its degrees of freedom. If not, unmodelled motion or coloured noise passes for white noise:
        keep what was used before.
    not_identified : tuple of str
        Unknowns of which the data say no more than an upper limit: the standard error exceeds the value. Names a covariance below zero in
        any case.
    rank : int
        Number of independent combinations of the free unknowns that are determined.
    cond : float
        Condition number of the scaled columns.
    weakest : tuple of (str, float)
        The combination of unknowns that is determined worst, with shares.
    iters : int
        How often the weight was taken anew.
    gain : (n, p) or None
        Of :func:`als_estimate`: gain of the stationary filter for the estimate, which corrects the predicted state.
    rounds : (rounds, k) or None
        Of :func:`als_estimate`: theta after each round.
    """

    names: tuple[str, ...]
    theta: Floats
    se: Floats
    covariance: Floats
    verdicts: tuple[Literal["estimated", "on_bound", "known", "held"], ...]
    Q: Floats
    R: Floats
    chi2: float
    dof: int
    fits: bool
    not_identified: tuple[str, ...]
    rank: int
    cond: float
    weakest: tuple[tuple[str, float], ...]
    iters: int
    gain: Floats | None = None
    rounds: Floats | None = None

    def __str__(self) -> str:
        rows = [
            f"{name:10} {value:12.5g} ± {error:.2g} {verdict}"
            for name, value, error, verdict in zip(self.names, self.theta, self.se, self.verdicts, strict=True)
        ]
        fit = "fits" if self.fits else "the model does not fit"
        return "\n".join([*rows, f"chi2/dof {self.chi2:.1f}/{self.dof}: {fit}"])


@dataclass(frozen=True, eq=False)
class AllanDeviation:
    """Overlapping Allan deviation by averaging time.

    Attributes
    ----------
    tau_s : (k,)
        Averaging times, s.
    samples : (k,) of int64
        The same in samples.
    deviation : (k,)
        Deviations, in the unit of the record.
    differences : (k,) of int64
        Number of overlapping second differences each is the mean of.
    """

    tau_s: Floats
    samples: NDArray[np.int64]
    deviation: Floats
    differences: NDArray[np.int64]

    def plot(self, fit: AllanFit | None = None, ax: Axes | None = None, *, unit: str = "") -> Axes:
        """Deviation over averaging time, both logarithmic (needs matplotlib).

        Parameters
        ----------
        fit : AllanFit, optional
            Of :func:`fit_allan`: adds the interval of each point, the fit, and its parts as lines of slope −1/2 (white noise), 0 (flicker)
            and +1/2 (random walk), with their coefficients.
        ax : matplotlib.axes.Axes, optional
            Where to draw, in place of a new figure.
        unit : str
            Of the record, such as ``"rad/s"``, for labels.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from insnav._plot import allan

        return allan(self, fit, ax, unit)


@dataclass(frozen=True, eq=False)
class AllanFit:
    """Noise of a sensor by its Allan variance: N²/τ + (2 ln 2/π) B² + K² τ/3.

    Attributes
    ----------
    white, white_se : float
        N (angle or velocity random walk), unit of the record times √s, and its standard error; of a coefficient that is 0 an upper limit.
    flicker, flicker_se : float
        B (bias instability), unit of the record. The flat floor of the deviation is 0.664 B.
    random_walk, random_walk_se : float
        K (rate random walk), unit of the record by √s.
    chi2 : float
        Weighted sum of squares of what the fit leaves.
    dof : int
        Averaging times less coefficients.
    from_tau_s : float
        The shortest averaging time that was used, s.
    fitted : (k,)
        Deviation of the fit at the averaging times that were given.
    parts : (k, 3)
        Those of white noise, flicker noise and random walk alone, whose squares add up to that of ``fitted``.
    interval : (k, 2)
        Confidence interval of each given deviation, one sigma.
    """

    white: float
    white_se: float
    flicker: float
    flicker_se: float
    random_walk: float
    random_walk_se: float
    chi2: float
    dof: int
    from_tau_s: float
    fitted: Floats
    parts: Floats
    interval: Floats


@dataclass(frozen=True, eq=False)
class RestStability:
    """What a unit at rest shows by averaging time, in body axes.

    Attributes
    ----------
    begin_s, end_s : float
        The stretch that was looked at, s.
    step_s : float
        Step between samples, s.
    gyro : three of (AllanDeviation, AllanFit)
        Of each axis, rad/s.
    accel : three of (AllanDeviation, AllanFit)
        Of each axis, m/s².
    """

    begin_s: float
    end_s: float
    step_s: float
    gyro: tuple[tuple[AllanDeviation, AllanFit], ...]
    accel: tuple[tuple[AllanDeviation, AllanFit], ...]
