"""Does the body stand? Detectors of stops over arrays, and sample by sample.

:func:`mv`, :func:`mag`, :func:`are` and :func:`glrt` are the statistics of [Skog10] over windows that slide by one sample, with the
thresholds that follow from the noise of the unit. :class:`StopDetector` is what a run uses: low-passed variances, mean rate, speed, what
is declared; :func:`detect` shows it whole arrays. Rates are in rad/s, forces in m/s², both in body axes.

Examples
--------
>>> import numpy as np
>>> from insnav import stationary
>>> rng = np.random.default_rng(1)
>>> t = np.arange(0, 60, 0.01)
>>> moves = (t > 20) & (t < 40)
>>> gyro = rng.normal(0, 1e-4, (len(t), 3)) + np.outer(moves * np.sin(9 * t), [0.1, 0.0, 0.05])
>>> accel = rng.normal([0.0, 0.0, -9.81], 2e-3, (len(t), 3)) + np.outer(moves * np.cos(7 * t), [1.0, 0.5, 0.2])
>>> stops = stationary.detect({"imu": (t, gyro, accel)}, {"imu": {"grade": "industrial"}})
>>> len(stops)
2
>>> bool(stops.standing[t < 19].mean() > 0.9), bool(stops.standing[moves].any())
(True, False)
"""

from __future__ import annotations

from numpy.typing import ArrayLike

from insnav._arrays import Config as _Config
from insnav._insnav import StopDetector, detector_statistic, quantile_of_squares
from insnav._insnav import detect_stops as detect
from insnav._stationary import Statistic, StopIntervals

__all__ = [
    "Statistic",
    "StopDetector",
    "StopIntervals",
    "are",
    "detect",
    "glrt",
    "mag",
    "mv",
    "quantile_of_squares",
]


def mv(
    accel: ArrayLike,
    step_s: float,
    *,
    window_s: float,
    config: _Config | None = None,
    stance: bool = False,
    normal_quantile: float = 3.090,
) -> Statistic:
    """Acceleration moving variance: T = 1/(σ² N) Σ|f - mean f|² ([Skog10]).

    Blind to slow turns and to constant acceleration.

    Parameters
    ----------
    accel : (n, 3)
        Specific force, body axes, m/s².
    step_s : float
        Step between samples, s.
    window_s : float
        Length of the window, s.
    config : mapping or path, optional
        Settings as of :func:`insnav.run`: noise at rest is that of ``stationary``, else of ``noise`` and ``imu.grade``, else a consumer's.
    stance : bool, default False
        The window is that of a foot on the ground: noise is at least what a foot that rolls on shows.
    normal_quantile : float, default 3.090
        Of the threshold: that of one false alarm in a thousand windows.

    Returns
    -------
    Statistic
        Below its threshold it speaks for a stop.
    """
    return detector_statistic(
        "mv", step_s, None, accel, window_s=window_s, config=config, stance=stance, normal_quantile=normal_quantile
    )


def mag(
    accel: ArrayLike,
    step_s: float,
    *,
    window_s: float,
    config: _Config | None = None,
    stance: bool = False,
    normal_quantile: float = 3.090,
) -> Statistic:
    """Acceleration magnitude: T = 1/(σ² N) Σ(|f| - g)² ([Skog10]).

    The threshold allows for one standard deviation of the accelerometer bias and of gravity.

    Parameters
    ----------
    accel : (n, 3)
        Specific force, body axes, m/s².
    step_s : float
        Step between samples, s.
    window_s : float
        Length of the window, s.
    config : mapping or path, optional
        What the unit is worth at rest, as of :func:`mv`.
    stance : bool, default False
        The window is that of a foot on the ground.
    normal_quantile : float, default 3.090
        Of the threshold, as of :func:`mv`.

    Returns
    -------
    Statistic
        Below its threshold it speaks for a stop.
    """
    return detector_statistic(
        "mag", step_s, None, accel, window_s=window_s, config=config, stance=stance, normal_quantile=normal_quantile
    )


def are(
    gyro: ArrayLike,
    step_s: float,
    *,
    window_s: float,
    config: _Config | None = None,
    stance: bool = False,
    expected_rate_b_rad_per_s: ArrayLike | None = None,
    sigma_rate_rad_per_s: float | None = None,
    normal_quantile: float = 3.090,
) -> Statistic:
    """Angular rate energy: T = 1/(σ² N) Σ|ω - expected|² ([Skog10]).

    The threshold allows for one standard deviation of the expected rate.

    Parameters
    ----------
    gyro : (n, 3)
        Angular rate, body axes, rad/s.
    step_s : float
        Step between samples, s.
    window_s : float
        Length of the window, s.
    config : mapping or path, optional
        What the unit is worth at rest, as of :func:`mv`.
    stance : bool, default False
        The window is that of a foot on the ground.
    expected_rate_b_rad_per_s : (3,), optional
        What the gyros measure at rest (bias and Earth rate); zero.
    sigma_rate_rad_per_s : float, optional
        Standard deviation of that on each axis; by default the bias of the unit.
    normal_quantile : float, default 3.090
        Of the threshold, as of :func:`mv`.

    Returns
    -------
    Statistic
        Below its threshold it speaks for a stop.
    """
    return detector_statistic(
        "are",
        step_s,
        gyro,
        None,
        window_s=window_s,
        config=config,
        stance=stance,
        expected_rate_b_rad_per_s=expected_rate_b_rad_per_s,
        sigma_rate_rad_per_s=sigma_rate_rad_per_s,
        normal_quantile=normal_quantile,
    )


def glrt(
    gyro: ArrayLike,
    accel: ArrayLike,
    step_s: float,
    *,
    window_s: float,
    config: _Config | None = None,
    stance: bool = False,
    expected_rate_b_rad_per_s: ArrayLike | None = None,
    sigma_rate_rad_per_s: float | None = None,
    normal_quantile: float = 3.090,
) -> Statistic:
    """Generalised likelihood ratio test ("SHOE"): T = 1/N Σ(|f - g u|²/σ_a² + |ω - expected|²/σ_g²), u along mean f ([Skog10]).

    Parameters
    ----------
    gyro : (n, 3)
        Angular rate, body axes, rad/s.
    accel : (n, 3)
        Specific force, body axes, m/s².
    step_s : float
        Step between samples, s.
    window_s : float
        Length of the window, s.
    config : mapping or path, optional
        What the unit is worth at rest, as of :func:`mv`.
    stance : bool, default False
        The window is that of a foot on the ground.
    expected_rate_b_rad_per_s : (3,), optional
        What the gyros measure at rest (bias and Earth rate); zero.
    sigma_rate_rad_per_s : float, optional
        Standard deviation of that on each axis; by default the bias of the unit.
    normal_quantile : float, default 3.090
        Of the threshold, as of :func:`mv`.

    Returns
    -------
    Statistic
        Below its threshold it speaks for a stop.
    """
    return detector_statistic(
        "glrt",
        step_s,
        gyro,
        accel,
        window_s=window_s,
        config=config,
        stance=stance,
        expected_rate_b_rad_per_s=expected_rate_b_rad_per_s,
        sigma_rate_rad_per_s=sigma_rate_rad_per_s,
        normal_quantile=normal_quantile,
    )
