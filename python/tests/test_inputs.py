"""Inputs of the wrong kind, unit or order: what they are told by, and where."""

from __future__ import annotations

import datetime as dt
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from simulation import Drive, drive

import insnav
from insnav import earth, stationary
from insnav.mechanization import NavState

CONFIG: dict[str, Any] = {"imu": {"grade": "industrial"}, "gnss": {"lever_arm_b_m": [0.0, 0.0, 0.0]}}
PLACE = "gnss_position: latitude_deg_longitude_deg_height_m"


@pytest.fixture(scope="module")
def truth() -> Drive:
    return drive(60.0)


@pytest.fixture
def arrays(truth: Drive) -> dict[str, Any]:
    made: dict[str, Any] = dict(truth.arrays(np.random.default_rng(3), gyro_white=1e-6))
    return made


def masked(values: Any, *at: Any) -> Any:
    array = np.ma.array(values, mask=np.zeros(np.shape(values), bool))
    array[at] = np.ma.masked
    return array


def with_column(arrays: dict[str, Any], kind: str, column: int, values: Any) -> dict[str, Any]:
    columns = list(arrays[kind])
    columns[column] = values
    return {**arrays, kind: tuple(columns)}


# Masks ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "column", "at", "name", "place"),
    [
        ("imu", 0, (5,), "imu: time_s", "[5]"),
        ("imu", 1, (7, 2), "imu: angular_rate_b_rad_per_s", "[7, 2]"),
        ("gnss_position", 1, (3, 1), PLACE, "[3, 1]"),
    ],
)
def test_a_mask_is_not_ignored(arrays: dict[str, Any], kind: str, column: int, at: Any, name: str, place: str) -> None:
    spoilt = with_column(arrays, kind, column, masked(arrays[kind][column], *at))
    for use in (lambda: insnav.run(spoilt, CONFIG), lambda: insnav.Navigator(CONFIG).batch(spoilt)):
        with pytest.raises(insnav.ArgumentError) as caught:
            use()
        error = caught.value
        assert (error.code, error.argument) == ("masked", name)
        assert f"{name}: 1 masked element, the first at {place}" in str(error) and ".filled(np.nan)" in str(error.remedy)


def test_a_mask_of_dates_and_of_rows(arrays: dict[str, Any]) -> None:
    t, rate, force = arrays["imu"]
    dates = masked((t * 1e9).astype("M8[ns]"), 4)
    with pytest.raises(insnav.ArgumentError, match=r"imu: time_s: 1 masked element, the first at \[4\]"):
        insnav.run({"imu": (dates, rate, force)}, CONFIG)
    rows = [np.zeros(3), masked(np.zeros(3), 1), np.zeros(3)]
    with pytest.raises(insnav.ArgumentError, match=r"specific_force_b: in row 1 1 masked element, the first at \[1\]"):
        insnav.align.level(rows)


def test_a_mask_without_an_element_masked_changes_nothing(arrays: dict[str, Any]) -> None:
    bare = insnav.run(arrays, CONFIG)
    unmasked = {kind: tuple(np.ma.array(c) for c in columns) for kind, columns in arrays.items()}
    assert np.array_equal(insnav.run(unmasked, CONFIG).latitude_deg, bare.latitude_deg)


def test_a_mask_in_one_step_and_in_geometry() -> None:
    navigator = insnav.Navigator(CONFIG)
    with pytest.raises(insnav.ArgumentError, match=r"angular_rate_b_rad_per_s: 1 masked element, the first at \[0\]"):
        navigator.step_imu(0.0, masked(np.zeros(3), 0), np.array([0.0, 0.0, -9.8]))
    navigator.step_imu(0.0, np.ma.array(np.zeros(3)), np.array([0.0, 0.0, -9.8]))
    with pytest.raises(insnav.ArgumentError, match="masked"):
        earth.to_ecef(masked([0.8, 0.2, 100.0], 2))


# Positions ------------------------------------------------------------------------------------------------------------


def moved(arrays: dict[str, Any], change: Any, kinds: tuple[str, ...] = ()) -> dict[str, Any]:
    t, places, *rest = arrays["gnss_position"]
    kept = {kind: columns for kind, columns in arrays.items() if kind not in kinds}
    return {**kept, "gnss_position": (t, change(places), *rest)}


def in_radians(places: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([np.radians(places[:, :2]), places[:, 2]])


def swapped(places: NDArray[np.float64]) -> NDArray[np.float64]:
    return places[:, [1, 0, 2]]


@pytest.mark.parametrize(
    ("change", "row", "words"),
    [
        (lambda p: swapped(p + [0.0, 100.0, 0.0]), 0, "the other way round: latitude comes first"),
        (lambda p: p * [1e7, 1e7, 1.0], 0, "1e-7 degrees"),
        (lambda p: np.where(np.arange(len(p))[:, None] < 4, np.nan, p + [60.0, 100.0, 0.0]), 4, "between -90 and 90 degrees"),
    ],
)
def test_places_that_are_none(arrays: dict[str, Any], change: Any, row: int, words: str) -> None:
    spoilt = moved(arrays, change)
    # They are kept in radians.
    first = np.degrees(np.radians(spoilt["gnss_position"][1][row]))
    for use in (lambda: insnav.run(spoilt, CONFIG), lambda: insnav.align.start(spoilt, CONFIG)):
        with pytest.raises(insnav.ArgumentError) as caught:
            use()
        error = caught.value
        assert (error.code, error.argument) == ("no_place", PLACE)
        assert f"{PLACE}[{row}]: latitude {first[0]:.7f}, longitude {first[1]:.7f}" in str(error)
        assert words in str(error.remedy)
    # Who wants no fixes is not held up by them.
    insnav.align.level(spoilt["imu"][2])


def test_one_place_that_is_none_is_left_out_as_before(arrays: dict[str, Any]) -> None:
    def one(places: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.where(np.arange(len(places))[:, None] == 9, [95.0, 14.0, 200.0], places)

    with pytest.warns(insnav.InsnavWarning, match="GNSS position"):
        assert len(insnav.run(moved(arrays, one), CONFIG))


@pytest.mark.parametrize(("change", "code"), [(in_radians, "positions_in_radians"), (swapped, "positions_swapped")])
def test_places_that_go_another_way_than_the_velocity(arrays: dict[str, Any], change: Any, code: str) -> None:
    with pytest.raises(insnav.NavigationError) as caught:
        insnav.run(moved(arrays, change), CONFIG)
    assert caught.value.code == code
    assert "go another way than GNSS velocity" in str(caught.value)


def test_places_in_radians_without_a_velocity_are_doubted(arrays: dict[str, Any]) -> None:
    with pytest.warns(insnav.InsnavWarning) as warned:
        insnav.run(moved(arrays, in_radians, ("gnss_velocity",)), CONFIG)
    assert sum("all positions are within 1.6° of the equator" in str(w.message) for w in warned) == 1


# Forces in g ----------------------------------------------------------------------------------------------------------


def tumbled(seconds: float = 60.0) -> tuple[Any, Any, Any]:
    """A unit that is turned about two axes, slowly, by hand: t, gyro, accel."""
    rng = np.random.default_rng(5)
    t = np.arange(0.0, seconds, 0.01)
    # Stops of two seconds between quarter turns about x and y by turns.
    up, q, rates = [], np.eye(3), []
    for k in range(len(t)):
        phase = int(t[k] // 3)
        turns = t[k] % 3 < 1.0
        axis = np.array([1.0, 0, 0]) if phase % 2 else np.array([0, 1.0, 0])
        w = axis * (np.pi / 2 if turns else 0.0)
        x = w * 0.01
        s = np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])
        n = float(np.linalg.norm(x))
        step = np.eye(3) + (np.sin(n) / n * s + (1 - np.cos(n)) / n**2 * s @ s if n else 0.0)
        q = q @ step
        rates.append(w)
        up.append(q.T @ [0.0, 0.0, -9.80665])
    gyro = np.array(rates) + rng.normal(0, 2e-4, (len(t), 3))
    return t, gyro, np.array(up) + rng.normal(0, 5e-3, (len(t), 3))


@pytest.mark.parametrize(("unit", "code"), [(9.80665, "imu_in_g"), (9.80665e-3, "imu_in_mg")])
def test_ahrs_says_that_a_force_is_in_g(unit: float, code: str) -> None:
    t, gyro, accel = tumbled()
    with pytest.raises(insnav.NavigationError) as caught:
        insnav.ahrs(t, gyro, accel / unit)
    error = caught.value
    assert error.code == code
    assert f"the specific force is {9.80665 / unit:.1f}"[:31] in str(error) and "not in m/s²" in str(error)
    assert "give rad/s and m/s² in arrays" in str(error.remedy)


def test_ahrs_still_says_that_gravity_was_taken_out() -> None:
    t, gyro, accel = tumbled()
    rng = np.random.default_rng(6)
    # What is left of a hand's motion without gravity is about as long, on the whole, as a force in g.
    left = np.repeat(rng.normal(0, 0.6, (len(t) // 20 + 1, 3)), 20, axis=0)[: len(t)]
    with pytest.raises(insnav.NavigationError) as caught:
        insnav.ahrs(t, gyro, left)
    assert caught.value.code == "gravity_removed"


# Sigmas ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["gnss_position", "gnss_velocity"])
def test_negative_sigmas_are_refused_by_row(arrays: dict[str, Any], kind: str) -> None:
    n = len(arrays[kind][0])
    sigma = np.full((n, 3), 0.5)
    sigma[3, 2] = -1.0
    covariance = np.tile(np.diag([0.25, 0.25, 1.0]), (n, 1, 1))
    covariance[7, 0, 0] = -1.0
    for values, row, words in [(sigma, 3, "standard deviations"), (covariance, 7, "variances")]:
        with pytest.raises(insnav.ArgumentError) as caught:
            insnav.run(with_column(arrays, kind, 2, values), CONFIG)
        error = caught.value
        assert error.code == "bad_value" and error.argument is not None and error.argument.startswith(f"{kind}: sigma_n_m")
        assert f"[{row}]: -1, expected {words} that are not negative" in str(error)
        assert "NaN where it is not known" in str(error.remedy)
    # NaN is how "not known" is said, and is said in part.
    sigma[3, 2] = np.nan
    insnav.Navigator(CONFIG).batch(with_column(arrays, kind, 2, sigma))


@pytest.mark.parametrize("sigma", [-1.0, (1.0, 1.0, -1.0), -np.eye(3)])
def test_negative_sigmas_of_one_step_are_refused(sigma: Any) -> None:
    navigator = insnav.Navigator(CONFIG)
    with pytest.raises(insnav.ArgumentError, match="sigma_n_m: -1, expected"):
        navigator.step_gnss_position(0.0, (50.0, 14.0, 300.0), sigma)
    with pytest.raises(insnav.ArgumentError, match="sigma_n_m_per_s: -1, expected"):
        navigator.step_gnss_velocity(0.0, (1.0, 0.0, 0.0), sigma)


# A correlation of 1.5, and a matrix of which only one half was filled.
CROSSED = [[2.0, 3.0, 0.0], [3.0, 2.0, 0.0], [0.0, 0.0, 9.0]]
ONE_HALF = [[2.0, 1.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 9.0]]


@pytest.mark.parametrize("kind", ["gnss_position", "gnss_velocity"])
@pytest.mark.parametrize(("matrix", "words"), [(CROSSED, "the variance -1.000e0"), (ONE_HALF, "not symmetric")])
def test_a_matrix_that_is_no_covariance_is_refused_by_row_and_time(
    arrays: dict[str, Any], kind: str, matrix: Any, words: str, tmp_path: Path
) -> None:
    t = arrays[kind][0]
    covariance = np.tile(np.diag([0.25, 0.25, 1.0]), (len(t), 1, 1))
    covariance[7] = matrix
    given: Any = with_column(arrays, kind, 2, covariance)
    for use in (
        lambda: insnav.run(given, CONFIG),
        lambda: insnav.Navigator(CONFIG).batch(given),
        lambda: insnav.write_mcap(tmp_path / "bad.mcap", given),
    ):
        with pytest.raises(insnav.ArgumentError) as caught:
            use()
        error = caught.value
        assert error.code == "not_a_covariance" and error.time_ns == round(1e9 * t[7])
        assert f"{kind}: sigma_n_m" in str(error) and f"[7] at {t[7]:.6f} s: " in str(error) and words in str(error)
        assert "NaN where it is not known" in str(error.remedy)
    # What is not known is no error, nor is a correlation of 1 that single precision has rounded.
    covariance[7] = np.nan
    covariance[8] = np.array([[0.3, 0.3, 0.0], [0.3, 0.3, 0.0], [0.0, 0.0, 1.0]], "f4") * np.float32(1 / 3)
    insnav.Navigator(CONFIG).batch(with_column(arrays, kind, 2, covariance.astype("f4")))


def test_a_matrix_of_one_step_that_is_no_covariance_is_refused() -> None:
    navigator = insnav.Navigator(CONFIG)
    for step in (navigator.step_gnss_position, navigator.step_gnss_velocity):
        with pytest.raises(insnav.ArgumentError, match="sigma_n_m.*: a matrix in which a direction has the variance") as caught:
            step(0.0, (50.0, 14.0, 300.0), CROSSED)
        assert caught.value.code == "not_a_covariance"
        step(0.0, (50.0, 14.0, 300.0), np.diag([1.0, 2.0, 3.0]))


def test_impossible_values_are_not_called_not_finite(arrays: dict[str, Any]) -> None:
    t, p, sigma = arrays["gnss_position"]
    p = np.array(p)
    p[30, 0] = 120.0
    with pytest.warns(insnav.InsnavWarning, match="1 sample with a value that cannot be was not used") as caught:
        one = insnav.run(with_column(arrays, "gnss_position", 1, p), CONFIG)
    (message,) = [str(w.message) for w in caught if "cannot be" in str(w.message)]
    assert f"the first at {t[30]:.3f} s: GNSS position has a latitude beyond ±90°" in message
    assert not any("NaN" in str(w.message) for w in caught)
    assert len(one) == len(insnav.run(arrays, CONFIG))
    # Two antennas: below zero is refused as of a fix; zero, which nothing has, is told.
    with pytest.raises(insnav.ArgumentError) as refused:
        insnav.run({**arrays, "heading": ([1.0, 2.0], [40.0, 40.0], [1.0, -1.0])}, CONFIG)
    assert refused.value.code == "bad_value" and "heading: sigma_deg[1]: -1" in str(refused.value)
    navigator = insnav.Navigator(CONFIG)
    with pytest.raises(insnav.ArgumentError, match="sigma_deg: -1"):
        navigator.step_heading(1.0, 40.0, -1.0)
    navigator.step_heading(1.0, 40.0, 0.0)
    navigator.step_heading(1.0, 40.0, np.nan)
    navigator.step_gnss_position(2.0, (120.0, 14.0, 300.0), 1.0)
    told = [(e.kind, e.details["what"]) for e in navigator.take_events()]
    assert told == [("impossible", "heading sigma"), ("not_finite", "heading sigma"), ("impossible", "GNSS position")]


# Instants -------------------------------------------------------------------------------------------------------------


def start(truth: Drive, **changes: Any) -> Any:
    return {
        "time_s": 0.0,
        "latitude_deg_longitude_deg_height_m": [truth.latitude_deg[0], truth.longitude_deg[0], 200.0],
        "velocity_n_m_per_s": [0.0, 0.0, 0.0],
        "roll_deg_pitch_deg_heading_deg": [0.0, 0.0, truth.heading_deg[0]],
        "sigma_position_n_m": [0.5, 0.5, 1.0],
        "sigma_velocity_n_m_per_s": [0.02] * 3,
        "sigma_attitude_n_deg": [0.05, 0.05, 0.1],
        **changes,
    }


@pytest.mark.parametrize("key", ["time_s", "velocity_n_m_per_s"])
@pytest.mark.parametrize("date", [np.datetime64(3, "s"), np.timedelta64(3, "s"), dt.datetime(2026, 1, 1)])
def test_a_date_in_a_start_is_refused_by_its_key(truth: Drive, arrays: dict[str, Any], key: str, date: Any) -> None:
    """As `insnav.batch` does, in the same words."""
    known = start(truth, **{key: date if key == "time_s" else [date] * 3})
    for use in (lambda: insnav.run(arrays, CONFIG, start=known), lambda: insnav.Navigator(CONFIG, start=known)):
        with pytest.raises(insnav.ArgumentError, match=f"start: {key} is a date, expected a number") as caught:
            use()
        assert (caught.value.code, caught.value.argument) == ("bad_start", f"start: {key}")


def test_no_number_in_a_start_is_refused_by_its_key(truth: Drive, arrays: dict[str, Any]) -> None:
    with pytest.raises(insnav.ArgumentError, match="start: time_s: no number, expected a number"):
        insnav.run(arrays, CONFIG, start=start(truth, time_s="soon"))


def test_stamps_of_samples_may_be_dates_everywhere() -> None:
    """Of the streaming classes too: the same as seconds on that scale."""
    rng = np.random.default_rng(2)
    by_seconds, by_dates = (stationary.StopDetector(CONFIG) for _ in range(2))
    seconds_filter, dates_filter = (insnav.AttitudeFilter() for _ in range(2))
    for k in range(400):
        rate, force = rng.normal(0, 1e-4, 3), rng.normal([0.0, 0.0, -9.81], 2e-3)
        date = np.datetime64(10_000_000 * k, "ns")
        by_seconds.step(0.01 * k, rate, force)
        by_dates.step(date, rate, force)
        a, b = seconds_filter.step(0.01 * k, rate, force), dates_filter.step(date, rate, force)
        assert (a is None) == (b is None)
    assert a is not None and b is not None and np.array_equal(a.quaternion_nb_wxyz, b.quaternion_nb_wxyz)
    assert by_seconds.standing_since_s is not None and by_seconds.standing_since_s == by_dates.standing_since_s
    for odd in (np.datetime64("NaT"), np.nan, "soon"):
        with pytest.raises(insnav.ArgumentError, match="t: .*expected a finite time") as caught:
            by_dates.step(odd, rate, force)  # type: ignore[arg-type]
        assert (caught.value.code, caught.value.argument) == ("not_finite", "t")


UNIX_MS = 1.7e12


def state_at(time_s: float) -> NavState:
    return NavState.from_degrees(50.0, 14.0, 300.0, time_s=time_s)


def filter_of() -> insnav.Eskf:
    return insnav.Eskf(state_at(0.0), "industrial", position_sigma=1.0, velocity_sigma=0.1, attitude_sigma=0.01)


@pytest.mark.parametrize(
    "use",
    [
        state_at,
        lambda t: NavState([0.5, 0.1, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], time_s=t),
        lambda t: filter_of().update_zero_velocity(sigma=1.0, time_s=t),
        lambda t: insnav.Navigator().step_imu(t, (0.0, 0.0, 0.0), (0.0, 0.0, -9.8)),
        lambda t: insnav.Navigator().step_gnss_position(t, (50.0, 14.0, 300.0)),
        lambda t: insnav.Navigator().step_speed(t, 1.0),
        lambda t: insnav.Navigator().step_imu(int(t), (0.0, 0.0, 0.0), (0.0, 0.0, -9.8)),
        lambda t: insnav.Navigator().batch({"speed": ([0.0, t], [1.0, 1.0])}),
        lambda t: stationary.StopDetector(CONFIG).step(t, np.zeros(3), np.array([0.0, 0.0, -9.8])),
        lambda t: insnav.AttitudeFilter().step(t, np.zeros(3), np.array([0.0, 0.0, -9.8])),
        lambda t: insnav.Navigator(CONFIG, start=start(drive(5.0), time_s=t)),
        lambda t: insnav.run(drive(5.0).arrays(np.random.default_rng(0)), CONFIG, start=start(drive(5.0), time_s=t)),
    ],
)
def test_milliseconds_since_1970_are_refused_wherever_seconds_are_taken(use: Any) -> None:
    """They are beyond what 64 bits of nanoseconds hold, which ends in 2262; those of today are not."""
    with pytest.raises(insnav.ArgumentError, match="1.7e12 s: more than 290 years") as caught:
        use(UNIX_MS)
    assert caught.value.code == "bad_time" and "milliseconds / 1e3" in str(caught.value.remedy)
    with pytest.raises(insnav.ArgumentError, match="more than 290 years"):
        use(-UNIX_MS)


def test_seconds_of_today_are_kept_and_beyond_the_clock_with_a_zero_are_refused() -> None:
    assert state_at(1.7e9).time_s == 1.7e9
    t0_ns = 1_700_000_000_000_000_000
    navigator = insnav.Navigator(t0_ns=t0_ns)
    sample = (0.0, 0.0, 0.0), (0.0, 0.0, -9.8)
    navigator.step_imu(7.5e9, *sample)
    with pytest.raises(insnav.ArgumentError, match=f"time_s = 8e9 s from t0_ns = {t0_ns}: beyond") as caught:
        navigator.step_imu(8e9, *sample)
    assert caught.value.code == "bad_time"
    with pytest.raises(insnav.ArgumentError, match="imu: time_s = 8e9 s from t0_ns"):
        insnav.run({"imu": ([0.0, 8e9], np.zeros((2, 3)), np.zeros((2, 3))), "t0_ns": t0_ns})


# Threads --------------------------------------------------------------------------------------------------------------


def test_a_filter_in_use_by_another_thread_stays_whole() -> None:
    """One thread moves it; another that asks meanwhile is refused, and finds it as it should be after that."""
    state = NavState.from_degrees(50.0, 14.0, 300.0)
    eskf = insnav.Eskf(state, "industrial", position_sigma=1.0, velocity_sigma=0.1, attitude_sigma=0.01)
    n = 30_000
    worker = threading.Thread(target=lambda: eskf.propagate(0.01, np.zeros((n, 3)), np.tile([0.0, 0.0, -0.0981], (n, 1))))
    worker.start()
    refused = 0
    while worker.is_alive():
        try:
            assert eskf.time_s in (0.0, pytest.approx(0.01 * n))
        except RuntimeError as error:
            assert "borrowed" in str(error)
            refused += 1
        worker.join(0.001)
    assert refused > 0 and eskf.time_s == pytest.approx(0.01 * n)
