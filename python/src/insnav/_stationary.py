"""What the functions of `insnav.stationary` return."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Witness = Literal["nobody", "detector", "declared", "interval"]


@dataclass(frozen=True, eq=False)
class Statistic:
    """A detector's statistic over windows that slide by one sample.

    Attributes
    ----------
    detector : str
        Which one.
    value : (n,)
        T of the window that ends with each sample; NaN before the first window is full.
    threshold : float
        Quantile of T at rest: below it a window speaks for a stop. NaN where no window is full.
    window : int
        Samples in a window.
    """

    detector: Literal["mv", "mag", "are", "glrt"]
    value: Floats
    threshold: float
    window: int

    @property
    def standing(self) -> NDArray[np.bool_]:
        """Whether each window speaks for a stop, shape (n,)."""
        return np.asarray(self.value < self.threshold)


@dataclass(frozen=True, eq=False, repr=False)
class StopIntervals:
    """Stops of a record, and what spoke for them.

    Attributes
    ----------
    begin_s, end_s : (k,)
        Begin, before it was believed, and end of each stop, s. The end comes half a second before motion is seen, as a filter needs it.
    witness : tuple of str
        Who said so: ``"detector"``, ``"declared"`` or ``"interval"``.
    lasts : (k,) of bool
        Whether it lasts to the end of the record.
    ratios : (k, 4)
        Statistics over their thresholds when it was believed: specific force, angular rate, mean rate, speed; all below 1 speak for a
        stop, NaN where there is nothing to judge.
    time_s : (n,)
        Stamps of the inertial samples, s.
    standing : (n,) of bool
        Whether each lies in a stop.
    sample_ratios : (n, 4)
        The ratios as of each sample.
    """

    begin_s: Floats
    end_s: Floats
    witness: tuple[Witness, ...]
    lasts: NDArray[np.bool_]
    ratios: Floats
    time_s: Floats
    standing: NDArray[np.bool_]
    sample_ratios: Floats

    def __len__(self) -> int:
        return len(self.begin_s)

    def __repr__(self) -> str:
        return f"<insnav.stationary.StopIntervals: {len(self)}, {float(np.sum(self.end_s - self.begin_s)):.1f} s in all>"
