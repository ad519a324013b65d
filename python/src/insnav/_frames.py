"""Solutions as data frames of pandas and polars, and as datasets of xarray, and back.

One table says what each column of a solution is called where a column is one number, and in which unit it is.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from insnav._errors import ArgumentError
from insnav._optional import needs

if TYPE_CHECKING:
    import pandas
    import polars
    import xarray

    from insnav._solution import Solution, Stops, Updates

TimeIndex: TypeAlias = Literal["s", "utc"]

NED, XYZ = ("north", "east", "down"), ("x", "y", "z")
#: Where the upper triangle of a symmetric matrix is.
UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True)
class Column:
    """A column of a solution.

    Attributes
    ----------
    name : str
        Of the solution's attribute.
    flat : tuple of str
        A name for each of its numbers, as in the topic ``/insnav/state``.
    unit : str
        As UDUNITS spells it.
    dims : tuple of str
        Axes after time.
    """

    name: str
    flat: tuple[str, ...]
    unit: str
    dims: tuple[str, ...] = ()

    def split(self, values: NDArray[Any]) -> dict[str, NDArray[Any]]:
        """One array a number. Of a covariance the upper triangle, the rest being the same."""
        if not self.dims:
            return {self.flat[0]: values}
        if len(self.dims) == 2:
            return {name: values[:, i, j] for name, (i, j) in zip(self.flat, UPPER, strict=True)}
        return {name: values[:, i] for i, name in enumerate(self.flat)}

    def join(self, parts: list[NDArray[Any]]) -> NDArray[Any]:
        """The inverse."""
        if not self.dims:
            return np.ascontiguousarray(parts[0])
        if len(self.dims) == 2:
            matrix = np.empty((len(parts[0]), 3, 3))
            for part, (i, j) in zip(parts, UPPER, strict=True):
                matrix[:, i, j] = matrix[:, j, i] = part
            return matrix
        return np.ascontiguousarray(np.stack(parts, axis=1))


def _ned(pattern: str) -> tuple[str, ...]:
    return tuple(pattern.format(direction) for direction in NED)


def _xyz(pattern: str) -> tuple[str, ...]:
    return tuple(pattern.format(axis) for axis in XYZ)


def _covariance(pattern: str) -> tuple[str, ...]:
    return tuple(pattern.format("ned"[i] + "ned"[j]) for i, j in UPPER)


N, B = ("ned",), ("frd",)
MG = "9.80665e-3 m s-2"

COLUMNS = (
    Column("time_s", ("time_s",), "s"),
    Column("time_ns", ("time_ns",), "ns"),
    Column("latitude_deg", ("latitude_deg",), "degree"),
    Column("longitude_deg", ("longitude_deg",), "degree"),
    Column("height_m", ("height_m",), "m"),
    Column("velocity_n_m_per_s", _ned("velocity_{}_m_per_s"), "m s-1", N),
    Column("quaternion_nb_wxyz", ("q_nb_w", "q_nb_x", "q_nb_y", "q_nb_z"), "1", ("wxyz",)),
    Column("roll_deg", ("roll_deg",), "degree"),
    Column("pitch_deg", ("pitch_deg",), "degree"),
    Column("heading_deg", ("heading_deg",), "degree"),
    Column("rate_b_deg_per_s", _xyz("rate_{}_deg_per_s"), "degree s-1", B),
    Column("gyro_bias_deg_per_hour", _xyz("gyro_bias_{}_deg_per_hour"), "degree h-1", B),
    Column("accel_bias_mg", _xyz("accel_bias_{}_mg"), MG, B),
    Column("sigma_position_n_m", _ned("sigma_{}_m"), "m", N),
    Column("sigma_velocity_n_m_per_s", _ned("sigma_velocity_{}_m_per_s"), "m s-1", N),
    Column(
        "sigma_attitude_n_deg", ("sigma_rotation_north_deg", "sigma_rotation_east_deg", "sigma_heading_deg"), "degree", N
    ),
    Column("sigma_gyro_bias_deg_per_hour", _xyz("sigma_gyro_bias_{}_deg_per_hour"), "degree h-1", B),
    Column("sigma_accel_bias_mg", _xyz("sigma_accel_bias_{}_mg"), MG, B),
    Column("position_covariance_n_m2", _covariance("position_covariance_{}_m2"), "m2", ("ned", "ned_too")),
    Column(
        "velocity_covariance_n_m2_per_s2", _covariance("velocity_covariance_{}_m2_per_s2"), "m2 s-2", ("ned", "ned_too")
    ),
    Column("attitude_covariance_n_rad2", _covariance("attitude_covariance_{}_rad2"), "rad2", ("ned", "ned_too")),
    Column("standing", ("standing",), ""),
    Column("standing_s", ("standing_s",), "s"),
    Column(
        "stop_ratios",
        ("stop_specific_force_ratio", "stop_angular_rate_ratio", "stop_mean_rate_ratio", "stop_speed_ratio"),
        "1",
        ("evidence",),
    ),
)
#: What the axes are.
AXES = {
    "ned": NED,
    "ned_too": NED,
    "frd": ("forward", "right", "down"),
    "wxyz": ("w", "x", "y", "z"),
    "evidence": ("specific_force", "angular_rate", "mean_rate", "speed"),
}


def flat(solution: Solution) -> dict[str, NDArray[Any]]:
    """All columns as one array a number."""
    parts: dict[str, NDArray[Any]] = {}
    for column in COLUMNS:
        parts |= column.split(getattr(solution, column.name))
    # The same in all rows: seconds do not tell it to the nanosecond, and any rows are a solution again.
    parts["t0_ns"] = np.full(len(solution), solution.t0_ns, dtype=np.int64)
    return parts


def flat_updates(updates: Updates) -> dict[str, NDArray[Any]]:
    """Measurements as one array a number; of residual and sigma the components 0 to 2."""
    return {
        "time_s": updates.time_s,
        "measurement": updates.measurement,
        "dof": updates.dof,
        **{f"residual_{i}": updates.residual[:, i] for i in range(3)},
        **{f"sigma_{i}": updates.sigma[:, i] for i in range(3)},
        "nis": updates.nis,
        "verdict": updates.verdict,
    }


def solution_of(
    columns: Mapping[str, NDArray[Any]], updates: Mapping[str, NDArray[Any]] | None, summary: Mapping[str, Any] | None
) -> Solution:
    """The inverse of :func:`flat` and :func:`flat_updates`."""
    from insnav._solution import Solution, Updates, Withheld

    wanted = [*(name for column in COLUMNS for name in column.flat), "t0_ns"]
    missing = [name for name in wanted if name not in columns]
    if missing:
        raise ArgumentError(
            f"frame: without the columns {', '.join(missing)}",
            "missing_column",
            "give all that to_pandas or to_polars has made",
            argument="frame",
        )

    def of(column: Column) -> NDArray[Any]:
        wanted = {"time_ns": np.int64, "standing": np.bool_}.get(column.name, np.float64)
        return column.join([np.asarray(columns[name], dtype=wanted) for name in column.flat])

    values = {column.name: of(column) for column in COLUMNS}
    in_order(values["time_ns"], "frame")
    rows: Mapping[str, Any] = updates if updates is not None else {}

    def number(name: str, dtype: Any = np.float64) -> NDArray[Any]:
        return np.ascontiguousarray(np.asarray(rows.get(name, ()), dtype=dtype))

    return Solution(
        **values,
        t0_ns=int(np.asarray(columns["t0_ns"])[0]) if len(values["time_ns"]) else 0,
        updates=Updates(
            time_s=number("time_s"),
            measurement=number("measurement", np.str_),
            dof=number("dof", np.int64),
            residual=np.stack([number(f"residual_{i}") for i in range(3)], axis=1),
            sigma=np.stack([number(f"sigma_{i}") for i in range(3)], axis=1),
            nis=number("nis"),
            verdict=number("verdict", np.str_),
        ),
        summary=dict(summary or {}),
        withheld=Withheld(),
    )


def in_order(time_ns: NDArray[np.int64], argument: str) -> None:
    """Refuse rows of which one is not later than the one before: nothing would be found by its time."""
    wrong = np.flatnonzero(time_ns[1:] <= time_ns[:-1])
    if len(wrong):
        row = int(wrong[0]) + 1
        what = "has the instant of the row before" if time_ns[row] == time_ns[row - 1] else "is before the row before it"
        raise ArgumentError(
            f"{argument}: row {row} {what}, expected rows in the order of time_ns, each instant once",
            "not_in_order",
            "sort the rows by time_ns and drop those that come twice",
            argument=argument,
            received=f"time_ns {int(time_ns[row - 1])}, {int(time_ns[row])}",
            expected="time_ns that increases",
        )


def _dates(time_ns: NDArray[np.int64]) -> NDArray[np.datetime64]:
    return time_ns.astype("datetime64[ns]")


def _check(time: str) -> None:
    if time not in ("s", "utc"):
        raise ArgumentError(f'time: {time!r}, expected "s" or "utc"', "bad_option", argument="time", received=repr(time), expected='"s" or "utc"')


def to_pandas(solution: Solution, time: TimeIndex) -> pandas.DataFrame:
    """See `Solution.to_pandas`."""
    _check(time)
    pd = needs("pandas")
    frame: pandas.DataFrame = pd.DataFrame(flat(solution))
    if time == "s":
        return frame.set_index("time_s")
    return frame.set_index(pd.DatetimeIndex(_dates(solution.time_ns), tz="UTC", name="time"))


def from_pandas(frame: pandas.DataFrame, updates: pandas.DataFrame | None, summary: Mapping[str, Any] | None) -> Solution:
    """See `Solution.from_pandas`."""

    def arrays(table: pandas.DataFrame) -> dict[str, NDArray[Any]]:
        found = {str(name): table[name].to_numpy() for name in table.columns}
        if table.index.name == "time_s":
            found["time_s"] = table.index.to_numpy()
        return found

    return solution_of(arrays(frame), None if updates is None else arrays(updates), summary)


def columns_of_frame(given: Any) -> Mapping[str, Any] | None:
    """Columns of a mapping, a data frame or a dataset by their names; None of anything else."""
    if isinstance(given, Mapping):
        found = {str(name): given[name] for name in given}
        # A dataset has in its attributes what is one for all rows.
        attributes = getattr(given, "attrs", {})
        if "t0_ns" in attributes:
            found.setdefault("t0_ns", int(attributes["t0_ns"]))
            found.setdefault("summary", json.loads(attributes.get("summary", "{}")))
        return found
    module = type(given).__module__.partition(".")[0]
    if module not in ("pandas", "polars") or not hasattr(given, "columns"):
        return None
    found = {str(name): given[name].to_numpy() for name in given.columns}
    index = getattr(given, "index", None)
    if index is not None and index.name is not None:
        found.setdefault(str(index.name), index.to_numpy())
    return found


def to_polars(solution: Solution, time: TimeIndex) -> polars.DataFrame:
    """See `Solution.to_polars`."""
    _check(time)
    pl = needs("polars")
    frame: polars.DataFrame = pl.DataFrame({name: np.ascontiguousarray(values) for name, values in flat(solution).items()})
    if time == "utc":
        instants = pl.Series("time", _dates(solution.time_ns)).dt.replace_time_zone("UTC")
        frame.insert_column(0, instants)
    return frame


def from_polars(frame: polars.DataFrame, updates: polars.DataFrame | None, summary: Mapping[str, Any] | None) -> Solution:
    """See `Solution.from_polars`."""

    def arrays(table: polars.DataFrame) -> dict[str, NDArray[Any]]:
        return {name: table[name].to_numpy() for name in table.columns}

    return solution_of(arrays(frame), None if updates is None else arrays(updates), summary)


def to_xarray(solution: Solution, time: TimeIndex) -> xarray.Dataset:
    """See `Solution.to_xarray`."""
    _check(time)
    said = _documentation(type(solution))
    coordinate = (
        ("time", solution.time_s, {"units": "s", "long_name": said.get("time_s", "")})
        if time == "s"
        else ("time", _dates(solution.time_ns), {"long_name": "UTC, if that is what stamped the GNSS positions"})
    )
    data: dict[str, tuple[tuple[str, ...], NDArray[Any], dict[str, str]]] = {}
    for column in COLUMNS:
        attributes = {"units": column.unit} if column.unit else {}
        data[column.name] = (("time", *column.dims), getattr(solution, column.name), attributes | {"long_name": said.get(column.name, "")})
    updates = solution.updates
    for field in fields(updates):
        values = getattr(updates, field.name)
        data[f"update_{field.name}"] = (("update", "component")[: values.ndim], values, {})
    data["update_time_s"][2]["units"] = "s"
    for field in fields(solution.withheld):
        values = getattr(solution.withheld, field.name)
        data[f"withheld_{field.name}"] = (("fix", "ned")[: values.ndim], values, {})
    data["withheld_time_s"][2]["units"] = "s"
    axes = {name: list(labels) for name, labels in AXES.items()}
    dataset: xarray.Dataset = needs("xarray").Dataset(
        data,
        coords={"time": coordinate, **axes},
        attrs={"t0_ns": solution.t0_ns, "summary": json.dumps(solution.summary)},
    )
    return dataset


def from_xarray(dataset: xarray.Dataset) -> Solution:
    """See `Solution.from_xarray`."""
    from insnav._solution import Solution, Updates, Withheld

    missing = [column.name for column in COLUMNS if column.name not in dataset]
    if missing:
        raise ArgumentError(
            f"dataset: without {', '.join(missing)}", "missing_column", "give all that to_xarray has made", argument="dataset"
        )

    if "t0_ns" not in dataset.attrs:
        raise ArgumentError(
            "dataset: without the attribute t0_ns", "missing_column", "keep attributes (xarray.set_options(keep_attrs=True))", argument="dataset"
        )

    def array(name: str, dims: tuple[str, ...], dtype: Any = None) -> NDArray[Any]:
        return np.ascontiguousarray(dataset[name].transpose(*dims).to_numpy(), dtype=dtype)

    types = {"measurement": np.str_, "verdict": np.str_, "dof": np.int64}
    updates = {}
    for field in fields(Updates):
        name = f"update_{field.name}"
        if name in dataset:
            dims = ("update", "component")[: dataset[name].ndim]
            updates[field.name] = array(name, dims, types.get(field.name, np.float64))
        else:
            shape = (0, 3) if field.name in ("residual", "sigma") else (0,)
            updates[field.name] = np.empty(shape, dtype=types.get(field.name, np.float64))
    withheld = {
        field.name: array(f"withheld_{field.name}", ("fix", "ned")[: dataset[f"withheld_{field.name}"].ndim])
        for field in fields(Withheld)
        if f"withheld_{field.name}" in dataset
    }
    values = {column.name: array(column.name, ("time", *column.dims)) for column in COLUMNS}
    in_order(values["time_ns"], "dataset")
    return Solution(
        **values,
        t0_ns=int(dataset.attrs["t0_ns"]),
        updates=Updates(**updates),
        summary=json.loads(dataset.attrs.get("summary", "{}")),
        withheld=Withheld(**withheld),
    )


def _documentation(of: type) -> dict[str, str]:
    """What the class says of its attributes, in one line each."""
    said: dict[str, str] = {}
    names: list[str] = []
    for line in (of.__doc__ or "").split("Attributes", 1)[-1].splitlines():
        text = line.strip()
        if " : " in text and not text.endswith("."):
            names = text.split(" : ")[0].split(", ")
        elif text and not text.startswith("---"):
            for name in names:
                said[name] = f"{said[name]} {text}" if name in said else text
    return said


def table_of_updates(updates: Updates) -> pandas.DataFrame:
    """See `Updates.to_pandas`."""
    frame: pandas.DataFrame = needs("pandas").DataFrame(flat_updates(updates))
    return frame


def table_of_stops(stops: Stops) -> pandas.DataFrame:
    """See `Stops.to_pandas`."""
    frame: pandas.DataFrame = needs("pandas").DataFrame({field.name: getattr(stops, field.name) for field in fields(stops)})
    return frame


def polars_of_updates(updates: Updates) -> polars.DataFrame:
    """See `Updates.to_polars`."""
    columns = {name: np.ascontiguousarray(values) for name, values in flat_updates(updates).items()}
    frame: polars.DataFrame = needs("polars").DataFrame(columns)
    return frame
