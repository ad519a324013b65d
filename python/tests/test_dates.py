"""Dates are instants, whoever made them: seconds count from ``t0_ns``, dates from nothing."""

from __future__ import annotations

import datetime as dt
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import insnav

pytestmark = pytest.mark.filterwarnings("ignore::insnav.InsnavWarning")

T0 = 1_750_000_000_000_000_000
N = 2000
START: insnav.Start = {
    "time_s": 0.0,
    "latitude_deg_longitude_deg_height_m": [50.0, 14.0, 300.0],
    "velocity_n_m_per_s": [0.0, 0.0, 0.0],
    "roll_deg_pitch_deg_heading_deg": [0.0, 0.0, 0.0],
    "sigma_position_n_m": [1.0, 1.0, 1.0],
    "sigma_velocity_n_m_per_s": [0.1, 0.1, 0.1],
    "sigma_attitude_n_deg": [1.0, 1.0, 1.0],
}


def naive(seconds: Any) -> Any:
    return (T0 + np.round(np.asarray(seconds) * 1e9).astype(np.int64)).astype("datetime64[ns]")


def of_python(zone: dt.tzinfo | None) -> Callable[[Any], Any]:
    def dates(seconds: Any) -> Any:
        zero = dt.datetime(1970, 1, 1, tzinfo=dt.timezone.utc)
        utc = [zero + dt.timedelta(microseconds=int(t) // 1000) for t in naive(seconds).astype(np.int64)]
        return [d.astimezone(zone) if zone else d.replace(tzinfo=None) for d in utc]

    return dates


def of_pandas(form: str) -> Callable[[Any], Any]:
    def dates(seconds: Any) -> Any:
        pandas = pytest.importorskip("pandas")
        there = pandas.DatetimeIndex(naive(seconds)).tz_localize("UTC").tz_convert("Asia/Tokyo")
        forms: dict[str, Any] = {"index": there, "series": pandas.Series(there), "objects": there.astype(object), "list": list(there)}
        return forms[form]

    return dates


FORMS = {
    "datetime64": naive,
    "python": of_python(None),
    "python, UTC": of_python(dt.timezone.utc),
    "python, +09:00": of_python(dt.timezone(dt.timedelta(hours=9))),
    **{f"pandas {form}": of_pandas(form) for form in ["index", "series", "objects", "list"]},
}
forms = pytest.mark.parametrize("dates", FORMS.values(), ids=FORMS.keys())


def standing() -> tuple[Any, Any, Any]:
    rng = np.random.default_rng(0)
    return np.arange(N) * 0.01, rng.normal(0, 2e-4, (N, 3)), [0, 0, -9.81] + rng.normal(0, 2e-2, (N, 3))


@forms
def test_t0_ns_moves_seconds_and_no_dates(dates: Callable[[Any], Any]) -> None:
    t, rates, forces = standing()
    by_seconds = insnav.run({"imu": (t, rates, forces), "t0_ns": T0}, imu_only=True)
    by_dates = insnav.run({"imu": (dates(t), rates, forces), "t0_ns": T0}, imu_only=True)
    assert by_seconds.t0_ns == by_dates.t0_ns == T0 and by_dates.time_s[0] == 0.0
    assert np.array_equal(by_dates.time_ns, by_seconds.time_ns)
    assert np.array_equal(by_dates.velocity_n_m_per_s, by_seconds.velocity_n_m_per_s)


@forms
def test_dates_of_two_kinds_are_one_clock(dates: Callable[[Any], Any]) -> None:
    """Inertial stamps of one kind, fixes of the other: counted twice, they would be 55 years apart."""
    t, rates, forces = standing()
    fixes = np.arange(0.0, 20.0)
    places = np.tile([48.0, 11.0, 500.0], (20, 1)) + np.random.default_rng(1).normal(0, 1, (20, 3)) * [9e-6, 13e-6, 1.0]
    config: Any = {"alignment": {"heading_deg": 40.0}, "gnss": {"lever_arm_b_m": [0.0, 0.0, 0.0]}}
    solution = insnav.run(
        {"imu": (dates(t), rates, forces), "gnss_position": (naive(fixes), places, [1.0, 1.0, 1.0]), "t0_ns": T0}, config
    )
    (position,) = (aid for aid in solution.summary["aiding"] if aid["name"] == "gnss_position")
    assert position["used"] == 20 and solution.t0_ns == T0


@forms
def test_a_navigator_takes_dates_as_they_are(dates: Callable[[Any], Any]) -> None:
    t, rates, forces = standing()
    by_seconds, by_dates = insnav.Navigator(start=START, t0_ns=T0), insnav.Navigator(start=START, t0_ns=T0)
    by_seconds.batch({"imu": (t, rates, forces)})
    by_dates.batch({"imu": (dates(t), rates, forces)})
    assert by_seconds.latest() == by_dates.latest() and by_dates.latest() is not None
    # One at a time.
    stepped = insnav.Navigator(start=START, t0_ns=T0)
    for date, rate, force in zip(dates(t), rates, forces):
        stepped.step_imu(date, rate, force)
    assert stepped.latest() == by_dates.latest()


@forms
def test_a_reference_with_dates_is_on_the_solution_s_clock(dates: Callable[[Any], Any]) -> None:
    drive = insnav.sim.Scenario.car_drive(70.0).simulate(3)
    solution, truth = insnav.run({**drive.arrays, "t0_ns": T0}), drive.truth
    places = {"latitude_deg": truth.latitude_deg, "longitude_deg": truth.longitude_deg, "height_m": truth.height_m}
    by_seconds = insnav.compare(solution, {"time_s": truth.time_s, **places})
    by_dates = insnav.compare(solution, {"time_s": dates(truth.time_s), **places})
    # Python's own dates are of whole microseconds, and so are the instants of this truth.
    assert len(by_dates) == len(by_seconds) > 100
    assert np.array_equal(by_dates.position_error_n_m, by_seconds.position_error_n_m, equal_nan=True)


def test_nanoseconds_of_pandas_are_kept() -> None:
    pandas = pytest.importorskip("pandas")
    t = [pandas.Timestamp(T0 + 10_000_001 * i, tz="UTC") for i in range(3)]
    step = insnav.mechanization.increments(t, np.zeros((3, 3)), np.zeros((3, 3))).dt
    assert np.allclose(step, 10_000_001e-9, rtol=1e-12)


def test_a_date_that_is_none_is_named() -> None:
    dates = [dt.datetime(2026, 1, 1, tzinfo=dt.timezone.utc), "soon"]
    with pytest.raises(insnav.ArgumentError, match="imu: time_s: cannot be read as times"):
        insnav.run({"imu": (dates, np.zeros((2, 3)), np.zeros((2, 3)))}, imu_only=True)


def test_zones_are_read_without_a_warning_of_numpy() -> None:
    """An error where warnings are errors, as under ``python -W error``."""
    script = """
import datetime as dt, warnings
import numpy as np, insnav
t = [dt.datetime(2026, 1, 1, tzinfo=dt.timezone.utc) + dt.timedelta(milliseconds=10 * i) for i in range(100)]
warnings.simplefilter("error")
print(len(insnav.mechanization.increments(t, np.zeros((100, 3)), np.zeros((100, 3)))))
try:
    np.asarray(t, dtype="datetime64[ns]")
except UserWarning:
    print("numpy warns")
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120)
    assert done.stdout.split() == ["99", "numpy", "warns"], done.stderr
