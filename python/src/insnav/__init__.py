"""INS/GNSS navigation from recorded IMU and GNSS data, with honest uncertainty.

Frames, units and signs: ``n`` is north-east-down, ``b`` is forward-right-down; units stand at the end of every name;
angles in degrees at this surface; heading is clockwise from true north.
"""

from insnav._arrays import Arrays, Start
from insnav._errors import InsnavError, InsnavWarning
from insnav._insnav import Solution, __version__, run

__all__ = ["Arrays", "InsnavError", "InsnavWarning", "Solution", "Start", "__version__", "run"]
