"""What the simulations of `insnav.sim` return."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from insnav._insnav import Scenario

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Truth:
    """What really was: a row an instant, columns named as those of :class:`insnav.Solution`.

    Attributes
    ----------
    time_s : (n,)
        s from the start of the drive, on the clock of GNSS positions, as solutions are.
    latitude_deg, longitude_deg, height_m : (n,)
        Position of the IMU (WGS-84, above the ellipsoid).
    velocity_n_m_per_s : (n, 3)
        Velocity over ground, north-east-down.
    quaternion_nb_wxyz : (n, 4)
        Unit quaternion that takes vectors from b (forward-right-down) to n.
    roll_deg, pitch_deg, heading_deg : (n,)
        The same as angles; heading clockwise from true north, 0 to 360.
    angular_rate_b_rad_per_s : (n, 3)
        Angular rate of the body against inertial space, body axes: what ideal gyros measure.
    specific_force_b_m_per_s2 : (n, 3)
        Specific force, body axes: what ideal accelerometers measure.
    gyro_bias_deg_per_hour, accel_bias_mg : (n, 3)
        Biases of the simulated unit (measured minus true), constant and wandering part together.
    standing : (n,) of bool
        Whether the body stands: its horizontal speed is below 0.1 m/s.
    """

    time_s: Floats
    latitude_deg: Floats
    longitude_deg: Floats
    height_m: Floats
    velocity_n_m_per_s: Floats
    quaternion_nb_wxyz: Floats
    roll_deg: Floats
    pitch_deg: Floats
    heading_deg: Floats
    angular_rate_b_rad_per_s: Floats
    specific_force_b_m_per_s2: Floats
    gyro_bias_deg_per_hour: Floats
    accel_bias_mg: Floats
    standing: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.time_s)

    def __repr__(self) -> str:
        return f"<insnav.sim.Truth: {len(self)} instants>"


@dataclass(frozen=True, eq=False)
class Simulation:
    """A simulated drive: what the sensors said, and what really was.

    Attributes
    ----------
    scenario : Scenario
        What was simulated.
    seed : int
        With which seed.
    arrays : dict
        What :func:`insnav.run` takes (see :class:`insnav.Arrays`). Seconds count from the start of the drive; a fix has the stamp of its
        receiver, whatever the time of its arrival. The antenna's place is among them (``lever_arm_b_m``).
    truth : Truth
        What really was, ten times a second unless told otherwise.
    start : dict of arrays
        The true state at the first inertial sample, for the ``start`` of :func:`insnav.run` (see :class:`insnav.Start`), with 0.1 m,
        0.02 m/s and 0.1° as its standard deviations. :meth:`Scenario.start` gives others, and such as are wrong by chance.
    """

    scenario: Scenario
    seed: int
    arrays: dict[str, Any]
    truth: Truth
    start: dict[str, Floats]

    def __repr__(self) -> str:
        return f"<insnav.sim.Simulation: seed {self.seed} of {self.scenario!r}>"
