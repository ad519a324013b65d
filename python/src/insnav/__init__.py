"""INS/GNSS navigation from recorded IMU and GNSS data, with honest uncertainty.

Frames, units and signs: ``n`` is north-east-down, ``b`` is forward-right-down; units stand at the end of every name;
angles in degrees at this surface; heading is clockwise from true north. :mod:`insnav.noise`, for filters of all kinds, and the arrays of
:func:`ahrs` are in SI units.
"""

from insnav import noise
from insnav._arrays import Arrays, Start
from insnav._errors import InsnavError, InsnavWarning
from insnav._insnav import Orientation, Solution, __version__, ahrs, run

__all__ = ["Arrays", "InsnavError", "InsnavWarning", "Orientation", "Solution", "Start", "__version__", "ahrs", "noise", "run"]
