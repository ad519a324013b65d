"""What the functions of `insnav.align` return."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class AlignmentStop:
    """What one stop showed.

    Attributes
    ----------
    begin_s, end_s : float
        Begin and end as used, s.
    rate_n_rad_per_s : (3,)
        Rate that attitude, Earth and drift together explain there, north, east, down.
    residual_rate_n_rad_per_s : (3,)
        What the stop's own fit leaves of it.
    sigma_rate_rad_per_s : (3,)
        Standard deviation of that by the unit's noise and the rocking of the stop.
    quaternion_nb_wxyz : (4,)
        Mean attitude.
    rocking_rms_deg : (3,)
        Scatter of the attitude about it: north, east, down.
    rocking_period_s : float or None
        Period of the strongest rocking, s, when it rocks.
    velocity_rms_m_per_s : float
        Scatter of the computed velocity about its fit.
    taper : str
        Weights used: ``"none"`` or ``"hann_squared"``.
    half_disagreement_sigma : float
        Largest difference of the rates of its two halves, in sigmas.
    """

    begin_s: float
    end_s: float
    rate_n_rad_per_s: Floats
    residual_rate_n_rad_per_s: Floats
    sigma_rate_rad_per_s: Floats
    quaternion_nb_wxyz: Floats
    rocking_rms_deg: Floats
    rocking_period_s: float | None
    velocity_rms_m_per_s: float
    taper: Literal["none", "hann_squared"]
    half_disagreement_sigma: float


@dataclass(frozen=True, eq=False)
class Alignment:
    """Attitude and sensor errors from stops, with all that is known of their errors.

    Attributes
    ----------
    method : str
        The method that gave it; never ``"auto"``.
    reason : str
        Why that one.
    at_s : float
        The instant for which everything holds, s: the end of the last stop.
    quaternion_nb_wxyz : (4,)
        Unit quaternion that takes vectors from b to n then (w, x, y, z).
    roll_deg, pitch_deg : float
        Right side down and nose up positive.
    heading_deg : float or None
        Heading, clockwise from true north, 0 to 360; None where it is not found.
    sigma_attitude_n_deg : (3,)
        Standard deviation of the attitude as a small rotation about north, east and down.
    sigma_azimuth_deg : float
        Standard deviation that the heading has or, where it is not found, would have with this unit and these stops.
    azimuth_deg : float or None
        Heading at the first stop's begin: the azimuth of [Lobusov14]. None by methods without a fit.
    gyro_bias_rad_per_s, sigma_gyro_bias_rad_per_s : (3,)
        Gyro bias (drift), body axes, measured minus true, and its standard deviations.
    accel_bias_m_per_s2, sigma_accel_bias_m_per_s2 : (3,)
        Accelerometer bias, body axes, and its standard deviations.
    covariance : (9, 9)
        Covariance of attitude (small rotation about north, east, down, rad: true = Exp(error) ∘ estimate), gyro bias and accelerometer bias.
    observable : (9,) of bool
        Which of these the stops said something of.
    weakest : (4,)
        The combination of azimuth and drift (north, east, down at the first stop, over Ω cos L) that the positions tell least; unit length.
    geometry_ratio : float
        How well they tell it: 0 not at all, 1.4 the best that two positions can do.
    norm_residual : (float, float) or None
        Horizontal Earth rate found over that of the latitude, minus one, and its sigma; with two or more stops.
    nis_ratio : float or None
        Normalised innovations squared of the Kalman filter over their number: 1 or less on a quiet base.
    stops : tuple of AlignmentStop
        What each stop showed where a fit went through it.
    summary : dict or None
        The report with the keys of ``insnav align --format json``, of :func:`by_stops`.
    """

    method: str
    reason: str
    at_s: float
    quaternion_nb_wxyz: Floats
    roll_deg: float
    pitch_deg: float
    heading_deg: float | None
    sigma_attitude_n_deg: Floats
    sigma_azimuth_deg: float
    azimuth_deg: float | None
    gyro_bias_rad_per_s: Floats
    sigma_gyro_bias_rad_per_s: Floats
    accel_bias_m_per_s2: Floats
    sigma_accel_bias_m_per_s2: Floats
    covariance: Floats
    observable: NDArray[np.bool_]
    weakest: Floats
    geometry_ratio: float
    norm_residual: tuple[float, float] | None
    nis_ratio: float | None
    stops: tuple[AlignmentStop, ...]
    summary: dict[str, Any] | None = None

    def __str__(self) -> str:
        heading = "not found" if self.heading_deg is None else f"{self.heading_deg:.3f}°"
        return (
            f"{self.method} at {self.at_s:.3f} s: roll {self.roll_deg:.3f}°, pitch {self.pitch_deg:.3f}°, "
            f"heading {heading} ± {self.sigma_azimuth_deg:.2g}°"
        )


@dataclass(frozen=True, eq=False)
class HeadingAlignment:
    """Attitude at the first inertial sample from one source of heading.

    Attributes
    ----------
    quaternion_nb_wxyz : (4,)
        Unit quaternion that takes vectors from b to n (w, x, y, z).
    roll_deg, pitch_deg, heading_deg : float
        The same as angles; heading clockwise from north, 0 to 360.
    sigma_heading_deg : float
        Standard deviation of the heading.
    attitude_covariance_n_rad2 : (3, 3)
        Covariance of the attitude error as a small rotation, axes n.
    gyro_bias_rad_per_s, sigma_gyro_bias_rad_per_s : (3,)
        Gyro bias as found, or as taken for known, and its standard deviations.
    """

    quaternion_nb_wxyz: Floats
    roll_deg: float
    pitch_deg: float
    heading_deg: float
    sigma_heading_deg: float
    attitude_covariance_n_rad2: Floats
    gyro_bias_rad_per_s: Floats
    sigma_gyro_bias_rad_per_s: Floats


@dataclass(frozen=True, eq=False)
class StartAlignment:
    """What a run begins with: the state at the first inertial sample.

    Attributes
    ----------
    time_s : float
        That sample's stamp, s.
    latitude_deg_longitude_deg_height_m, velocity_n_m_per_s : (3,)
        Position and velocity of the IMU.
    quaternion_nb_wxyz : (4,)
        Unit quaternion that takes vectors from b to n (w, x, y, z).
    roll_deg, pitch_deg : float
        The same as angles.
    heading_deg : float or None
        Heading, 0 to 360; None where it is unknown.
    gyro_bias_rad_per_s, accel_bias_m_per_s2 : (3,)
        Sensor errors known from standing at the begin, body axes; else zero.
    sigma_position_n_m, sigma_velocity_n_m_per_s, sigma_attitude_n_deg, sigma_gyro_bias_rad_per_s, sigma_accel_bias_m_per_s2 : (3,)
        Standard deviations; the last of the attitude's is that of the heading.
    heading_source : str
        ``"given"``, ``"antenna"``, ``"course_velocity"``, ``"course_position"``, ``"moving_base"``, ``"gyrocompass"``, ``"magnetic"``,
        ``"unknown"`` or ``"relative"``.
    heading_at_s : float
        When it became known, s.
    standing_s : float
        Seconds of standing that levelled it; 0 when it was levelled in motion.
    reversing : bool
        Whether the vehicle was found to drive backwards where its course was taken.
    """

    time_s: float
    latitude_deg_longitude_deg_height_m: Floats
    velocity_n_m_per_s: Floats
    quaternion_nb_wxyz: Floats
    roll_deg: float
    pitch_deg: float
    heading_deg: float | None
    gyro_bias_rad_per_s: Floats
    accel_bias_m_per_s2: Floats
    sigma_position_n_m: Floats
    sigma_velocity_n_m_per_s: Floats
    sigma_attitude_n_deg: Floats
    sigma_gyro_bias_rad_per_s: Floats
    sigma_accel_bias_m_per_s2: Floats
    heading_source: str
    heading_at_s: float
    standing_s: float
    reversing: bool
