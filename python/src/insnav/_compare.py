"""What `insnav.compare` returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from insnav._attitude import AttitudeEpoch
from insnav._frames import COLUMNS, columns_of_frame
from insnav._sim import Truth
from insnav._solution import Solution, Updates, Withheld

Floats = NDArray[np.float64]

#: Names that a comparison takes: those of all that this package gives out, whether it compares them or not.
KNOWN: tuple[str, ...] = tuple(
    dict.fromkeys(
        [
            *(column.name for column in COLUMNS),
            *(field.name for of in (Truth, Solution, AttitudeEpoch) for field in fields(of)),
            *(name for column in COLUMNS for name in column.flat),
            "moving",
            # The index of a data frame, and what a dataset has besides.
            "time",
            *(f"update_{field.name}" for field in fields(Updates)),
            *(f"withheld_{field.name}" for field in fields(Withheld)),
        ]
    )
)


def columns_of(given: Any) -> Mapping[str, Any] | None:
    """Columns by name, one number each joined to vectors and matrices; None of what has no columns to be counted."""
    found = columns_of_frame(given)
    if found is None:
        return None
    joined = dict(found)
    for column in COLUMNS:
        if column.name not in found and all(name in found for name in column.flat):
            joined[column.name] = column.join([np.asarray(found[name]) for name in column.flat])
    t0_ns = joined.get("t0_ns")
    if t0_ns is not None and np.ndim(t0_ns) == 1:
        # A data frame has it in every row.
        joined["t0_ns"] = int(np.asarray(t0_ns)[0]) if len(t0_ns) else 0
    return joined


@dataclass(frozen=True, eq=False)
class Comparison:
    """Errors of a solution against a reference, as numbers and instant by instant.

    Rows are the instants of the reference at which there is a solution. Errors are solution minus reference, NaN where one of the two has
    no such quantity.

    Attributes
    ----------
    summary : dict
        With the keys of ``insnav compare --format json``: ``all``, ``standing``, ``moving``, ``withheld``, each with root mean squares, NEES
        and coverage; ``stops``, ``outside``, ``warnings``, ….
    time_s : (n,)
        Instants, s from the solution's zero.
    position_error_n_m : (n, 3)
        North, east, down.
    velocity_error_n_m_per_s : (n, 3)
        North, east, down.
    attitude_error_n_deg : (n, 3)
        As a small rotation about north, east and down: solution = Exp(error) reference. NaN where the reference has no whole attitude.
    roll_pitch_heading_error_deg : (n, 3)
        Differences of the angles, between -180 and 180.
    sigma_position_n_m, sigma_velocity_n_m_per_s, sigma_attitude_n_deg : (n, 3)
        What the solution states of these errors, with the reference's own standard deviations where it states some.
    nees_position, nees_velocity, nees_attitude : (n,)
        eᵀP⁻¹e by the number of components; 1 on average where the stated covariance is right.
    standing : (n,) of bool
        Whether the body stands, by the reference or else by the solution's speed.
    """

    summary: dict[str, Any]
    time_s: Floats
    position_error_n_m: Floats
    velocity_error_n_m_per_s: Floats
    attitude_error_n_deg: Floats
    roll_pitch_heading_error_deg: Floats
    sigma_position_n_m: Floats
    sigma_velocity_n_m_per_s: Floats
    sigma_attitude_n_deg: Floats
    nees_position: Floats
    nees_velocity: Floats
    nees_attitude: Floats
    standing: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.time_s)

    def __repr__(self) -> str:
        of = self.summary["all"]
        names = ("horizontal_rms_m", "height_rms_m", "velocity_rms_m_per_s", "heading_rms_deg")
        numbers = [f"{name} {of[name]:.4g}" for name in names if of[name] is not None]
        return f"<insnav.Comparison: {', '.join([f'{len(self)} instants', *numbers])}>"
