"""What `insnav.filter` takes and returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from insnav._insnav import NavState, noise_from_data_sheet, noise_of_grade

Floats = NDArray[np.float64]
Grade = Literal["consumer", "automotive", "industrial", "tactical", "navigation"]


@dataclass(frozen=True)
class ImuNoise:
    """Noise of an inertial unit: white densities and first-order Gauss–Markov biases, equal on all axes.

    Attributes
    ----------
    gyro_white : float
        Angle random walk, rad/√s.
    accel_white : float
        Velocity random walk, m/s/√s.
    gyro_bias_sigma : float
        Standard deviation of the gyro bias, at power-on and for ever after, rad/s.
    accel_bias_sigma : float
        That of the accelerometer bias, m/s².
    gyro_bias_tau, accel_bias_tau : float
        Correlation times of the biases, s; infinite: constants.

    Examples
    --------
    >>> from insnav.filter import ImuNoise
    >>> unit = ImuNoise.from_data_sheet(0.15, 0.1, 30.0, 3.0)
    >>> unit == ImuNoise.of_grade("industrial")
    True
    """

    gyro_white: float
    accel_white: float
    gyro_bias_sigma: float
    accel_bias_sigma: float
    gyro_bias_tau: float = 20_000.0
    accel_bias_tau: float = 20_000.0

    @staticmethod
    def of_grade(grade: Grade) -> ImuNoise:
        """Noise of a class of inertial units ([Groves13] table 4.1, from the middle of each class)."""
        return noise_of_grade(grade)

    @staticmethod
    def from_data_sheet(
        gyro_arw_deg_per_sqrt_hour: float,
        accel_vrw_m_per_s_per_sqrt_hour: float,
        gyro_bias_deg_per_hour: float,
        accel_bias_mg: float,
        *,
        gyro_bias_tau_s: float = 20_000.0,
        accel_bias_tau_s: float = 20_000.0,
    ) -> ImuNoise:
        """Noise from the units of data sheets: °/√h, m/s/√h, °/h, thousandths of 9.80665 m/s², s."""
        return noise_from_data_sheet(
            gyro_arw_deg_per_sqrt_hour,
            accel_vrw_m_per_s_per_sqrt_hour,
            gyro_bias_deg_per_hour,
            accel_bias_mg,
            gyro_bias_tau_s=gyro_bias_tau_s,
            accel_bias_tau_s=accel_bias_tau_s,
        )


@dataclass(frozen=True, eq=False)
class Update:
    """One measurement as the filter saw it.

    Attributes
    ----------
    time_s : float
        Instant of the measurement, s.
    measurement : str
        Name of its model, such as ``"gnss_position"``.
    dof : int
        Number of components, 1 to 3.
    residual : (dof,)
        Measured minus predicted, in the unit of the measurement.
    sigma : (dof,)
        Standard deviations of the residual as predicted: roots of the diagonal of S = H P Hᵀ + R.
    nis : float
        Normalised innovation squared, rᵀ S⁻¹ r; its mean over a consistent run is ``dof``.
    verdict : str
        ``"accepted"``; ``"inflated"``: used with its covariance enlarged until it fitted; ``"rejected"``: not used.
    """

    time_s: float
    measurement: str
    dof: int
    residual: Floats
    sigma: Floats
    nis: float
    verdict: Literal["accepted", "inflated", "rejected", "reset", "frozen"]


@dataclass(frozen=True, eq=False)
class Nominal:
    """The estimate of a filter: what measurement models may look at. SI and radians.

    Attributes
    ----------
    nav : NavState
        Position, velocity, attitude, time.
    gyro_bias, accel_bias : (3,)
        Biases, measured minus true, b, rad/s and m/s².
    gyro_scale, accel_scale : (3,)
        Scale factor errors: measured = (1 + s) true.
    rate_b : (3,)
        Angular rate against inertial space over the last interval with its errors taken out, rad/s.
    acceleration_n : (3,)
        Change of the velocity over the last interval, m/s².
    lever_arm_b : (3,)
        To add to the lever arm of measurements, m.
    gnss_colour_n : (3,)
        Time-correlated error of GNSS positions, m.
    mounting : (2,)
        Pitch and yaw of the IMU's axes against the vehicle's, rad.
    axle_forward : float
        To add to the forward place of the axle, m.
    odometer_scale : float
        Scale factor error of the odometer.
    clock_offset : float
        A fix stamped t shows the body where the filter had it at t minus this, s.
    held_q_nb : (4,)
        The attitude that is held while standing; of no meaning else.
    """

    nav: NavState
    gyro_bias: Floats
    accel_bias: Floats
    gyro_scale: Floats
    accel_scale: Floats
    rate_b: Floats
    acceleration_n: Floats
    lever_arm_b: Floats
    gnss_colour_n: Floats
    mounting: Floats
    axle_forward: float
    odometer_scale: float
    clock_offset: float
    held_q_nb: Floats
