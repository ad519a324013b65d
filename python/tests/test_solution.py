"""The columns of a solution, its measurements, stops and single epochs."""

from __future__ import annotations

import copy
import pickle
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from simulation import drive

import insnav


@pytest.fixture(scope="module")
def solution() -> insnav.Solution:
    arrays = drive(90.0).arrays(np.random.default_rng(3), gyro_white=2e-5, accel_white=2e-4)
    return insnav.run(arrays, {"imu": {"grade": "tactical"}, "gnss": {"lever_arm_b_m": [0, 0, 0]}})


def same(a: Any, b: Any) -> bool:
    """To the last bit, NaN included."""
    if isinstance(a, np.ndarray):
        return bool(a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes())
    if hasattr(a, "__dataclass_fields__"):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return bool(a == b)


@pytest.mark.parametrize("again", [copy.deepcopy, copy.copy, lambda s: pickle.loads(pickle.dumps(s))])
def test_copies_are_the_same_to_the_last_bit(solution: insnav.Solution, again: Any) -> None:
    other = again(solution)
    assert same(solution, other) and repr(other) == repr(solution)
    changed = copy.deepcopy(solution)
    changed.heading_deg[5] = np.nextafter(changed.heading_deg[5], 400.0)
    assert not same(solution, changed), "the comparison sees one bit"


def test_every_column_has_one_row_an_epoch(solution: insnav.Solution) -> None:
    assert len(solution) > 1000
    for name in solution.columns:
        assert len(getattr(solution, name)) == len(solution), name
    # The diagonal of the covariance is the square of the sigmas.
    diagonal = np.einsum("nii->ni", solution.position_covariance_n_m2)
    assert np.allclose(diagonal, solution.sigma_position_n_m**2, rtol=1e-12)


@pytest.mark.parametrize("rows", [slice(100, 400), slice(None, None, 10), slice(-50, None), slice(7, 8), slice(5, 5), slice(None)])
def test_a_slice_is_a_solution(solution: insnav.Solution, rows: slice) -> None:
    columns: dict[str, Any] = {f.name: np.arange(91) for f in fields(insnav.Withheld)}
    whole = replace(solution, withheld=insnav.Withheld(**columns))
    part = whole[rows]
    for name in solution.columns:
        assert same(np.ascontiguousarray(getattr(part, name)), np.ascontiguousarray(getattr(solution, name)[rows])), name
    assert part.t0_ns == solution.t0_ns and part.summary == solution.summary and len(part.stops) == len(solution.stops)
    for table, of_part in ((whole.updates, part.updates), (whole.withheld, part.withheld)):
        wanted = [i for i, t in enumerate(table.time_s) if len(part) and part.time_s[0] <= t <= part.time_s[-1]]
        for f in fields(type(table)):
            assert same(getattr(of_part, f.name), getattr(table, f.name)[wanted]), f.name
    if len(part):
        assert same(part.epoch(float(part.time_s[0])).quaternion_nb_wxyz, part.quaternion_nb_wxyz[0])
    assert same(pickle.loads(pickle.dumps(part)).updates, part.updates)


def test_what_is_no_slice_is_refused(solution: insnav.Solution) -> None:
    key: Any
    for key in (3, "time_s", [1, 2]):
        with pytest.raises(TypeError, match="cut by slices"):
            solution[key]
    with pytest.raises(ValueError, match="forward in time"):
        solution[::-1]


def test_an_epoch_is_the_nearest_row(solution: insnav.Solution) -> None:
    times = solution.time_s
    between = (times[:-1] + times[1:]) / 2
    asked = np.concatenate([times, between + 1e-4, between - 1e-4, [times[0] - 1e-3, times[-1] + 1e-3]])
    for t in np.random.default_rng(1).choice(asked, 300):
        row = int(np.argmin(np.abs(times - t)))
        epoch = solution.epoch(float(t))
        for name in solution.columns:
            assert np.array_equal(getattr(epoch, name), getattr(solution, name)[row], equal_nan=True), name
    assert isinstance(epoch.height_m, float) and isinstance(epoch.standing, bool)
    assert same(pickle.loads(pickle.dumps(epoch)), epoch)


@pytest.mark.parametrize("t", [-5.0, 1e9, float("nan")])
def test_there_is_no_epoch_outside(solution: insnav.Solution, t: float) -> None:
    with pytest.raises(IndexError, match="outside of the solution, which has"):
        solution.epoch(t)


def test_measurements_are_those_that_the_summary_counts(solution: insnav.Solution) -> None:
    u = solution.updates
    assert len(u) > 500 and u.residual.shape == u.sigma.shape == (len(u), 3)
    for told in solution.summary["aiding"]:
        here = u.measurement == told["name"]
        assert here.sum() == told["used"] + told["rejected"] + told["frozen"], told
        assert (u.verdict[here] == "rejected").sum() == told["rejected"], told
        assert np.isclose((u.nis / u.dof)[here].mean(), told["nis_mean"]), told
    # One component: the NIS follows from residual and sigma. Three: it is at least that of the worst.
    one = u.dof == 1
    assert np.allclose(u.nis[one], (u.residual[one, 0] / u.sigma[one, 0]) ** 2, rtol=1e-9)
    worst = np.max((u.residual[~one] / np.where(u.sigma[~one] > 0, u.sigma[~one], np.inf)) ** 2, axis=1)
    assert np.all(u.nis[~one] >= worst * (1 - 1e-9))
    assert 0.5 < np.mean(u.nis[u.measurement == "gnss_position"]) / 3 < 1.5


def test_stops_are_those_of_the_summary(solution: insnav.Solution) -> None:
    stops = solution.stops
    assert len(stops) == len(solution.summary["stops"]) >= 1
    assert stops.begin_s.tolist() == [s["begin_s"] for s in solution.summary["stops"]]
    # The drive stands for its first 20 s.
    assert abs(stops.end_s[0] - 20.0) < 1.0
    assert "1, " in repr(stops)


def test_rows_out_of_order_are_refused(solution: insnav.Solution) -> None:
    """An epoch would not be found by its time; rows that are left out are no matter."""
    pytest.importorskip("pandas")
    frame = solution.to_pandas()
    some = insnav.Solution.from_pandas(frame.iloc[::3])
    assert np.array_equal(some.time_ns, solution.time_ns[::3])
    doubled = frame.iloc[[0, 1, 1, 2]]
    for wrong, words in [(frame.iloc[::-1], "row 1 is before"), (doubled, "row 2 has the instant of the row before")]:
        with pytest.raises(insnav.ArgumentError, match=words) as caught:
            insnav.Solution.from_pandas(wrong)
        assert caught.value.code == "not_in_order"
    pytest.importorskip("xarray")
    dataset = solution.to_xarray()
    with pytest.raises(insnav.ArgumentError, match="dataset: row 1"):
        insnav.Solution.from_xarray(dataset.isel(time=slice(None, None, -1)))
