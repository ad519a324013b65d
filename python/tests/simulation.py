"""A drive with exact inertial data, written apart from the program under test.

Level body, no climb: position, velocity and heading are given as smooth functions of time, and what the sensors feel follows
from them (Groves 2013, eq. 5.53 with everything but the specific force known).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SEMI_MAJOR = 6378137.0
FLATTENING = 1 / 298.257223563
E2 = FLATTENING * (2 - FLATTENING)
EARTH_RATE = 7.292115e-5
LATITUDE, LONGITUDE, HEIGHT = np.radians(50.0), np.radians(14.0), 300.0
STANDS_S, ROLLS_S = 20.0, 30.0


def gravity(latitude: Array) -> Array:
    """Somigliana on the ellipsoid and the free-air terms of second order (Groves 2013, eq. 2.134 and 2.139), m/s²."""
    s2 = np.sin(latitude) ** 2
    surface = 9.7803253359 * (1 + 0.001931853 * s2) / np.sqrt(1 - E2 * s2)
    mu, semi_minor = 3.986004418e14, SEMI_MAJOR * (1 - FLATTENING)
    m = EARTH_RATE**2 * SEMI_MAJOR**2 * semi_minor / mu
    falls = 2 / SEMI_MAJOR * (1 + FLATTENING * (1 - 2 * s2) + m) * HEIGHT - 3 / SEMI_MAJOR**2 * HEIGHT**2
    return np.asarray(surface * (1 - falls))


def cross(a: Array, b: Array) -> Array:
    return np.asarray(np.cross(a, b))


@dataclass
class Drive:
    """Truth and measurements of one drive."""

    time_s: Array
    latitude_deg: Array
    longitude_deg: Array
    height_m: float
    velocity_n_m_per_s: Array
    heading_deg: Array
    angular_rate_b_rad_per_s: Array
    specific_force_b_m_per_s2: Array

    def at(self, time_s: Array, column: Array) -> Array:
        return np.asarray(np.interp(time_s, self.time_s, column))

    def arrays(
        self,
        rng: np.random.Generator,
        *,
        start_s: float = 0.0,
        position_sigma_m: float = 0.02,
        velocity_sigma_m_per_s: float = 0.02,
        gyro_white: float = 0.0,
        accel_white: float = 0.0,
    ) -> dict[str, Any]:
        """What the sensors say: white noise of the GNSS (1 sigma) and of the IMU (rad/√s, m/s/√s)."""
        dt = self.time_s[1] - self.time_s[0]
        n = len(self.time_s)
        every = slice(0, None, round(0.2 / dt))
        fixes = self.time_s[every]
        metres_north, metres_east = metres_per_degree()
        llh = np.column_stack([self.latitude_deg, self.longitude_deg, np.full(n, self.height_m)])[every]
        scale = [1 / metres_north, 1 / metres_east, 1.0]
        noise = rng.normal(0, position_sigma_m, llh.shape)
        velocity = self.velocity_n_m_per_s[every]
        return {
            "imu": (
                start_s + self.time_s,
                self.angular_rate_b_rad_per_s + rng.normal(0, gyro_white / np.sqrt(dt), (n, 3)),
                self.specific_force_b_m_per_s2 + rng.normal(0, accel_white / np.sqrt(dt), (n, 3)),
            ),
            "gnss_position": (start_s + fixes, llh + noise * scale, np.full(3, position_sigma_m)),
            "gnss_velocity": (
                start_s + fixes,
                velocity + rng.normal(0, velocity_sigma_m_per_s, velocity.shape),
                np.full(velocity.shape, velocity_sigma_m_per_s),
            ),
        }


def metres_per_degree() -> tuple[float, float]:
    """North and east, at the place of the drive."""
    s2 = np.sin(LATITUDE) ** 2
    north = SEMI_MAJOR * (1 - E2) / (1 - E2 * s2) ** 1.5 + HEIGHT
    east = (SEMI_MAJOR / np.sqrt(1 - E2 * s2) + HEIGHT) * np.cos(LATITUDE)
    return float(np.radians(north)), float(np.radians(east))


def drive(duration_s: float = 180.0, rate_hz: float = 100.0) -> Drive:
    """Stand, speed up, then bends at 12 m/s."""
    t = np.arange(0, duration_s, 1 / rate_hz)
    phase = np.clip((t - STANDS_S) / 10, 0, 1)
    speed = 12 * phase**2 * (3 - 2 * phase)
    along = 12 * 6 * phase * (1 - phase) / 10
    w = 2 * np.pi / 40
    after = np.maximum(t - ROLLS_S, 0)
    heading = np.radians(30) + 1.2 * (1 - np.cos(w * after))
    turn = 1.2 * w * np.sin(w * after)

    sin, cos, zero = np.sin(heading), np.cos(heading), np.zeros_like(t)
    v = np.column_stack([speed * cos, speed * sin, zero])
    dv = np.column_stack([along * cos - speed * turn * sin, along * sin + speed * turn * cos, zero])

    def integral(f: Array) -> Array:
        return np.concatenate([[0], np.cumsum((f[1:] + f[:-1]) / 2)]) / rate_hz

    # Two rounds settle latitude, on which the radii depend.
    latitude = np.full_like(t, LATITUDE)
    for _ in range(2):
        s2 = np.sin(latitude) ** 2
        meridian = SEMI_MAJOR * (1 - E2) / (1 - E2 * s2) ** 1.5 + HEIGHT
        transverse = SEMI_MAJOR / np.sqrt(1 - E2 * s2) + HEIGHT
        latitude = LATITUDE + integral(v[:, 0] / meridian)
    longitude = LONGITUDE + integral(v[:, 1] / (transverse * np.cos(latitude)))

    w_ie = EARTH_RATE * np.column_stack([np.cos(latitude), zero, -np.sin(latitude)])
    w_en = np.column_stack([v[:, 1] / transverse, -v[:, 0] / meridian, -v[:, 1] * np.tan(latitude) / transverse])
    g = np.column_stack([zero, zero, gravity(latitude)])
    force_n = dv + cross(2 * w_ie + w_en, v) - g

    def to_body(a_n: Array) -> Array:
        return np.column_stack([cos * a_n[:, 0] + sin * a_n[:, 1], cos * a_n[:, 1] - sin * a_n[:, 0], a_n[:, 2]])

    return Drive(
        time_s=t,
        latitude_deg=np.degrees(latitude),
        longitude_deg=np.degrees(longitude),
        height_m=HEIGHT,
        velocity_n_m_per_s=v,
        heading_deg=np.degrees(heading) % 360,
        angular_rate_b_rad_per_s=to_body(w_ie + w_en) + np.column_stack([zero, zero, turn]),
        specific_force_b_m_per_s2=to_body(force_n),
    )
