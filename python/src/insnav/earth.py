"""The Earth: WGS-84 ellipsoid, positions on it, gravity and rates.

In SI units and radians, as in the core: positions are rows of latitude and longitude (rad) and height above the ellipsoid (m), ``n`` is
north-east-down. Every function takes one row or arrays of them with any leading axes, as arrays or what ``numpy.asarray`` takes; one row gives
one row. Arguments with one row go with all rows of the others. Errors are :class:`insnav.InsnavError` and name the argument.

``EARTH_RATE`` is in rad/s, ``SEMI_MAJOR_AXIS`` and ``SEMI_MINOR_AXIS`` in m ([WGS84] table 3.1).
"""

from insnav._insnav import (
    EARTH_RATE,
    ECCENTRICITY_SQUARED,
    FLATTENING,
    SEMI_MAJOR_AXIS,
    SEMI_MINOR_AXIS,
    LocalFrame,
    earth_rate_n,
    from_ecef,
    gravity,
    gravity_gradient,
    meridian_radius,
    ned_to_ecef,
    offset,
    offset_to,
    to_ecef,
    transport_rate_n,
    transverse_radius,
)

__all__ = [
    "EARTH_RATE",
    "ECCENTRICITY_SQUARED",
    "FLATTENING",
    "SEMI_MAJOR_AXIS",
    "SEMI_MINOR_AXIS",
    "LocalFrame",
    "earth_rate_n",
    "from_ecef",
    "gravity",
    "gravity_gradient",
    "meridian_radius",
    "ned_to_ecef",
    "offset",
    "offset_to",
    "to_ecef",
    "transport_rate_n",
    "transverse_radius",
]
