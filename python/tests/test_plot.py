"""Figures: what is drawn, not how it looks."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insnav

matplotlib = pytest.importorskip("matplotlib")
matplotlib.use("Agg")
pyplot = pytest.importorskip("matplotlib.pyplot")


@pytest.fixture(scope="module")
def drive() -> insnav.sim.Simulation:
    """A stop at the begin and one on the way."""
    return insnav.sim.Scenario.from_toml(
        """
        start = { latitude_deg = 50.1, longitude_deg = 14.4, height_m = 250, heading_deg = 350 }
        imu = { grade = "industrial", rate_hz = 100 }
        route = [
            { duration_s = 15, speed_m_per_s = 0 },
            { duration_s = 10, speed_m_per_s = 12, turn_deg = 30 },
            { duration_s = 20, turn_deg = -80 },
            { duration_s = 8, speed_m_per_s = 0 },
            { duration_s = 12 },
            { duration_s = 8, speed_m_per_s = 9 },
            { duration_s = 20, turn_deg = 120 },
        ]
        """
    ).simulate(3)


@pytest.fixture(scope="module")
def solution(drive: insnav.sim.Simulation) -> insnav.Solution:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", insnav.InsnavWarning)
        s = insnav.run(drive.arrays, {"imu": {"grade": "industrial"}})
    assert len(s.stops) == 2
    return s


@pytest.fixture(autouse=True)
def closed() -> Any:
    yield
    pyplot.close("all")


def of(artists: Any, gid: str) -> list[Any]:
    return [artist for artist in artists if artist.get_gid() == gid]


def line(ax: Any, label: str) -> Any:
    (found,) = [line for line in ax.get_lines() if line.get_label() == label]
    return found


def band(ax: Any, number: int = 0) -> tuple[Any, Any]:
    """Lower and upper edge: the outline goes along one of them and back along the other."""
    outline = ax.collections[number].get_paths()[0].vertices
    time = np.unique(outline[:, 0])
    low = np.array([outline[outline[:, 0] == t, 1].min() for t in time])
    high = np.array([outline[outline[:, 0] == t, 1].max() for t in time])
    return low, high


def assert_stops_shaded(ax: Any, s: insnav.Solution) -> None:
    spans = of(ax.patches, "stop")
    assert len(spans) == len(s.stops)
    for span, begin, end in zip(spans, s.stops.begin_s, s.stops.end_s, strict=True):
        assert (span.get_x(), span.get_x() + span.get_width()) == pytest.approx((begin, end))


def test_trajectory(solution: insnav.Solution, drive: insnav.sim.Simulation) -> None:
    ax: Any = solution.plot.trajectory(reference=drive.truth, ellipse_every_s=10.0)
    s = solution
    # By the radii of the ellipsoid: flat within a millimetre over half a kilometre, but for the Earth's curve of d²/2R.
    lat = np.radians(s.latitude_deg[0])
    w = np.sqrt(1 - 0.00669437999014 * np.sin(lat) ** 2)
    north = np.radians(s.latitude_deg - s.latitude_deg[0]) * (6378137 * (1 - 0.00669437999014) / w**3 + 250)
    east = np.radians(s.longitude_deg - s.longitude_deg[0]) * (6378137 / w + 250) * np.cos(lat)
    x, y = line(ax, "solution").get_data()
    far = np.hypot(north, east).max()
    assert far > 200
    assert np.abs(x - east).max() < 2 * far**2 / 6.37e6 + 0.01 and np.abs(y - north).max() < 2 * far**2 / 6.37e6 + 0.01
    truth_x, _ = line(ax, "reference").get_data()
    assert len(truth_x) == len(drive.truth)
    stops_x, stops_y = line(ax, "stops").get_data()
    rows = [int(np.abs(s.time_s - begin).argmin()) for begin in s.stops.begin_s]
    assert np.array_equal(stops_x, x[rows]) and np.array_equal(stops_y, y[rows])
    ellipses = of(ax.patches, "ellipse")
    assert len(ellipses) == len(np.arange(s.time_s[0], s.time_s[-1], 10.0))
    for number, ellipse in enumerate(ellipses):
        row = int(np.abs(s.time_s - (s.time_s[0] + 10.0 * number)).argmin())
        assert ellipse.get_center() == pytest.approx((x[row], y[row]))
        # The outline is where the Mahalanobis distance is 3.
        angle = np.radians(ellipse.angle)
        for across, axis in [(ellipse.width, (np.cos(angle), np.sin(angle))), (ellipse.height, (-np.sin(angle), np.cos(angle)))]:
            d = np.array([axis[1], axis[0]]) * across / 2
            p = s.position_covariance_n_m2[row][:2, :2]
            assert d @ np.linalg.solve(p, d) == pytest.approx(9.0)
    assert ax.get_xlabel() == "east (m)" and ax.get_ylabel() == "north (m)"


def test_trajectory_with_larger_ellipses_or_none(solution: insnav.Solution) -> None:
    ax: Any = solution.plot.trajectory()
    large: Any = solution.plot.trajectory(ellipse_scale=100.0)
    small, big = of(ax.patches, "ellipse"), of(large.patches, "ellipse")
    assert len(small) == len(big) == 20
    assert [e.width * 100 for e in small] == pytest.approx([e.width for e in big])
    assert "3 sigma × 100" in [text.get_text() for text in large.get_legend().get_texts()]
    assert not of(solution.plot.trajectory(ellipse_every_s=0).patches, "ellipse")
    with pytest.raises(insnav.ArgumentError, match="ellipse_every_s"):
        solution.plot.trajectory(ellipse_every_s=-1.0)


def test_attitude(solution: insnav.Solution) -> None:
    axes = solution.plot.attitude()
    s = solution
    assert axes.shape == (3,)
    for ax, name in zip(axes, ["roll", "pitch", "heading"], strict=True):
        t, values = line(ax, name).get_data()
        wanted = getattr(s, f"{name}_deg")
        assert np.array_equal(t, s.time_s)
        assert np.abs((values - wanted + 180) % 360 - 180).max() < 1e-9
        assert np.abs(np.diff(values)).max() < 5, "no jump at north"
        assert ax.get_ylabel() == f"{name} (°)"
        assert_stops_shaded(ax, s)
    assert np.abs(np.diff(s.heading_deg)).max() > 300, "the drive goes over north"
    assert axes[-1].get_xlabel() == "time (s)"
    # Level, the heading's sigma is that of the rotation about down; roll's is along the heading.
    heading_half = np.subtract(*band(axes[2])[::-1]) / 2
    assert heading_half == pytest.approx(3 * s.sigma_attitude_n_deg[:, 2], rel=0.02)
    forward = np.column_stack([np.cos(np.radians(s.heading_deg)), np.sin(np.radians(s.heading_deg))])
    variance = np.einsum("ni,nij,nj->n", forward, s.attitude_covariance_n_rad2[:, :2, :2], forward)
    roll_half = np.subtract(*band(axes[0])[::-1]) / 2
    assert roll_half == pytest.approx(3 * np.degrees(np.sqrt(variance)) / np.cos(np.radians(s.pitch_deg)), rel=1e-9)


def test_biases(solution: insnav.Solution) -> None:
    axes = solution.plot.biases()
    for ax, values, sigma in [
        (axes[0], solution.gyro_bias_deg_per_hour, solution.sigma_gyro_bias_deg_per_hour),
        (axes[1], solution.accel_bias_mg, solution.sigma_accel_bias_mg),
    ]:
        for i, name in enumerate(["forward", "right", "down"]):
            assert np.array_equal(line(ax, name).get_ydata(), values[:, i])
            low, high = band(ax, i)
            assert low == pytest.approx(values[:, i] - 3 * sigma[:, i]) and high == pytest.approx(values[:, i] + 3 * sigma[:, i])
        assert_stops_shaded(ax, solution)
    assert [ax.get_ylabel() for ax in axes] == ["gyro bias (°/h)", "accelerometer bias (mg)"]


def test_stops_of_a_solution_without_a_summary_are_shaded(solution: insnav.Solution, drive: insnav.sim.Simulation, tmp_path: Path) -> None:
    out = tmp_path / "solution.mcap"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", insnav.InsnavWarning)
        insnav.run(drive.arrays, {"imu": {"grade": "industrial"}}, output=out)
    read = insnav.read_solution(out)
    step = float(np.median(np.diff(solution.time_s)))
    for axes, whole in zip(read.plot.biases(), solution.plot.biases(), strict=True):
        edges, wanted = ([(s.get_x(), s.get_x() + s.get_width()) for s in of(ax.patches, "stop")] for ax in (axes, whole))
        assert len(edges) == len(wanted) == 2
        assert np.array(edges) == pytest.approx(np.array(wanted), abs=1.5 * step)


def test_nis(solution: insnav.Solution) -> None:
    u = solution.updates
    names = list(dict.fromkeys(u.measurement.tolist()))
    axes = solution.plot.nis()
    assert len(axes) == len(names) > 2
    for ax, name in zip(axes, names, strict=True):
        assert ax.get_title().startswith(f"{name}: ")
        assert_stops_shaded(ax, solution)
    (ax,) = solution.plot.nis(measurements=["gnss_position"])
    rows = u.measurement == "gnss_position"
    assert np.array_equal(line(ax, "used").get_ydata(), u.nis[rows])
    low, high = sorted(bound.get_ydata()[0] for bound in of(ax.get_lines(), "bound"))
    assert f"{np.mean((u.nis[rows] > low) & (u.nis[rows] < high)):.1%}" in ax.get_title()
    with pytest.raises(insnav.ArgumentError, match="sonar"):
        solution.plot.nis(measurements=["sonar"])


@pytest.mark.parametrize("dof", [1, 2, 3])
def test_bounds_hold_95_percent(dof: int) -> None:
    """Against a million sums of squares: 2.5 % ± 0.016 % on either side, here within four of these."""
    from insnav._plot import CHI_SQUARE_95

    sums = np.sum(np.random.default_rng(dof).normal(size=(1_000_000, dof)) ** 2, axis=1)
    low, high = CHI_SQUARE_95[dof]
    assert np.mean(sums < low) == pytest.approx(0.025, abs=4 * 0.000156)
    assert np.mean(sums > high) == pytest.approx(0.025, abs=4 * 0.000156)


def test_measurements_that_were_not_used_are_crossed(drive: insnav.sim.Simulation) -> None:
    time, position, sigma = drive.arrays["gnss_position"]
    wrong = position.copy()
    wrong[len(wrong) // 2, 0] += 0.01
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", insnav.InsnavWarning)
        s = insnav.run({**drive.arrays, "gnss_position": (time, wrong, sigma)}, {"imu": {"grade": "industrial"}})
    rejected = (s.updates.measurement == "gnss_position") & (s.updates.verdict == "rejected")
    assert rejected.any()
    (ax,) = s.plot.nis(measurements=["gnss_position"])
    assert np.array_equal(line(ax, "not used").get_xdata(), s.updates.time_s[rejected])


def test_errors(solution: insnav.Solution, drive: insnav.sim.Simulation) -> None:
    axes = solution.plot.errors(drive.truth, from_s=5.0)
    c = insnav.compare(solution, drive.truth, from_s=5.0)
    assert axes.shape == (3, 3)
    for column, (errors, sigma) in enumerate(
        [
            (c.position_error_n_m, c.sigma_position_n_m),
            (c.velocity_error_n_m_per_s, c.sigma_velocity_n_m_per_s),
            (c.attitude_error_n_deg, c.sigma_attitude_n_deg),
        ]
    ):
        for i, direction in enumerate(["north", "east", "down"]):
            ax = axes[i, column]
            t, values = line(ax, direction).get_data()
            assert np.array_equal(t, c.time_s) and np.array_equal(values, errors[:, i])
            assert band(ax)[1] == pytest.approx(3 * sigma[:, i])
            assert_stops_shaded(ax, solution)
    assert [axes[0, i].get_title() for i in range(3)] == ["position error (m)", "velocity error (m/s)", "attitude error (°)"]


def test_allan_with_its_slopes() -> None:
    rng = np.random.default_rng(5)
    step = 0.01
    record = rng.normal(size=200_000) + np.cumsum(rng.normal(size=200_000)) * 1e-3
    deviation = insnav.noise.overlapping_allan(record, step)
    fit = insnav.noise.fit_allan(deviation)
    plain: Any = deviation.plot(unit="rad/s")
    assert np.array_equal(line(plain, "deviation").get_ydata(), deviation.deviation)
    assert plain.get_xscale() == plain.get_yscale() == "log" and "rad/s" in plain.get_ylabel()
    ax: Any = deviation.plot(fit, unit="rad/s")
    assert np.array_equal(line(ax, "fit").get_ydata(), fit.fitted)
    lines = {text.get_label().split(":")[0]: text for text in ax.get_lines() if text.get_label().startswith("slope")}
    # White noise and a random walk were put in; flicker may be none.
    slopes = {"slope −1/2": -0.5, "slope +1/2": 0.5, "slope 0": 0.0}
    assert {"slope −1/2", "slope +1/2"} <= lines.keys() <= slopes.keys()
    variance = np.zeros(len(deviation.tau_s))
    for name, drawn in lines.items():
        tau, values = drawn.get_data()
        ok = np.isfinite(values)
        assert np.polyfit(np.log(tau[ok]), np.log(values[ok]), 1)[0] == pytest.approx(slopes[name], abs=1e-9)
        variance += np.where(ok, values, 0) ** 2
    # The parts are those of the fit: together they are it, up to what is too small to be drawn.
    assert np.sqrt(variance) == pytest.approx(fit.fitted, rel=0.06)


def test_draws_into_what_is_given(solution: insnav.Solution) -> None:
    figure, given = pyplot.subplots(3, 1)
    drawn = solution.plot.attitude(given)
    assert all(a is b for a, b in zip(drawn, given, strict=True)) and pyplot.get_fignums() == [figure.number]
    _, one = pyplot.subplots()
    assert solution.plot.trajectory(one) is one
    with pytest.raises(insnav.ArgumentError, match="ax: 3 axes, expected 2"):
        solution.plot.biases(given)
