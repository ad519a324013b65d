"""`insnav.Navigator`: steps against batches against `insnav.run`, bit for bit; saved and resumed wherever it is."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulation import Drive, drive

import insnav
from insnav import Navigator, Solution

CONFIG: dict[str, Any] = {
    "imu": {"grade": "industrial"},
    "gnss": {"lever_arm_b_m": [0.0, 0.0, 0.0]},
    "vehicle": {"nonholonomic": "off"},
    "output": {"rate_hz": 10.0},
}
GYRO_WHITE, ACCEL_WHITE = np.radians(0.15) / 60, 0.05 / 60


@pytest.fixture(scope="module")
def truth() -> Drive:
    return drive(90.0)


@pytest.fixture(scope="module")
def arrays(truth: Drive) -> dict[str, Any]:
    return truth.arrays(np.random.default_rng(1), gyro_white=GYRO_WHITE, accel_white=ACCEL_WHITE)


Row = tuple[float, int, Any, tuple[Any, ...]]


def rows(arrays: dict[str, Any]) -> list[Row]:
    """One row each of all kinds, in the order of time; at one instant inertial ones first, then as the keys stand in `Arrays`."""
    order = ["imu", "imu_increment", "gnss_position", "gnss_velocity", "heading", "standstill", "speed"]
    samples: list[Row] = []
    for kind, columns in arrays.items():
        t = np.asarray(columns[0])
        # One sigma for all rows.
        wide = [np.broadcast_to(c, (len(t), *np.shape(c)[-1:])) for c in columns[1:]]
        samples += [(t[i], order.index(kind), kind, tuple(c[i] for c in wide)) for i in range(len(t))]
    return sorted(samples, key=lambda s: (s[0], s[1]))


def stepped(navigator: Navigator, samples: list[Row]) -> None:
    for t, _, kind, columns in samples:
        navigator.step(kind, t, *columns)


def assert_same(a: Solution, b: Solution) -> None:
    """To the last bit, NaN included."""
    for name in a.columns:
        assert getattr(a, name).tobytes() == getattr(b, name).tobytes(), name
    for name in ["time_s", "dof", "residual", "sigma", "nis"]:
        assert getattr(a.updates, name).tobytes() == getattr(b.updates, name).tobytes(), name
    assert list(a.updates.measurement) == list(b.updates.measurement)
    assert list(a.updates.verdict) == list(b.updates.verdict)


def joined(parts: list[Solution], name: str) -> NDArray[Any]:
    return np.concatenate([getattr(p, name) for p in parts])


def test_stepping_is_a_batch_is_a_run(truth: Drive, arrays: dict[str, Any]) -> None:
    run = insnav.run(arrays, CONFIG)
    settings = run.summary["config"]
    batch = Navigator.from_toml(settings)
    batch.batch(arrays)
    batch.finish()
    whole = batch.take()
    assert len(whole) == len(run) > 850
    assert_same(whole, run)
    assert whole.summary["config"] == settings

    steps = Navigator.from_toml(settings)
    stepped(steps, rows(arrays))
    steps.finish()
    assert_same(steps.take(), run)

    # The drive is known: the negative control is that of a run whose gyros turn the other way.
    north = (truth.at(run.time_s, truth.latitude_deg) - whole.latitude_deg) * 111e3
    assert np.abs(north[whole.time_s > 60]).max() < 0.1
    t, rate, force = arrays["imu"]
    wrong = Navigator.from_toml(settings)
    wrong.batch({**arrays, "imu": (t, -rate, force)})
    wrong.finish()
    other = wrong.take()
    assert np.abs(other.heading_deg - np.interp(other.time_s, truth.time_s, truth.heading_deg))[other.time_s > 60].max() > 5


def test_batches_go_on_from_each_other_and_parts_make_the_whole(arrays: dict[str, Any]) -> None:
    one = Navigator(CONFIG)
    one.batch(arrays)
    one.finish()
    whole = one.take()
    many, parts = Navigator(CONFIG), []
    for begin in range(0, 90, 7):
        piece = {
            kind: tuple(
                np.asarray(c)[(np.asarray(columns[0]) >= begin) & (np.asarray(columns[0]) < begin + 7)]
                if len(np.asarray(c)) == len(columns[0])
                else c
                for c in columns
            )
            for kind, columns in arrays.items()
        }
        many.batch(piece)
        parts.append(many.take())
        newest = many.epoch
        if newest is not None and len(parts[-1]):
            assert newest.time_s == parts[-1].time_s[-1] and newest.heading_deg == parts[-1].heading_deg[-1]
    many.finish()
    parts.append(many.take())
    for name in whole.columns:
        assert joined(parts, name).tobytes() == getattr(whole, name).tobytes(), name
    assert sum(len(p.updates) for p in parts) == len(whole.updates)
    assert len(many.take()) == 0 and many.epoch is not None


@pytest.mark.parametrize("cut_s", [0.5, 12.0, 19.99, 31.0, 89.5])
def test_saved_and_resumed_is_one_run_to_the_last_bit(arrays: dict[str, Any], cut_s: float) -> None:
    """In the start-up, in the middle of the first stop, when it ends, under way, and at the end."""
    config = {**CONFIG, "gnss": {**CONFIG["gnss"], "colour": {"sigma_m": 0.02, "tau_s": 60.0}}}
    samples = [s for s in rows(arrays)]
    one, first = Navigator(config), Navigator(config)
    stepped(one, samples)
    stepped(first, [s for s in samples if s[0] < cut_s])
    resumed = [pickle.loads(pickle.dumps(first)), copy.deepcopy(first), copy.copy(first)]
    assert pickle.dumps(resumed[0]) == pickle.dumps(first)
    before = pickle.dumps(one)
    one.finish()
    expected, events = one.take(), one.take_events()
    assert len(expected) > 850 and len(events) >= 3
    for navigator in (first, *resumed):
        stepped(navigator, [s for s in samples if s[0] >= cut_s])
        assert pickle.dumps(navigator) == before
        navigator.finish()
        assert_same(navigator.take(), expected)
        assert navigator.take_events() == events


def test_events_tell_start_and_stop(arrays: dict[str, Any]) -> None:
    run = insnav.run(arrays, CONFIG)
    navigator = Navigator.from_toml(run.summary["config"])
    assert not navigator.started and navigator.latest() is None and navigator.filter is None and navigator.epoch is None
    navigator.batch(arrays)
    assert navigator.started and "Navigator at" in repr(navigator)
    t, rate, force = arrays["imu"]
    navigator.step_imu(float(t[-1]), rate[-1], force[-1])
    navigator.step_imu(float(t[-1]) + 0.01, [np.nan, 0.0, 0.0], force[-1])
    navigator.finish()
    events = navigator.take_events()
    assert [e.kind for e in events if e.kind not in ("stop_began", "stop_ended")] == ["started", "duplicate_imu", "not_finite"]
    told = [(e.details["begin_s"], e.details["end_s"], e.details["mode"]) for e in events if e.kind == "stop_ended"]
    # As the run tells it; it stands for twenty seconds.
    assert told == [(pytest.approx(s["begin_s"], abs=1e-9), pytest.approx(s["end_s"], abs=1e-9), s["mode"]) for s in run.summary["stops"]]
    assert told[0][1] == pytest.approx(20.0, abs=1.0)
    start = events[0]
    assert start.details["heading_source"].startswith("course") and start.time_s == 0.0
    assert navigator.take_events() == []


def test_latest_is_ahead_and_the_filter_is_a_copy(truth: Drive, arrays: dict[str, Any]) -> None:
    navigator = Navigator(CONFIG)
    stepped(navigator, [s for s in rows(arrays) if s[0] <= 70.0])
    latest, epoch, eskf = navigator.latest(), navigator.epoch, navigator.filter
    assert latest is not None and epoch is not None and eskf is not None
    assert latest.time_s == 70.0 and epoch.time_s < 69.6
    north = np.degrees(latest.position[0]) - truth.at(np.array([70.0]), truth.latitude_deg)[0]
    assert abs(north) * 111e3 < 0.2
    before = pickle.dumps(navigator)
    eskf.update_zero_velocity(sigma=0.1)
    assert pickle.dumps(navigator) == before
    assert eskf.sigma("velocity").max() < 0.2


def test_any_form_of_a_sample_is_the_same(arrays: dict[str, Any]) -> None:
    samples = [s for s in rows(arrays) if s[0] < 40.0]

    def through(form: Any) -> bytes:
        navigator = Navigator(CONFIG)
        for t, _, kind, columns in samples:
            getattr(navigator, f"step_{kind}")(t, *(form(c) for c in columns))
        return pickle.dumps(navigator)

    def strided(column: Any) -> NDArray[np.float64]:
        wide = np.zeros((3, 7))
        wide[:, 3] = column
        return wide[:, 3]

    expected = through(np.asarray)
    for form in [list, tuple, strided, lambda c: np.asarray(c).tolist()]:
        assert through(form) == expected
    # Stamps of today, exact: the same seconds since another zero.
    navigator = Navigator(CONFIG)
    t0 = np.datetime64("2024-05-01T12:00:00.000000001", "ns")
    for t, _, kind, columns in samples:
        navigator.step(kind, t0 + np.timedelta64(round(t * 1e9), "ns"), *columns)
    latest = navigator.latest()
    counted = Navigator(CONFIG, t0_ns=int(t0.astype("int64")))
    for t, _, kind, columns in samples:
        counted.step(kind, float(t), *columns)
    other = counted.latest()
    assert latest == other and latest is not None
    epoch = counted.epoch
    assert epoch is not None and epoch.time_s == pytest.approx(latest.time_s - float(t0.astype("int64")) * 1e-9 - 1.0, abs=0.2)
    assert counted.take().t0_ns == int(t0.astype("int64"))
    assert (latest.time_ns - int(t0.astype("int64"))) == round(max(s[0] for s in samples) * 1e9)


def test_a_known_start_and_the_mounting_are_used(truth: Drive, arrays: dict[str, Any]) -> None:
    start: insnav.Start = {
        "time_s": 30.0,
        "latitude_deg_longitude_deg_height_m": [truth.latitude_deg[3000], truth.longitude_deg[3000], truth.height_m],
        "velocity_n_m_per_s": truth.velocity_n_m_per_s[3000],
        "roll_deg_pitch_deg_heading_deg": [0.0, 0.0, truth.heading_deg[3000]],
        "sigma_position_n_m": [0.1] * 3,
        "sigma_velocity_n_m_per_s": [0.1] * 3,
        "sigma_attitude_n_deg": [0.1] * 3,
    }
    run = insnav.run(arrays, CONFIG, start=start)
    navigator = Navigator.from_toml(run.summary["config"], start=start)
    assert navigator.started
    navigator.batch(arrays)
    navigator.finish()
    assert_same(navigator.take(), run)

    # A unit that is mounted upside down.
    t, rate, force = arrays["imu"]
    flip = np.array([1.0, -1.0, -1.0])
    turned = {**arrays, "imu": (t, rate * flip, force * flip)}
    config = {**CONFIG, "imu": {"grade": "industrial", "mounting_rpy_deg": [180.0, 0.0, 0.0]}}
    stepwise, batch = Navigator(config), Navigator(config)
    stepped(stepwise, rows(turned))
    batch.batch(turned)
    stepwise.finish()
    batch.finish()
    over = batch.take()
    assert_same(stepwise.take(), over)
    assert np.abs(over.roll_deg[over.time_s > 60]).max() < 0.5

    with pytest.raises(insnav.ArgumentError, match="time_s"):
        Navigator(CONFIG, start={k: v for k, v in start.items() if k != "time_s"})


def test_without_keeping_there_is_the_newest_epoch_alone(arrays: dict[str, Any]) -> None:
    kept, bare = Navigator(CONFIG), Navigator(CONFIG, keep=False)
    for navigator in (kept, bare):
        navigator.batch(arrays)
    a, b = kept.epoch, bare.epoch
    assert a is not None and b is not None
    assert a.time_ns == b.time_ns and a.heading_deg == b.heading_deg
    assert len(kept.take()) > 800 and len(bare.take()) <= 1 and bare.take_events() == []
    # A navigator that keeps nothing does not grow.
    assert len(pickle.dumps(bare)) < len(pickle.dumps(kept)) + 2000


def test_errors_leave_the_navigator_usable(arrays: dict[str, Any]) -> None:
    navigator = Navigator(CONFIG)
    navigator.batch(arrays)
    with pytest.raises(insnav.NavigationError) as caught:
        navigator.step_imu(1.0, (0.0, 0.0, 0.0), (0.0, 0.0, -9.8))
    assert caught.value.measurement == "imu" and caught.value.time_s == 1.0
    before = pickle.dumps(navigator)
    late = np.arange(1.0, 2.0, 0.1)
    with pytest.raises(insnav.NavigationError, match="9 other"):
        navigator.batch({"imu": (late, np.zeros((10, 3)), np.zeros((10, 3)))})
    calls: list[tuple[Any, str]] = [
        (lambda: navigator.step_imu(100.0, [0.0, 0.0], [0.0, 0.0, -9.8]), "angular_rate_b_rad_per_s"),
        (lambda: navigator.step_imu("soon", [0.0, 0.0, 0.0], [0.0, 0.0, -9.8]), "time_s"),  # type: ignore[arg-type]
        (lambda: navigator.step_imu(np.nan, [0.0, 0.0, 0.0], [0.0, 0.0, -9.8]), "time_s"),
        (lambda: navigator.step_magnetic_field(100.0, [1.0]), "field_b_tesla"),
        (lambda: navigator.step("imus", 1.0, 2.0), "kind"),  # type: ignore[arg-type]
    ]
    for call, argument in calls:
        with pytest.raises(insnav.InsnavError, match=argument):
            call()
    with pytest.raises(TypeError, match="3 columns"):
        navigator.step("speed", 1.0, 2.0, 3.0)
    assert pickle.dumps(navigator) == before
    navigator.finish()
    actions: list[Any] = [navigator.finish, lambda: navigator.step_speed(100.0, 1.0), lambda: navigator.batch(arrays)]
    for action in actions:
        with pytest.raises(insnav.NavigationError, match="finished"):
            action()
    empty = Navigator(CONFIG)
    with pytest.raises(insnav.AlignmentError):
        empty.finish()


def test_pickles_of_other_versions_are_refused() -> None:
    fresh: Any = Navigator(CONFIG)
    made_of = fresh.__reduce__()
    restore, (state,) = made_of
    other = state.replace(insnav.__version__.encode(), b"9.9.9", 1)
    assert other != state
    for bad in [b"", other, state[:-9], state + b"0"]:
        with pytest.raises(ValueError, match="pickles are for the version"):
            restore(bad)


def test_other_threads_run_meanwhile(arrays: dict[str, Any]) -> None:
    navigator, turns = Navigator(CONFIG), 0
    worker = threading.Thread(target=lambda: navigator.batch(arrays))
    worker.start()
    while worker.is_alive():
        turns += 1
        try:
            # In use, or not yet, or no longer: never in the middle.
            assert pickle.dumps(pickle.loads(pickle.dumps(navigator)))
        except RuntimeError as error:
            assert "borrowed" in str(error)
        worker.join(0.001)
    assert turns > 3 and navigator.started


def test_the_benchmark_runs() -> None:
    script = Path(__file__).parents[1] / "benchmarks" / "step_overhead.py"
    done = subprocess.run([sys.executable, script, "2000", "1"], capture_output=True, text=True, timeout=60, check=True)
    assert "beyond batch" in done.stdout
