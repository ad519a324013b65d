"""Strapdown navigation: samples to increments, increments to position, velocity and attitude.

In SI units and radians, as in the core. ``n`` is north-east-down, ``b`` is forward-right-down; sensor errors are taken out before.

Examples
--------
>>> import numpy as np
>>> from insnav.mechanization import NavState, increments, mechanize
>>> t = np.arange(501) * 0.01
>>> rate, force = np.zeros((501, 3)), np.tile([0.0, 0.0, -9.8], (501, 1))
>>> steps = increments(t, rate, force)
>>> way = mechanize(NavState.from_degrees(50.0, 14.0, 300.0), steps.dt, steps.rotation_b, steps.velocity_b)
>>> len(way), float(way.time_s[-1])
(500, 5.0)
"""

from insnav._insnav import NavState, increments, increments_of_sums, mechanize
from insnav._mechanization import Increments, Trajectory

__all__ = ["Increments", "NavState", "Trajectory", "increments", "increments_of_sums", "mechanize"]
