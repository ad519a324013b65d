"""The form of settings, of arrays in place of a log, and of a start in place of one found in the data."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import Any, TypeAlias, TypedDict

from numpy.typing import ArrayLike

Config: TypeAlias = Mapping[str, Any] | str | PathLike[str]


class Arrays(TypedDict, total=False):
    """What :func:`insnav.run` takes in place of a log: for each kind of data a tuple of columns.

    Every column is an array or what ``numpy.asarray`` takes, with one row per stamp and no element masked. ``time_s`` has shape (n,) and does
    not go backward: seconds on one clock for all kinds, or dates (``datetime64``, those of pandas and Python's own, of any zone), which keep
    stamps of today exact and are instants whatever ``t0_ns`` says. ``n`` is north-east-down, ``b`` is forward-right-down.

    Attributes
    ----------
    imu : (time_s, angular_rate_b_rad_per_s, specific_force_b_m_per_s2)
        Shapes (n,), (n, 3), (n, 3). Specific force is (0, 0, -g) at rest and level.
    imu_increment : (time_s, angle_b_rad, velocity_b_m_per_s)
        In place of ``imu``: what was gained since the row before. Shapes (n,), (n, 3), (n, 3).
    gnss_position : (time_s, latitude_deg_longitude_deg_height_m[, sigma_n_m])
        Antenna position, height above the ellipsoid. Shapes (n,), (n, 3); standard deviations (n, 3), or (3,) or a number
        for all rows, NaN where not known; or covariances (n, 3, 3) in squared units, or (3, 3) for all rows (of three rows,
        (3, 3) are their standard deviations). Below zero they are refused, as are matrices that are no covariance (not symmetric,
        correlations beyond 1): a driver's -1 for "no estimate" is NaN here (of a log, variances of zero or below are taken for not
        known, and a fix whose matrix is no covariance is left out and told).
    gnss_velocity : (time_s, velocity_n_m_per_s[, sigma_n_m_per_s])
        Antenna velocity, down NaN for receivers that give speed and course only. Shapes as for positions.
    heading : (time_s, heading_deg, sigma_deg)
        From a dual antenna or another source, clockwise from true north. Shapes (n,). A sigma below zero is refused; one of zero or NaN
        is left out and told.
    standstill : (time_s, standing)
        Somebody says whether the body stands, from then on. Shapes (n,).
    speed : (time_s, speed_m_per_s)
        How fast the wheels turn, whichever way. Shapes (n,).
    magnetic_field : (time_s, field_b_tesla)
        Of a magnetometer, for the heading of a start where nothing else tells it. Shapes (n,), (n, 3).
    t0_ns : int
        Instant from which ``time_s`` of all kinds counts, ns; it becomes that of the solution. Absent: 0. Dates are instants already.
    lever_arm_b_m : (3,)
        Antenna from the IMU, where the settings do not say it.
    """

    imu: tuple[ArrayLike, ArrayLike, ArrayLike]
    imu_increment: tuple[ArrayLike, ArrayLike, ArrayLike]
    gnss_position: tuple[ArrayLike, ArrayLike] | tuple[ArrayLike, ArrayLike, ArrayLike | None]
    gnss_velocity: tuple[ArrayLike, ArrayLike] | tuple[ArrayLike, ArrayLike, ArrayLike | None]
    heading: tuple[ArrayLike, ArrayLike, ArrayLike]
    standstill: tuple[ArrayLike, ArrayLike]
    speed: tuple[ArrayLike, ArrayLike]
    magnetic_field: tuple[ArrayLike, ArrayLike]
    t0_ns: int
    lever_arm_b_m: ArrayLike


class _StartTime(TypedDict, total=False):
    time_s: float


class Start(_StartTime):
    """A known state of the IMU for the ``start`` of :func:`insnav.run`: a simulation's, or the end of another run.

    Biases start at zero with the standard deviations that the settings give the unit.

    Attributes
    ----------
    time_s : float, optional
        Instant, s, on the scale of the solution's ``time_s``: no date. Absent: the first inertial sample.
    latitude_deg_longitude_deg_height_m : (3,)
        Position of the IMU, height above the ellipsoid.
    velocity_n_m_per_s : (3,)
        Velocity over ground.
    roll_deg_pitch_deg_heading_deg : (3,)
        Attitude of the forward-right-down axes, heading clockwise from true north.
    sigma_position_n_m, sigma_velocity_n_m_per_s : (3,)
        Standard deviations.
    sigma_attitude_n_deg : (3,)
        Standard deviations of the attitude as a small rotation about north, east and down.
    """

    latitude_deg_longitude_deg_height_m: ArrayLike
    velocity_n_m_per_s: ArrayLike
    roll_deg_pitch_deg_heading_deg: ArrayLike
    sigma_position_n_m: ArrayLike
    sigma_velocity_n_m_per_s: ArrayLike
    sigma_attitude_n_deg: ArrayLike
