"""Drives that nobody drove: what an inertial unit and a GNSS receiver would have said, and what really was.

A :class:`Scenario` is plain data (route, body, inertial unit, receiver) with the keys of the file of ``insnav simulate``; ``EXAMPLE`` is
such a file with every key explained. Trajectories are closed forms, exact at every instant. Every random number follows from a seed:
the same scenario and seed give the same bits as the command.

:func:`kozadaev2017`, :func:`lobusov2014` and :func:`belokurov2018` make published experiments again, as ``insnav reproduce`` does.
"""

from insnav._insnav import SCENARIO_EXAMPLE as EXAMPLE
from insnav._insnav import Scenario, belokurov2018, gauss_markov, kozadaev2017, lobusov2014, white_noise
from insnav._sim import Simulation, Truth

__all__ = [
    "EXAMPLE",
    "Scenario",
    "Simulation",
    "Truth",
    "belokurov2018",
    "gauss_markov",
    "kozadaev2017",
    "lobusov2014",
    "white_noise",
]
