"""What `insnav.Navigator` tells besides its solution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Event:
    """Something worth telling that is neither an epoch nor a measurement.

    Attributes
    ----------
    time_s : float
        When, on the scale of the samples, s.
    kind : str
        ``"started"``, ``"stop_began"``, ``"stop_ended"``, ``"stop_not_fused"``, ``"imu_gap"``, ``"position_reset"``; samples that were not
        used: ``"too_late"``, ``"after_end"``, ``"duplicate_imu"``, ``"not_finite"``, ``"impossible"`` (a finite value that cannot be,
        such as a latitude of 120 degrees; ``details`` say ``what`` and ``why``); standing that was declared in vain:
        ``"standstill_contradicted"``, ``"standstill_flaps"``.
    details : dict
        Its numbers, with units in their names.
    """

    time_s: float
    kind: str
    details: dict[str, Any]
