"""What :class:`insnav.AttitudeFilter` returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class AttitudeEpoch:
    """Attitude at one instant. Names, units and frames are those of :class:`Attitudes`'s columns, one row of each."""

    time_s: float
    time_ns: int
    quaternion_nb_wxyz: Floats
    roll_deg: float
    pitch_deg: float
    heading_deg: float
    attitude_covariance_n_rad2: Floats
    gyro_bias_rad_per_s: Floats
    rests: bool
    saturated: bool
    magnetic: bool


@dataclass(frozen=True, eq=False, repr=False)
class Attitudes:
    """Attitudes with their uncertainty: one row an inertial sample.

    Attributes
    ----------
    time_s : (n,)
        Time, s, on the scale of ``t``.
    time_ns : (n,) of int64
        The same, exact.
    quaternion_nb_wxyz : (n, 4)
        Unit quaternions that take vectors from b to n (w, x, y, z); n is magnetic north, east, down, or counts from the begin.
    roll_deg, pitch_deg, heading_deg : (n,)
        The same as angles: right side down, nose up, clockwise from north, 0 to 360.
    attitude_covariance_n_rad2 : (n, 3, 3)
        Covariance of the attitude error as a small rotation, true = Exp(error) ∘ estimate, axes n: that of the last correction.
    gyro_bias_rad_per_s : (n, 3)
        Gyro bias, body axes.
    rests : (n,) of bool
        Whether the body rests.
    saturated : (n,) of bool
        Whether a gyro is at the end of its range.
    magnetic : (n,) of bool
        Whether the heading comes from a magnetometer.
    """

    time_s: Floats
    time_ns: NDArray[np.int64]
    quaternion_nb_wxyz: Floats
    roll_deg: Floats
    pitch_deg: Floats
    heading_deg: Floats
    attitude_covariance_n_rad2: Floats
    gyro_bias_rad_per_s: Floats
    rests: NDArray[np.bool_]
    saturated: NDArray[np.bool_]
    magnetic: NDArray[np.bool_]

    @property
    def sigma_attitude_n_deg(self) -> Floats:
        """Standard deviation as a small rotation about north, east and down, degrees, shape (n, 3)."""
        return np.degrees(np.sqrt(np.diagonal(self.attitude_covariance_n_rad2, axis1=1, axis2=2)))

    def __len__(self) -> int:
        return len(self.time_s)

    def __repr__(self) -> str:
        if len(self) == 0:
            return "<insnav.Attitudes: none>"
        return f"<insnav.Attitudes: {len(self)}, {self.time_s[0]:.3f} s to {self.time_s[-1]:.3f} s>"
