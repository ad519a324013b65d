"""What :func:`insnav.run` returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas
    import polars
    import xarray

    from insnav._frames import TimeIndex
    from insnav._plot import Plots

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Updates:
    """Measurements as the filter saw them: one row a measurement, in the order in which it took them.

    Attributes
    ----------
    time_s : (m,)
        Instants, on the scale of the solution's ``time_s``, s.
    measurement : (m,) of str
        Names of the measurement models: ``"gnss_position"``, ``"zero_velocity"``, ….
    dof : (m,) of int64
        Numbers of components, 1 to 3.
    residual : (m, 3)
        Measured minus predicted, in the unit of the measurement (m, m/s or rad); 0 beyond ``dof``.
    sigma : (m, 3)
        Standard deviations of the residual as predicted; 0 beyond ``dof``.
    nis : (m,)
        Normalised innovation squared rᵀ S⁻¹ r; its mean over a consistent run is ``dof``.
    verdict : (m,) of str
        ``"accepted"``; ``"inflated"``: used with its covariance enlarged; ``"rejected"``: not used; ``"reset"``: used after the filter's
        own uncertainty was widened; ``"frozen"``: not used, the receiver repeats itself.
    """

    time_s: Floats
    measurement: NDArray[np.str_]
    dof: NDArray[np.int64]
    residual: Floats
    sigma: Floats
    nis: Floats
    verdict: NDArray[np.str_]

    def to_pandas(self) -> pandas.DataFrame:
        """A row a measurement, components of residual and sigma in columns ``residual_0`` to ``sigma_2`` (needs pandas)."""
        from insnav import _frames

        return _frames.table_of_updates(self)

    def to_polars(self) -> polars.DataFrame:
        """The same for polars."""
        from insnav import _frames

        return _frames.polars_of_updates(self)

    def __len__(self) -> int:
        return len(self.time_s)

    def __repr__(self) -> str:
        names, counts = np.unique(self.measurement, return_counts=True)
        told = ", ".join(f"{count} {name}" for name, count in zip(names, counts, strict=True))
        return f"<insnav.Updates: {told or 'none'}>"


def _none(*shape: int, dtype: Any = np.float64) -> Any:
    return field(default_factory=lambda: np.empty(shape, dtype=dtype))


@dataclass(frozen=True, eq=False, repr=False)
class Withheld:
    """Fixes that ``withhold`` kept from the filter: one row a position, of the antenna.

    Attributes
    ----------
    time_s : (w,)
        Instants, on the scale of the solution's ``time_s``, s.
    time_ns : (w,) of int64
        The same on the clock of the GNSS positions, ns, exact.
    latitude_deg, longitude_deg, height_m : (w,)
        Position (WGS-84, above the ellipsoid).
    sigma_position_n_m : (w, 3)
        Standard deviation as the receiver states it, north-east-down, m; NaN where it states none.
    """

    time_s: Floats = _none(0)
    time_ns: NDArray[np.int64] = _none(0, dtype=np.int64)
    latitude_deg: Floats = _none(0)
    longitude_deg: Floats = _none(0)
    height_m: Floats = _none(0)
    sigma_position_n_m: Floats = _none(0, 3)

    def __len__(self) -> int:
        return len(self.time_s)

    def __repr__(self) -> str:
        return f"<insnav.Withheld: {len(self)} fixes>"


@dataclass(frozen=True, eq=False, repr=False)
class Stops:
    """Stops as the run found and used them: one row a stop. What is not known of them is NaN (see :attr:`Solution.stops`).

    Attributes
    ----------
    begin_s, end_s : (k,)
        Begin and end, on the scale of the solution's ``time_s``, s.
    held_from_s : (k,)
        From when on the filter made use of it, s.
    mode : (k,) of str
        How it was held: ``"static"``, ``"heading_hold"``, …; empty where that is not known.
    heading_deg, sigma_heading_deg : (k,)
        Heading at its end and its standard deviation, degrees.
    heading_growth_deg : (k,)
        By how much the heading left the one that was held, degrees.
    """

    begin_s: Floats
    end_s: Floats
    held_from_s: Floats
    mode: NDArray[np.str_]
    heading_deg: Floats
    sigma_heading_deg: Floats
    heading_growth_deg: Floats

    def to_pandas(self) -> pandas.DataFrame:
        """A row a stop (needs pandas)."""
        from insnav import _frames

        return _frames.table_of_stops(self)

    def __len__(self) -> int:
        return len(self.begin_s)

    def __repr__(self) -> str:
        return f"<insnav.Stops: {len(self)}, {float(np.sum(self.end_s - self.begin_s)):.1f} s in all>"


@dataclass(frozen=True, eq=False)
class Epoch:
    """The solution at one instant. Names, units and frames are those of :class:`Solution`'s columns, one row of each."""

    time_s: float
    time_ns: int
    latitude_deg: float
    longitude_deg: float
    height_m: float
    velocity_n_m_per_s: Floats
    quaternion_nb_wxyz: Floats
    roll_deg: float
    pitch_deg: float
    heading_deg: float
    rate_b_deg_per_s: Floats
    gyro_bias_deg_per_hour: Floats
    accel_bias_mg: Floats
    sigma_position_n_m: Floats
    sigma_velocity_n_m_per_s: Floats
    sigma_attitude_n_deg: Floats
    sigma_gyro_bias_deg_per_hour: Floats
    sigma_accel_bias_mg: Floats
    position_covariance_n_m2: Floats
    velocity_covariance_n_m2_per_s2: Floats
    attitude_covariance_n_rad2: Floats
    standing: bool
    standing_s: float
    stop_ratios: Floats


@dataclass(frozen=True, eq=False, repr=False)
class Solution:
    """A trajectory with its uncertainty: one row an epoch, every column a numpy array.

    Positions are those of the IMU, or of the point that ``output.lever_arm_b_m`` names. ``n`` is north-east-down at the epoch's position,
    ``b`` forward-right-down.

    Attributes
    ----------
    time_s : (n,)
        Time since ``t0_ns``, s.
    time_ns : (n,) of int64
        Time on the clock of the GNSS positions, ns, exact.
    latitude_deg, longitude_deg : (n,)
        Geodetic latitude and longitude (WGS-84), degrees.
    height_m : (n,)
        Height above the ellipsoid, m.
    velocity_n_m_per_s : (n, 3)
        Velocity over ground, north-east-down, m/s.
    quaternion_nb_wxyz : (n, 4)
        Unit quaternion that takes vectors from b to n (w, x, y, z).
    roll_deg : (n,)
        Roll, right side down positive, degrees.
    pitch_deg : (n,)
        Pitch, nose up positive, degrees.
    heading_deg : (n,)
        Heading, clockwise from true north, 0 to 360 degrees.
    rate_b_deg_per_s : (n, 3)
        Turn rate of the body against n, body axes, degrees per second.
    gyro_bias_deg_per_hour : (n, 3)
        Gyro bias (measured minus true), body axes, degrees per hour.
    accel_bias_mg : (n, 3)
        Accelerometer bias (measured minus true), body axes, thousandths of 9.80665 m/s².
    sigma_position_n_m : (n, 3)
        Standard deviation of the position, north-east-down, m.
    sigma_velocity_n_m_per_s : (n, 3)
        Standard deviation of the velocity, north-east-down, m/s.
    sigma_attitude_n_deg : (n, 3)
        Standard deviation of the attitude as a small rotation about north, east and down, degrees. The last column is the standard
        deviation of the heading.
    sigma_gyro_bias_deg_per_hour : (n, 3)
        Standard deviation of the gyro bias, degrees per hour.
    sigma_accel_bias_mg : (n, 3)
        Standard deviation of the accelerometer bias, thousandths of 9.80665 m/s².
    position_covariance_n_m2 : (n, 3, 3)
        Covariance of the position, north-east-down, m².
    velocity_covariance_n_m2_per_s2 : (n, 3, 3)
        Covariance of the velocity, north-east-down, m²/s².
    attitude_covariance_n_rad2 : (n, 3, 3)
        Covariance of the attitude as a small rotation about north, east and down, rad².
    standing : (n,) of bool
        Whether the body was found to stand.
    standing_s : (n,)
        How long the body has been standing, s; 0 when it moves. What a stop turns out to be only after a while is counted from its
        begin.
    stop_ratios : (n, 4)
        What the detector of stops saw of specific force, variation of the angular rate, mean angular rate and speed, each over its
        threshold: all below 1 speak for a stop. NaN where there is nothing to judge.
    t0_ns : int
        Instant from which ``time_s`` counts, ns on the clock of the GNSS positions.
    updates : Updates
        Measurements as the filter saw them.
    summary : dict
        What the run has to tell, with the keys of ``insnav run --format json``: start, stops, what became of measurements, the last
        epoch, warnings, the settings as used.
    withheld : Withheld
        Fixes that ``withhold`` kept from the filter; data frames have none of them.
    """

    time_s: Floats
    time_ns: NDArray[np.int64]
    latitude_deg: Floats
    longitude_deg: Floats
    height_m: Floats
    velocity_n_m_per_s: Floats
    quaternion_nb_wxyz: Floats
    roll_deg: Floats
    pitch_deg: Floats
    heading_deg: Floats
    rate_b_deg_per_s: Floats
    gyro_bias_deg_per_hour: Floats
    accel_bias_mg: Floats
    sigma_position_n_m: Floats
    sigma_velocity_n_m_per_s: Floats
    sigma_attitude_n_deg: Floats
    sigma_gyro_bias_deg_per_hour: Floats
    sigma_accel_bias_mg: Floats
    position_covariance_n_m2: Floats
    velocity_covariance_n_m2_per_s2: Floats
    attitude_covariance_n_rad2: Floats
    standing: NDArray[np.bool_]
    standing_s: Floats
    stop_ratios: Floats
    t0_ns: int
    updates: Updates
    summary: dict[str, Any]
    withheld: Withheld = field(default_factory=Withheld)

    def __len__(self) -> int:
        return len(self.time_s)

    def __repr__(self) -> str:
        if not len(self):
            return "<insnav.Solution: no epochs>"
        return f"<insnav.Solution: {len(self)} epochs, {self.time_s[0]:.3f} s to {self.time_s[-1]:.3f} s>"

    def __getitem__(self, rows: slice) -> Solution:
        """A part of it: ``solution[100:200]``, ``solution[::10]``; the columns are views of those of the whole.

        Measurements and withheld fixes are those from its first epoch to its last. ``t0_ns`` and the summary stay, so that :attr:`stops`
        are those of the whole run.
        """
        if not isinstance(rows, slice):
            raise TypeError(f"a solution is cut by slices, such as solution[100:200], not by {type(rows).__name__}; epoch(t) is one of its epochs")
        if rows.step is not None and rows.step < 1:
            raise ValueError(f"a solution goes forward in time: a step of {rows.step}, expected 1 or more")
        columns = {name: getattr(self, name)[rows] for name in COLUMNS}
        time_s = columns["time_s"]

        def within(table: Any) -> dict[str, Any]:
            kept = (table.time_s >= time_s[0]) & (table.time_s <= time_s[-1]) if len(time_s) else np.zeros(len(table), dtype=bool)
            return {part.name: getattr(table, part.name)[kept] for part in fields(table)}

        return replace(self, **columns, updates=Updates(**within(self.updates)), withheld=Withheld(**within(self.withheld)))

    @property
    def plot(self) -> Plots:
        """Figures of this solution (needs matplotlib): ``solution.plot.trajectory()``, see :class:`Plots`."""
        from insnav._plot import Plots

        return Plots(self)

    def to_pandas(self, time: TimeIndex = "s") -> pandas.DataFrame:
        """A data frame with one row an epoch and one number a column (needs pandas).

        Columns are named as in the topic ``/insnav/state`` of a solution's file, units at their ends: ``velocity_north_m_per_s``, ``q_nb_w``,
        ``gyro_bias_x_deg_per_hour`` (x forward, y right, z down), ``sigma_north_m``, ``position_covariance_ne_m2`` (the upper triangle).

        Parameters
        ----------
        time : {"s", "utc"}
            The index: ``time_s``, or instants in UTC, which is the clock of GNSS positions in recorded logs.

        Returns
        -------
        pandas.DataFrame
            :meth:`from_pandas` makes the same solution of it, to the last bit.

        Raises
        ------
        ImportError
            pandas is not installed.
        """
        from insnav import _frames

        return _frames.to_pandas(self, time)

    @classmethod
    def from_pandas(
        cls, frame: pandas.DataFrame, updates: pandas.DataFrame | None = None, *, summary: Mapping[str, Any] | None = None
    ) -> Solution:
        """The solution that :meth:`to_pandas` made a data frame of, or any rows of it.

        Parameters
        ----------
        frame : pandas.DataFrame
            All columns of :meth:`to_pandas`, rows in the order of ``time_ns``, each instant once; other columns are left out.
        updates : pandas.DataFrame, optional
            Of :meth:`Updates.to_pandas`.
        summary : mapping, optional
            The summary, which is in no column.

        Raises
        ------
        ArgumentError
            Columns are missing, or rows are out of order or double.
        """
        from insnav import _frames

        return _frames.from_pandas(frame, updates, summary)

    def to_polars(self, time: TimeIndex = "s") -> polars.DataFrame:
        """As :meth:`to_pandas`, for polars, which has no index: ``time="utc"`` puts a column ``time`` before the others (needs polars)."""
        from insnav import _frames

        return _frames.to_polars(self, time)

    @classmethod
    def from_polars(
        cls, frame: polars.DataFrame, updates: polars.DataFrame | None = None, *, summary: Mapping[str, Any] | None = None
    ) -> Solution:
        """As :meth:`from_pandas`, of what :meth:`to_polars` and :meth:`Updates.to_polars` made."""
        from insnav import _frames

        return _frames.from_polars(frame, updates, summary)

    def to_xarray(self, time: TimeIndex = "s") -> xarray.Dataset:
        """A dataset with the columns as they are, vectors and matrices whole (needs xarray).

        Each has its unit (as UDUNITS spells it) and what it is in its attributes. Axes are ``time``, ``ned`` (and ``ned_too`` of covariances), ``frd``,
        ``wxyz``, ``evidence`` (of ``stop_ratios``), and of the measurements, ``update_nis`` and so on, ``update`` and ``component`` (of their
        residuals and sigmas). ``t0_ns`` and the summary, as JSON, are attributes of
        the dataset.

        Parameters
        ----------
        time : {"s", "utc"}
            The coordinate ``time``: seconds as ``time_s``, or ``datetime64`` in UTC, which is the clock of GNSS positions in recorded logs.
        """
        from insnav import _frames

        return _frames.to_xarray(self, time)

    @classmethod
    def from_xarray(cls, dataset: xarray.Dataset) -> Solution:
        """The solution that :meth:`to_xarray` made a dataset of, or any part of it in time."""
        from insnav import _frames

        return _frames.from_xarray(dataset)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns, in the order in which they are documented."""
        return COLUMNS

    @property
    def stops(self) -> Stops:
        """Stops as the run found and used them; all that is known of each is in ``summary["stops"]``.

        A solution whose summary tells of none, because it was read from a file, made of a frame or taken from a :class:`Navigator`, has
        those of its columns ``standing`` and ``standing_s``: begins as they were, ends to one epoch, a stop with gaps as several.
        Everything else about them is not known: NaN, and ``mode`` empty.
        """
        rows = self.summary.get("stops")
        if rows is None:
            return self._stops_of_columns()

        def floats(key: str) -> Floats:
            return np.array([row[key] for row in rows], dtype=np.float64)

        return Stops(
            begin_s=floats("begin_s"),
            end_s=floats("end_s"),
            held_from_s=floats("held_from_s"),
            mode=np.array([row["mode"] for row in rows], dtype=np.str_),
            heading_deg=floats("heading_after_deg"),
            sigma_heading_deg=floats("sigma_heading_deg"),
            heading_growth_deg=floats("heading_growth_deg"),
        )

    def _stops_of_columns(self) -> Stops:
        standing = self.standing.astype(bool)
        # At an epoch that stands, after one that does not or that stood for longer: another stop.
        begins = standing.copy()
        begins[1:] &= ~standing[:-1] | (np.diff(self.standing_s) < 0)
        ends = standing.copy()
        ends[:-1] &= ~standing[1:] | begins[1:]
        last = np.flatnonzero(ends)
        unknown = np.full(len(last), np.nan)
        return Stops(
            begin_s=self.time_s[last] - self.standing_s[last],
            end_s=self.time_s[last],
            held_from_s=unknown,
            mode=np.full(len(last), "", dtype=np.str_),
            heading_deg=unknown.copy(),
            sigma_heading_deg=unknown.copy(),
            heading_growth_deg=unknown.copy(),
        )

    def epoch(self, time_s: float) -> Epoch:
        """The epoch that is nearest to an instant.

        Nothing is interpolated: ``epoch(t).time_s`` says which one it is.

        Parameters
        ----------
        time_s : float
            Instant, on the scale of ``time_s``, s.

        Returns
        -------
        Epoch
            One row of every column.

        Raises
        ------
        IndexError
            Outside of the solution, by more than the distance of its epochs.
        """
        if not len(self):
            raise IndexError("epoch: the solution has no epochs")
        first, last = self.time_s[0], self.time_s[-1]
        reach = (last - first) / max(len(self) - 1, 1)
        if not first - reach <= time_s <= last + reach:
            raise IndexError(f"epoch: {time_s} s is outside of the solution, which has {first:.3f} s to {last:.3f} s")
        after = min(max(int(np.searchsorted(self.time_s, time_s)), 1), max(len(self) - 1, 1))
        row = after if len(self) > 1 and self.time_s[after] - time_s <= time_s - self.time_s[after - 1] else after - 1

        def value(name: str) -> Any:
            entry = getattr(self, name)[row]
            # An array of its own, so that one epoch does not keep the whole solution alive.
            return entry.copy() if entry.ndim else entry.item()

        return Epoch(**{name: value(name) for name in COLUMNS})


#: Columns with one row an epoch.
COLUMNS: tuple[str, ...] = tuple(f.name for f in fields(Epoch))
