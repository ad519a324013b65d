"""What the functions of `insnav.mechanization` return."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from insnav._insnav import NavState

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Increments:
    """What a body did, interval by interval, as constant rate and constant force in its own axes.

    Coning and sculling are inside: ``exp(rotation_b)`` is the whole rotation, ``left_jacobian(rotation_b) @ velocity_b`` the whole gain
    of velocity in the axes of the interval's begin.

    Attributes
    ----------
    time_s : (n,)
        Ends of the intervals, s.
    dt : (n,)
        Their lengths, s.
    rotation_b : (n, 3)
        Rotation vectors of the body against inertial space, rad.
    velocity_b : (n, 3)
        Velocity increments of specific force in the axes of the turning body, m/s.
    """

    time_s: Floats
    dt: Floats
    rotation_b: Floats
    velocity_b: Floats

    def __len__(self) -> int:
        return len(self.dt)

    def __repr__(self) -> str:
        return f"<insnav.Increments: {len(self)}, {float(np.sum(self.dt)):.3f} s in all>"


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """The way of a body without aiding: one row at the end of each interval.

    Attributes
    ----------
    time_s : (n,)
        Instants, s.
    time_ns : (n,) of int64
        The same in ns, exact.
    position : (n, 3)
        Latitude and longitude, rad, and height above the ellipsoid, m.
    velocity_n : (n, 3)
        Velocity over ground, north-east-down, m/s.
    q_nb : (n, 4)
        Unit quaternions (w, x, y, z) that take vectors from b to n.
    end : NavState
        The last row, to go on from.
    """

    time_s: Floats
    time_ns: NDArray[np.int64]
    position: Floats
    velocity_n: Floats
    q_nb: Floats
    end: NavState

    @property
    def latitude(self) -> Floats:
        """Latitude, rad, shape (n,)."""
        return self.position[:, 0]

    @property
    def longitude(self) -> Floats:
        """Longitude, rad, shape (n,)."""
        return self.position[:, 1]

    @property
    def height(self) -> Floats:
        """Height above the ellipsoid, m, shape (n,)."""
        return self.position[:, 2]

    def __len__(self) -> int:
        return len(self.time_s)

    def __repr__(self) -> str:
        return f"<insnav.Trajectory: {len(self)} rows, to {self.end!r}>"
