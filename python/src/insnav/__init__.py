"""INS/GNSS navigation from recorded IMU and GNSS data, with honest uncertainty.

Five minutes
------------
A log (MCAP, with ROS 2, ROS 1, JSON or protobuf messages) or arrays in, a trajectory out. Here a unit that stands for a minute, with a
fix a second; of a log, ``insnav.run("drive.mcap")`` is all.

>>> import numpy as np
>>> import insnav
>>> rng = np.random.default_rng(0)
>>> t = np.arange(0.0, 60.0, 0.01)
>>> gyro = rng.normal(0.0, 2e-4, (6000, 3))
>>> accel = [0.0, 0.0, -9.81] + rng.normal(0.0, 2e-2, (6000, 3))
>>> fix_t = np.arange(60.0)
>>> fixes = [48.0, 11.0, 500.0] + rng.normal(0.0, 1.0, (60, 3)) * [9e-6, 13e-6, 1.0]
>>> arrays = {
...     "imu": (t, gyro, accel),
...     "gnss_position": (fix_t, fixes, [1.0, 1.0, 1.0]),
...     "gnss_velocity": (fix_t, rng.normal(0.0, 0.05, (60, 3)), [0.05, 0.05, 0.05]),
... }
>>> config = {"gnss": {"lever_arm_b_m": [0.4, 0.0, -1.2]}, "alignment": {"heading_deg": 40.0}}
>>> solution = insnav.run(arrays, config)
>>> solution
<insnav.Solution: 3000 epochs, 0.000 s to 59.980 s>

Every column is a numpy array with one row an epoch, and its uncertainty beside it:

>>> bool(abs(solution.roll_deg[-1]) < 3 * solution.sigma_attitude_n_deg[-1, 0])
True
>>> solution.sigma_position_n_m.shape
(3000, 3)

What was found besides is in ``solution.stops`` (the vehicle stood), ``solution.updates`` (every measurement, with its normalised innovation
squared) and ``solution.summary`` (the keys of ``insnav run --format json``):

>>> len(solution.stops)
1

The solution is where the unit is, 1.2 m below the antenna:

>>> round(solution.summary["final"]["height_m"])
499

The same from the shell, which ``pip install`` has put there too: ``insnav run drive.mcap``; ``insnav info drive.mcap`` tells what is in a
log and what is wrong with it, ``insnav demo`` makes one to play with.

Conventions
-----------
Frames are letters at the end of a name: ``n`` is north-east-down, ``b`` is forward-right-down (the body), ``e`` is Earth-centred and
Earth-fixed, ``i`` is inertial. Units follow them: ``velocity_n_m_per_s``. Angles are in degrees here, heading is clockwise from true north,
heights are above the ellipsoid (WGS-84). Seconds count from the zero of the data, ``Solution.t0_ns``; of arrays they are those of their
stamps. An accelerometer reads (0, 0, -g) at rest and level. What the sensor adds is bias: measured = true + bias + noise. What the
filters estimate of their errors is true - estimate, as a small rotation in ``n`` for attitudes; :func:`compare` tells solution - reference. The modules for filters of all kinds, such as :mod:`insnav.noise`, and
the arrays of :func:`ahrs` are in SI units and radians.

Arrays are whatever ``numpy.asarray`` takes, with one row a stamp: (n,), (n, 3). What does not fit is an :class:`InsnavError`, whose class
says what is wrong and whose message says which argument, what it is and what it should be. Long calls leave the interpreter to other
threads and end at once on Ctrl-C. They begin with a copy of what they were given, which may be changed meanwhile; but :mod:`insnav.earth`,
:mod:`insnav.attitude`, :mod:`insnav.mechanization` and ``Eskf.propagate`` read float64 that lies row by row where it lies, without a copy: no other
thread must change such an array before the call has returned.
"""

from typing import TYPE_CHECKING, Any

from insnav._arrays import Arrays, Start
from insnav._attitude import AttitudeEpoch, Attitudes
from insnav._compare import Comparison
from insnav._errors import (
    AlignmentError,
    ArgumentError,
    ConfigError,
    IdentificationError,
    InsnavError,
    InsnavWarning,
    LogError,
    NavigationError,
)
from insnav._insnav import AttitudeFilter, Eskf, Navigator, Orientation, __version__, ahrs, compare, read_mcap, read_solution, run, write_mcap
from insnav._navigator import Event
from insnav._recording import Recording
from insnav._solution import Epoch, Solution, Stops, Updates, Withheld

if TYPE_CHECKING:
    from insnav import align, attitude, batch, earth, filter, mechanization, noise, sim, stationary

__all__ = [
    "AlignmentError",
    "ArgumentError",
    "Arrays",
    "AttitudeEpoch",
    "AttitudeFilter",
    "Attitudes",
    "Comparison",
    "ConfigError",
    "Epoch",
    "Eskf",
    "Event",
    "IdentificationError",
    "InsnavError",
    "InsnavWarning",
    "LogError",
    "NavigationError",
    "Navigator",
    "Orientation",
    "Recording",
    "Solution",
    "Start",
    "Stops",
    "Updates",
    "Withheld",
    "__version__",
    "ahrs",
    "align",
    "attitude",
    "batch",
    "compare",
    "earth",
    "filter",
    "mechanization",
    "noise",
    "read_mcap",
    "read_solution",
    "run",
    "sim",
    "stationary",
    "write_mcap",
]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        # Modules are loaded when somebody asks for them: all of them would double the time of the import.
        if name in __all__:
            from importlib import import_module

            return import_module(f"insnav.{name}")
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
