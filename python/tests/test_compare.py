"""`insnav.compare`: held against formulas written apart, and against the command to the last digit."""

from __future__ import annotations

import json
import pickle
import subprocess
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insnav
from insnav.sim import Scenario, Simulation

CONFIG: dict[str, Any] = {"imu": {"grade": "automotive"}, "gnss": {"lever_arm_b_m": [0.0, 0.0, 0.0], "correlation_time_s": 0.0}}


def quietly(*args: Any, **options: Any) -> insnav.Comparison:
    """Of errors that were put in one need not be warned."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", insnav.InsnavWarning)
        return insnav.compare(*args, **options)


@pytest.fixture(scope="module")
def drive() -> Simulation:
    return Scenario.car_drive(150.0).simulate(11)


@pytest.fixture(scope="module")
def solution(drive: Simulation) -> insnav.Solution:
    return insnav.run(drive.arrays, CONFIG, start=drive.start)


def test_statistics_are_those_of_numpy(drive: Simulation, solution: insnav.Solution) -> None:
    """The truth at the solution's own instants: nothing is interpolated, so that every number can be had by hand."""
    truth = drive.scenario.truth_at(solution.time_s, seed=drive.seed)
    c = insnav.compare(solution, truth)
    assert len(c) == len(solution) and np.array_equal(c.time_s, solution.time_s)
    # Metres per radian on the ellipsoid, at the truth.
    e2 = 1 / 298.257223563 * (2 - 1 / 298.257223563)
    s2 = np.sin(np.radians(truth.latitude_deg)) ** 2
    meridian = 6378137.0 * (1 - e2) / (1 - e2 * s2) ** 1.5 + truth.height_m
    parallel = (6378137.0 / np.sqrt(1 - e2 * s2) + truth.height_m) * np.cos(np.radians(truth.latitude_deg))
    dp = np.column_stack(
        [
            np.radians(solution.latitude_deg - truth.latitude_deg) * meridian,
            np.radians(solution.longitude_deg - truth.longitude_deg) * parallel,
            truth.height_m - solution.height_m,
        ]
    )
    dv = solution.velocity_n_m_per_s - truth.velocity_n_m_per_s
    heading = (solution.heading_deg - truth.heading_deg + 180) % 360 - 180
    # Offsets of metres at arcs of the Earth: to 1e-6 of them.
    assert np.allclose(c.position_error_n_m, dp, rtol=0, atol=1e-5)
    assert np.array_equal(c.velocity_error_n_m_per_s, dv)
    assert np.allclose(c.roll_pitch_heading_error_deg[:, 2], heading, rtol=0, atol=1e-9)
    # On a car, level to some degrees, the rotation about down is the heading's but for tilt errors times tan(pitch).
    assert np.abs(c.attitude_error_n_deg[:, 2] - heading).max() < 0.02
    every = c.summary["all"]
    assert every["count"] == len(solution)
    for key, expected in {
        "horizontal_rms_m": np.sqrt(np.mean(dp[:, 0] ** 2 + dp[:, 1] ** 2)),
        "height_rms_m": np.sqrt(np.mean(dp[:, 2] ** 2)),
        "velocity_rms_m_per_s": np.sqrt(np.mean(np.sum(dv**2, axis=1))),
        "heading_rms_deg": np.sqrt(np.mean(heading**2)),
        "horizontal_p95_m": np.percentile(np.hypot(dp[:, 0], dp[:, 1]), 95),
        "horizontal_max_m": np.hypot(dp[:, 0], dp[:, 1]).max(),
    }.items():
        assert every[key] == pytest.approx(float(expected), rel=1e-6), key
    for key, errors, p in [
        ("position", dp, solution.position_covariance_n_m2),
        ("velocity", dv, solution.velocity_covariance_n_m2_per_s2),
        ("attitude", np.radians(c.attitude_error_n_deg), solution.attitude_covariance_n_rad2),
    ]:
        nees = np.einsum("ni,ni->n", errors, np.linalg.solve(p, errors[:, :, None])[:, :, 0]) / 3
        assert np.allclose(getattr(c, f"nees_{key}"), nees, rtol=1e-4, atol=1e-9), key
        assert every["nees"][key] == pytest.approx(float(nees.mean()), rel=1e-5), key
    assert np.allclose(c.sigma_position_n_m, solution.sigma_position_n_m, rtol=1e-12)
    assert np.allclose(c.sigma_attitude_n_deg, solution.sigma_attitude_n_deg, rtol=1e-12)
    assert np.array_equal(c.standing, truth.standing) and c.summary["standing"]["count"] == truth.standing.sum()
    shares = [np.mean(np.abs(dp / solution.sigma_position_n_m) <= k) for k in (1, 2, 3)]
    assert [every["coverage"][f"{k}_sigma"] for k in ("one", "two", "three")] == pytest.approx(shares, abs=1e-3)


def test_errors_put_in_come_out(drive: Simulation, solution: insnav.Solution) -> None:
    truth = drive.truth
    columns = {name: np.array(column) for name, column in vars(truth).items()}
    columns["height_m"] = columns["height_m"] - 5.0
    columns["heading_deg"] = (columns["heading_deg"] + 2.0) % 360
    moved = quietly(solution, columns)
    plain = insnav.compare(solution, truth)
    # Down error of the solution: it is 5 m higher than this reference, besides what it is anyway.
    assert np.allclose(moved.position_error_n_m[:, 2] - plain.position_error_n_m[:, 2], -5.0, atol=1e-5)
    turned = (moved.roll_pitch_heading_error_deg - plain.roll_pitch_heading_error_deg)[:, 2]
    assert np.allclose((turned + 180) % 360 - 180, -2.0, atol=1e-9)
    # A constant rotation about the body's down axis is a mounting.
    taken = quietly(solution, columns, remove_mounting=True)
    assert taken.summary["all"]["heading_rms_deg"] < 0.2 < moved.summary["all"]["heading_rms_deg"]


def test_a_reference_may_have_anything(drive: Simulation, solution: insnav.Solution) -> None:
    t = drive.truth
    heading = insnav.compare(solution, {"time_s": t.time_s, "heading_deg": t.heading_deg})
    assert heading.summary["all"]["horizontal_rms_m"] is None and np.isnan(heading.position_error_n_m).all()
    assert np.isnan(heading.attitude_error_n_deg).all() and not np.isnan(heading.roll_pitch_heading_error_deg[:, 2]).any()
    level = np.column_stack([t.velocity_n_m_per_s[:, :2], np.full(len(t), np.nan)])
    velocity = insnav.compare(solution, {"time_s": t.time_s, "velocity_n_m_per_s": level, "sigma_velocity_n_m_per_s": [0.1, 0.1, np.nan]})
    assert np.isnan(velocity.velocity_error_n_m_per_s[:, 2]).all()
    own = np.hypot(0.1, insnav.compare(solution, t).sigma_velocity_n_m_per_s[:, 0])
    assert np.allclose(velocity.sigma_velocity_n_m_per_s[:, 0], own)
    # Positions alone are a receiver's: those of the antenna.
    places = {"time_s": t.time_s, "latitude_deg": t.latitude_deg, "longitude_deg": t.longitude_deg, "height_m": t.height_m}
    assert insnav.compare(solution, places).summary["reference_at_antenna"] is True
    assert insnav.compare(solution, places, reference_at_antenna=False).summary["reference_at_antenna"] is False
    assert insnav.compare(solution, t).summary["reference_at_antenna"] is False
    quaternions = {"time_s": t.time_s, "quaternion_nb_wxyz": t.quaternion_nb_wxyz}
    assert insnav.compare(solution, quaternions).summary["total_rmse_deg"] < 0.5
    dates = {**places, "time_s": (t.time_s * 1e9).round().astype("datetime64[ns]")}
    assert np.array_equal(insnav.compare(solution, dates).position_error_n_m, insnav.compare(solution, places).position_error_n_m)


def test_parts_are_left_out_and_judged_apart(drive: Simulation, solution: insnav.Solution) -> None:
    c = insnav.compare(solution, drive.truth, from_s=70.0, to_s=110.0, withheld="80:90")
    assert c.time_s[0] == 70.0 and c.time_s[-1] == 110.0
    assert c.summary["withheld"]["count"] == 101
    inside = (c.time_s >= 80) & (c.time_s <= 90)
    horizontal = np.sqrt(np.mean(np.sum(c.position_error_n_m[inside, :2] ** 2, axis=1)))
    assert c.summary["withheld"]["horizontal_rms_m"] == pytest.approx(float(horizontal), rel=1e-12)
    assert insnav.compare(solution, drive.truth).summary["withheld"]["count"] == 0


def test_a_solution_in_memory_knows_what_was_withheld(drive: Simulation, tmp_path: Path) -> None:
    path = tmp_path / "solution.mcap"
    outage = insnav.run(drive.arrays, CONFIG, start=drive.start, withhold="80:90", output=path)
    assert outage.summary["withhold"] == "80:90"
    by_file, by_columns = insnav.compare(path, drive.truth).summary, insnav.compare(outage, drive.truth).summary
    assert by_columns["withheld"] == by_file["withheld"] and by_columns["withheld"]["count"] > 50
    # Single fixes, likewise: those that went through the file or a pickle, and those that did not.
    path = tmp_path / "singly.mcap"
    singly = insnav.run(drive.arrays, CONFIG, start=drive.start, withhold="every:3", output=path)
    assert len(singly.withheld) == singly.summary["withheld"] > 40
    said = insnav.compare(path, drive.truth).summary["withheld"]
    assert said["count"] > 40
    for kept in (singly, insnav.read_solution(path), pickle.loads(pickle.dumps(singly))):
        assert insnav.compare(kept, drive.truth).summary["withheld"] == said
    assert "withhold" not in insnav.run(drive.arrays, CONFIG, start=drive.start).summary


def test_a_dataset_keeps_what_was_withheld_and_a_frame_tells_that_it_does_not(drive: Simulation) -> None:
    pytest.importorskip("pandas")
    pytest.importorskip("xarray")
    singly = insnav.run(drive.arrays, CONFIG, start=drive.start, withhold="every:3")
    said = insnav.compare(singly, drive.truth).summary["withheld"]
    assert said["count"] > 40
    dataset = insnav.Solution.from_xarray(singly.to_xarray())
    assert insnav.compare(dataset, drive.truth).summary["withheld"] == said
    frame = insnav.Solution.from_pandas(singly.to_pandas(), summary=singly.summary)
    with pytest.warns(insnav.InsnavWarning, match="every:3"):
        assert insnav.compare(frame, drive.truth).summary["withheld"]["count"] == 0


def test_the_imu_clock_is_put_right(drive: Simulation) -> None:
    """A truth on the IMU's clock is later by the offset that the run used."""
    scenario = drive.scenario.replace(gnss={"time_offset_s": 0.2})
    late = scenario.simulate(11)
    config = {**CONFIG, "gnss": {**CONFIG["gnss"], "time_offset_s": 0.2}}
    s = insnav.run(late.arrays, config, start=late.start)
    on_imu = {**vars(late.truth), "time_s": late.truth.time_s - 0.2}
    right = insnav.compare(s, on_imu, reference_clock="imu").summary["all"]["velocity_rms_m_per_s"]
    assert right == pytest.approx(insnav.compare(s, late.truth).summary["all"]["velocity_rms_m_per_s"], rel=1e-9)
    wrong = quietly(s, on_imu).summary
    assert "reference-clock" in wrong["warnings"][0]["remedy"]
    assert wrong["all"]["velocity_rms_m_per_s"] > 2 * right


@pytest.mark.parametrize("flags", [{}, {"from_s": 100.0, "to_s": 200.0, "course": True}, {"remove_mounting": True}])
def test_the_summary_is_that_of_the_command(flags: dict[str, Any], data: Path, command: Path, tmp_path: Path) -> None:
    """A recorded drive against its receiver's fixes, whose antenna is elsewhere."""
    log, reference = data / "mcap_real/rtkexp_drive_ros2_zstd.mcap", data / "rtkexp_drive_0708/gnss.csv.gz"
    out = tmp_path / "drive.insnav.mcap"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", insnav.InsnavWarning)
        config = {"imu": {"grade": "automotive"}, "gnss": {"time_offset_s": -0.21, "velocity_lag_s": 0.128, "lever_arm_b_m": [0.5, 0.1, -1.0]}}
        s = insnav.run(log, config, output=out, withhold="300:330")
    arguments = [str(command), "compare", str(out), str(reference), "--format", "json"]
    for key, value in flags.items():
        flag = "--" + key.removesuffix("_s").replace("_", "-")
        arguments += [flag] if value is True else [flag, str(value)]
    said = json.loads(subprocess.run(arguments, capture_output=True, text=True, check=True).stdout)
    for key in ["name", "solution", "reference"]:
        del said[key]
    assert said["all"]["count"] > 90 and said["reference_at_antenna"] is True
    by_file = quietly(out, reference, **flags)
    by_columns = quietly(s, reference, withheld="300:330", **flags)
    for ours in (by_file, by_columns):
        told = {k: v for k, v in ours.summary.items() if k != "warnings"}
        assert told == {k: v for k, v in said.items() if k != "warnings"}
    assert by_file.summary["warnings"] == said["warnings"]
    if not flags:
        assert said["withheld"]["count"] > 10
    assert np.array_equal(by_file.position_error_n_m, by_columns.position_error_n_m)


def test_what_is_doubtful_is_told(drive: Simulation, solution: insnav.Solution) -> None:
    elsewhere = {**vars(drive.truth), "latitude_deg": drive.truth.latitude_deg + 1.0}
    with pytest.warns(insnav.InsnavWarning) as caught:
        c = insnav.compare(solution, elsewhere)
    assert any("apart on average" in str(w.message) for w in caught)
    assert "reference_elsewhere" in [w["code"] for w in c.summary["warnings"]]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        insnav.compare(solution, drive.truth, from_s=70.0)


def test_mistakes_are_named(drive: Simulation, solution: insnav.Solution, tmp_path: Path) -> None:
    late = {"time_s": drive.truth.time_s + 1e4, "heading_deg": drive.truth.heading_deg}
    with pytest.raises(insnav.ArgumentError, match=r"no instant in common.* 0\.0 to 150\.0 s"):
        insnav.compare(solution, late)
    with pytest.raises(insnav.ArgumentError, match=r"reference\[\"heading_deg\"\].*\(2,\).*\(3,\)"):
        insnav.compare(solution, {"time_s": [1.0, 2.0, 3.0], "heading_deg": [1.0, 2.0]})
    with pytest.raises(insnav.ArgumentError, match="nothing to compare"):
        insnav.compare(solution, {"time_s": [1.0]})
    with pytest.raises(insnav.ArgumentError, match="time_s"):
        insnav.compare(solution, {"heading_deg": [1.0]})
    with pytest.raises(insnav.ArgumentError, match="nothing lies between"):
        insnav.compare(solution, drive.truth, from_s=3.0, to_s=2.0)
    with pytest.raises(insnav.ArgumentError, match="gnss, imu"):
        insnav.compare(solution, drive.truth, reference_clock="utc")  # type: ignore[arg-type]
    with pytest.raises(insnav.ArgumentError, match="withheld"):
        insnav.compare(solution, drive.truth, withheld="every:2")
    with pytest.raises(insnav.LogError, match=r"none\.csv"):
        insnav.compare(solution, tmp_path / "none.csv")
    with pytest.raises(TypeError, match="reference"):
        insnav.compare(solution, 3)  # type: ignore[arg-type]


def test_columns_of_the_package_are_all_known(drive: Simulation, solution: insnav.Solution) -> None:
    """Whatever this package gives out is taken, in every form, and says the same."""
    pytest.importorskip("pandas")
    expected = insnav.compare(solution, drive.truth).summary
    as_seconds = solution.to_pandas()
    forms: list[Any] = [dict(vars(solution)), as_seconds, as_seconds.reset_index(), solution.to_pandas("utc"), dict(as_seconds.reset_index())]
    forms += [solution.to_polars("utc"), solution.to_xarray()]
    for form in forms:
        assert insnav.compare(form, drive.truth).summary == expected
    against = quietly(solution, vars(solution)).summary["all"]
    for form in forms:
        assert quietly(solution, form).summary["all"] == against
    turned = insnav.AttitudeFilter({"imu": {"grade": "automotive"}}).run(*drive.arrays["imu"])
    assert quietly({**vars(turned)}, {**vars(turned)}).summary["all"]["heading_rms_deg"] < 1e-6


def test_unknown_columns_are_named_with_the_nearest(drive: Simulation, solution: insnav.Solution) -> None:
    t = drive.truth
    places = {"time_s": t.time_s, "latitude_deg": t.latitude_deg, "longitude_deg": t.longitude_deg, "height_m": t.height_m}
    for wrong, meant in {"lat_deg": "latitude_deg", "lon_deg": "longitude_deg", "height": "height_m", "roll": "roll_deg"}.items():
        columns = {**places, wrong: t.latitude_deg}
        for arguments in ((columns, t), (solution, columns)):
            with pytest.raises(insnav.ArgumentError, match=f"unknown column `{wrong}`.*did you mean `{meant}`") as e:
                insnav.compare(*arguments)
            assert e.value.code == "unknown_column" and e.value.received == wrong
    with pytest.raises(insnav.ArgumentError, match="unknown column `speed_of_light`"):
        insnav.compare(solution, {**places, "speed_of_light": t.height_m})
    # The negative control: the same columns under their names.
    assert insnav.compare(solution, places).summary["all"]["horizontal_rms_m"] < 10


def test_what_cannot_be_compared_is_refused(drive: Simulation, solution: insnav.Solution) -> None:
    t = drive.truth
    places = {"time_s": t.time_s, "latitude_deg": t.latitude_deg, "longitude_deg": t.longitude_deg, "height_m": t.height_m}
    beyond = {**places, "latitude_deg": t.latitude_deg + 90}
    with pytest.raises(insnav.ArgumentError, match=r'reference\["latitude_deg"\]\[0\]: 1\d\d\.?\d*, expected -90 to 90') as e:
        insnav.compare(solution, beyond)
    assert e.value.code == "bad_value"
    with pytest.raises(insnav.ArgumentError, match="longitude_deg"):
        insnav.compare(beyond | {"latitude_deg": t.latitude_deg, "longitude_deg": t.longitude_deg + 361}, t)
    for left_out in ("latitude_deg", "longitude_deg", "height_m"):
        with pytest.raises(insnav.ArgumentError, match=f"part of a position, without the column `{left_out}`"):
            insnav.compare(solution, {name: column for name, column in places.items() if name != left_out})
    nowhere = {**places, "latitude_deg": np.full(len(t), np.nan)}
    with pytest.raises(insnav.ArgumentError, match="the reference no position, velocity or attitude") as e:
        insnav.compare(solution, nowhere)
    assert e.value.code == "nothing_to_compare"
    with pytest.raises(insnav.ArgumentError, match="the solution has position, the reference attitude"):
        insnav.compare(places, {"time_s": t.time_s, "heading_deg": t.heading_deg})
    # Some rows without a position are none.
    places["latitude_deg"] = np.where(np.arange(len(t)) % 2, t.latitude_deg, np.nan)
    assert insnav.compare(solution, places).summary["all"]["horizontal_rms_m"] < 10


def test_comparisons_are_pickled(drive: Simulation, solution: insnav.Solution) -> None:
    c = insnav.compare(solution, drive.truth)
    again = pickle.loads(pickle.dumps(c))
    assert again.summary == c.summary and np.array_equal(again.nees_attitude, c.nees_attitude)
    assert "horizontal_rms_m" in repr(c) and len(again) == len(c)
