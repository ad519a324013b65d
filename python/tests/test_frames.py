"""Solutions as data frames and datasets, and back, to the last bit."""

from __future__ import annotations

import dataclasses
import sys
import warnings
from typing import Any

import numpy as np
import pytest
import simulation

import insnav
from insnav import _frames


@pytest.fixture(scope="module")
def solution() -> insnav.Solution:
    """Stands, drives, with bits that are easily lost: a negative zero, a NaN, an infinity, and stamps that need all of int64."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", insnav.InsnavWarning)
        arrays = simulation.drive(60.0).arrays(np.random.default_rng(1), start_s=1.7e9, gyro_white=1e-4, accel_white=1e-3)
        s = insnav.run(arrays, {"imu": {"grade": "industrial"}})
    velocity, ratios = s.velocity_n_m_per_s.copy(), s.stop_ratios.copy()
    velocity[3, 2], ratios[5, 1], ratios[6, 2] = -0.0, np.nan, np.inf
    return dataclasses.replace(s, velocity_n_m_per_s=velocity, stop_ratios=ratios)


def same(a: Any, b: Any) -> bool:
    return bool(a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes())


def assert_same(a: insnav.Solution, b: insnav.Solution, rows: slice = slice(None)) -> None:
    for name in a.columns:
        assert same(np.ascontiguousarray(getattr(a, name)[rows]), getattr(b, name)), name
    for field in dataclasses.fields(a.updates):
        ours, theirs = getattr(a.updates, field.name), getattr(b.updates, field.name)
        # The length of the longest name is no part of it.
        assert ours.tolist() == theirs.tolist() if ours.dtype.kind == "U" else same(ours, theirs), field.name
    assert a.t0_ns == b.t0_ns


@pytest.mark.parametrize("time", ["s", "utc"])
def test_pandas_and_back(solution: insnav.Solution, time: _frames.TimeIndex) -> None:
    pandas = pytest.importorskip("pandas")
    frame = solution.to_pandas(time)
    back = insnav.Solution.from_pandas(frame, solution.updates.to_pandas(), summary=solution.summary)
    assert_same(solution, back)
    assert back.summary == solution.summary and len(back.stops) == len(solution.stops) > 0
    assert len(insnav.Solution.from_pandas(frame).updates) == 0
    part = insnav.Solution.from_pandas(frame.iloc[100:200].assign(mine=1.0), solution.updates.to_pandas())
    assert_same(solution, part, slice(100, 200))
    # Seconds of today have steps of a quarter of a microsecond: no row alone tells the zero.
    for first in range(0, len(solution), 7):
        assert insnav.Solution.from_pandas(frame.iloc[first : first + 1]).t0_ns == solution.t0_ns
    if time == "s":
        assert frame.index.name == "time_s" and same(frame.index.to_numpy(), solution.time_s)
    else:
        assert isinstance(frame.index, pandas.DatetimeIndex) and str(frame.index.tz) == "UTC"
        assert frame.index[0] == pandas.Timestamp(solution.time_ns[0], tz="UTC")
        assert frame.loc[pandas.Timestamp(solution.time_ns[7], tz="UTC"), "time_s"] == solution.time_s[7]


@pytest.mark.parametrize("time", ["s", "utc"])
def test_polars_and_back(solution: insnav.Solution, time: _frames.TimeIndex) -> None:
    polars = pytest.importorskip("polars")
    frame = solution.to_polars(time)
    back = insnav.Solution.from_polars(frame, solution.updates.to_polars(), summary=solution.summary)
    assert_same(solution, back)
    assert_same(solution, insnav.Solution.from_polars(frame[100:200], solution.updates.to_polars()), slice(100, 200))
    assert frame.columns[0] == ("time_s" if time == "s" else "time")
    if time == "utc":
        assert frame["time"].dtype == polars.Datetime("ns", "UTC")
        assert same(frame["time"].to_physical().to_numpy(), solution.time_ns)


@pytest.mark.parametrize("time", ["s", "utc"])
def test_xarray_and_back(solution: insnav.Solution, time: _frames.TimeIndex) -> None:
    pytest.importorskip("xarray")
    dataset = solution.to_xarray(time)
    back = insnav.Solution.from_xarray(dataset)
    assert_same(solution, back)
    assert back.summary == solution.summary
    assert_same(solution, insnav.Solution.from_xarray(dataset.isel(time=slice(100, 200))), slice(100, 200))
    turned = dataset.transpose("ned", "frd", "time", ...)
    assert_same(solution, insnav.Solution.from_xarray(turned))
    east = dataset.velocity_n_m_per_s.sel(ned="east")
    assert same(np.ascontiguousarray(east.to_numpy()), solution.velocity_n_m_per_s[:, 1].copy())
    assert dataset.velocity_n_m_per_s.attrs == {
        "units": "m s-1",
        "long_name": "Velocity over ground, north-east-down, m/s.",
    }
    assert dataset.time.dtype.kind == ("f" if time == "s" else "M")


def test_flat_columns_are_named_as_in_the_file(solution: insnav.Solution) -> None:
    """Each number is what its name says: the table holds against names and attributes."""
    pytest.importorskip("pandas")
    frame = solution.to_pandas()
    for i, (direction, axis) in enumerate(zip(["north", "east", "down"], ["x", "y", "z"], strict=True)):
        assert same(frame[f"velocity_{direction}_m_per_s"].to_numpy(), solution.velocity_n_m_per_s[:, i].copy())
        assert same(frame[f"sigma_{direction}_m"].to_numpy(), solution.sigma_position_n_m[:, i].copy())
        assert same(frame[f"gyro_bias_{axis}_deg_per_hour"].to_numpy(), solution.gyro_bias_deg_per_hour[:, i].copy())
        assert np.array_equal(frame[f"position_covariance_{direction[0]}{direction[0]}_m2"], solution.position_covariance_n_m2[:, i, i])
    assert np.array_equal(frame["position_covariance_ne_m2"], solution.position_covariance_n_m2[:, 0, 1])
    assert np.array_equal(frame["sigma_heading_deg"], solution.sigma_attitude_n_deg[:, 2])
    # Every column of a solution is in the table, and every unit is that of the name.
    assert [column.name for column in _frames.COLUMNS] == list(solution.columns)
    ends = {"_deg": "degree", "_m": "m", "_s": "s", "_ns": "ns", "_m2": "m2", "_rad2": "rad2", "_per_hour": "degree h-1"}
    for column in _frames.COLUMNS:
        for end, unit in ends.items():
            if column.name.endswith(end) and "_per_s" not in column.name:
                assert column.unit == unit, column.name


def test_measurements_and_stops_are_tables_too(solution: insnav.Solution) -> None:
    pandas = pytest.importorskip("pandas")
    updates = solution.updates.to_pandas()
    assert updates.groupby("measurement").size().to_dict() == {
        name: int(np.sum(solution.updates.measurement == name)) for name in set(solution.updates.measurement.tolist())
    }
    assert same(updates["residual_1"].to_numpy(), solution.updates.residual[:, 1].copy())
    stops = solution.stops.to_pandas()
    assert isinstance(stops, pandas.DataFrame) and np.array_equal(stops["begin_s"], solution.stops.begin_s)


def test_says_what_is_missing(solution: insnav.Solution) -> None:
    pytest.importorskip("pandas")
    frame = solution.to_pandas()
    with pytest.raises(insnav.ArgumentError, match="frame: without the columns height_m, q_nb_w") as caught:
        insnav.Solution.from_pandas(frame.drop(columns=["height_m", "q_nb_w"]))
    assert caught.value.argument == "frame"
    with pytest.raises(insnav.ArgumentError, match="time: 'gps'"):
        solution.to_pandas("gps")  # type: ignore[arg-type]
    pytest.importorskip("xarray")
    with pytest.raises(insnav.ArgumentError, match="dataset: without height_m"):
        insnav.Solution.from_xarray(solution.to_xarray().drop_vars("height_m"))


@pytest.mark.parametrize("extra", ["pandas", "polars", "xarray"])
def test_a_package_that_is_not_there_is_named(
    extra: str, solution: insnav.Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, extra, None)
    with pytest.raises(ImportError, match=rf"pip install 'insnav\[{extra}\]'"):
        getattr(solution, f"to_{extra}")()


def test_a_figure_without_matplotlib_names_it(solution: insnav.Solution, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ImportError, match=r"pip install 'insnav\[plot\]'"):
        solution.plot.attitude()


def test_none_of_it_is_imported_with_the_package() -> None:
    import subprocess

    code = "import sys, insnav; print([m for m in ('pandas', 'polars', 'xarray', 'matplotlib', 'distributed', 'multiprocessing') if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"
