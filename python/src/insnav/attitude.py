"""Attitude: rotation vectors, quaternions, Euler angles, matrices.

In radians. Quaternions are (w, x, y, z); ``q_nb`` takes vectors from b (forward-right-down) to n (north-east-down), letters cancel; they
need not be normalised. Every function takes one row or arrays of them with any leading axes, as arrays or what ``numpy.asarray`` takes; one
row gives one row, and goes with all rows of the others. Errors are :class:`insnav.InsnavError` and name the argument.
"""

from insnav._insnav import (
    exp,
    from_dcm,
    from_euler,
    inverse,
    left_jacobian,
    log,
    multiply,
    rotate,
    skew,
    to_dcm,
    to_euler,
    wrap_angle,
)

__all__ = [
    "exp",
    "from_dcm",
    "from_euler",
    "inverse",
    "left_jacobian",
    "log",
    "multiply",
    "rotate",
    "skew",
    "to_dcm",
    "to_euler",
    "wrap_angle",
]
