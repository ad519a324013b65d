"""`insnav.read_mcap`, `write_mcap` and `read_solution`: held against the command's files and against another reader."""

from __future__ import annotations

import pickle
import subprocess
import warnings
from collections import ChainMap, UserDict
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

import insnav
from insnav.sim import Scenario

mcap_reader = pytest.importorskip("mcap.reader")
DecoderFactory = pytest.importorskip("mcap_ros2.decoder").DecoderFactory

LOGS = [
    "mcap_real/rtkexp_drive_ros2_zstd.mcap",
    "mcap_real/comma2k19_ros2_lz4.mcap",
]
CONFIG: dict[str, Any] = {"imu": {"grade": "automotive"}}


def quietly(function: Any, *args: Any, **options: Any) -> Any:
    """Real logs have something to warn of, which is not what these tests are about."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", insnav.InsnavWarning)
        return function(*args, **options)


def messages(path: Path, topic: str) -> list[Any]:
    with path.open("rb") as stream:
        reader = mcap_reader.make_reader(stream, decoder_factories=[DecoderFactory()])
        return [m.decoded_message for m in reader.iter_decoded_messages(topics=[topic])]


def same_columns(a: insnav.Solution, b: insnav.Solution) -> None:
    assert len(a) == len(b) > 100
    for name in a.columns:
        assert np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True), name
    for name, column in vars(a.updates).items():
        assert np.array_equal(column, getattr(b.updates, name), equal_nan=column.dtype.kind == "f"), name
    assert a.t0_ns == b.t0_ns


@pytest.mark.parametrize("log", LOGS)
def test_arrays_of_a_log_give_its_solution(log: str, data: Path) -> None:
    recording = insnav.read_mcap(data / log)
    assert recording.topics["imu"] and recording.counts["imu"] == len(recording["imu"][0])
    same_columns(quietly(insnav.run, recording, CONFIG), quietly(insnav.run, data / log, CONFIG))


def test_a_mounting_of_the_settings_is_left_to_the_run(data: Path) -> None:
    config = {"imu": {"grade": "automotive", "mounting_rpy_deg": [1.0, -2.0, 3.0]}}
    recording = insnav.read_mcap(data / LOGS[1], config=config)
    assert np.array_equal(recording["imu"][1], insnav.read_mcap(data / LOGS[1])["imu"][1])
    same_columns(quietly(insnav.run, recording, config), quietly(insnav.run, data / LOGS[1], config))


def test_reads_what_another_reader_reads(data: Path) -> None:
    path = data / LOGS[0]
    recording = insnav.read_mcap(path)
    imu = messages(path, recording.topics["imu"])
    stamps = np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in imu])
    assert recording["t0_ns"] == stamps[0]
    time_s, rate, force = recording["imu"]
    assert np.array_equal((time_s * 1e9).round().astype(np.int64) + recording["t0_ns"], stamps)
    # Forward-left-up there, forward-right-down here.
    turned = np.array([1.0, -1.0, -1.0])
    assert np.array_equal(rate, [[m.angular_velocity.x, m.angular_velocity.y, m.angular_velocity.z] for m in imu] * turned)
    assert np.array_equal(force, [[m.linear_acceleration.x, m.linear_acceleration.y, m.linear_acceleration.z] for m in imu] * turned)
    fixes = messages(path, recording.topics["gnss"])
    _, position, covariance = recording["gnss_position"]
    assert len(position) == len(fixes)
    theirs = np.array([[m.latitude, m.longitude, m.altitude] for m in fixes])
    # The same radians, so the same degrees but for a unit in the last place.
    assert np.array_equal(np.radians(position[:, :2]), np.radians(theirs[:, :2])) and np.array_equal(position[:, 2], theirs[:, 2])
    enu = np.array([np.reshape(m.position_covariance, (3, 3)) for m in fixes])
    to_ned = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
    assert np.array_equal(covariance, to_ned @ enu @ to_ned.T)


def test_a_simulation_is_written_as_the_command_writes_it(command: Path, tmp_path: Path) -> None:
    gnss = {"latency_s": 0.12, "time_offset_s": 0.05, "position_rate_hz": 5.0, "lever_arm_b_m": [0.3, -0.4, -1.2]}
    scenario = Scenario.car_drive(60.0).replace(gnss=gnss, imu={"grade": "tactical"})
    (tmp_path / "drive.toml").write_text(scenario.to_toml())
    subprocess.run([str(command), "simulate", "drive.toml", "-o", "command.mcap", "--seed", "5"], cwd=tmp_path, check=True, capture_output=True)
    drive = scenario.simulate(5)
    insnav.write_mcap(tmp_path / "python.mcap", drive)
    assert (tmp_path / "python.mcap").read_bytes() == (tmp_path / "command.mcap").read_bytes()
    insnav.write_mcap(tmp_path / "other.mcap", scenario.simulate(6))
    assert (tmp_path / "other.mcap").read_bytes() != (tmp_path / "command.mcap").read_bytes()
    # The arrays of the simulation are what is in its file.
    recording = insnav.read_mcap(tmp_path / "command.mcap")
    assert recording["t0_ns"] == 1_704_067_200 * 10**9
    for kind in ["imu", "gnss_velocity"]:
        for ours, theirs in zip(drive.arrays[kind][:2], recording[kind][:2], strict=True):
            assert np.array_equal(ours, theirs), kind
    assert np.array_equal(np.radians(drive.arrays["gnss_position"][1]), np.radians(recording["gnss_position"][1]))
    assert np.array_equal(drive.arrays["lever_arm_b_m"], recording["lever_arm_b_m"])
    start = {**CONFIG, "imu": {"grade": "tactical"}}
    same_columns(quietly(insnav.run, recording, start), quietly(insnav.run, tmp_path / "command.mcap", start))


def test_the_truth_of_a_simulation_is_that_of_its_file(tmp_path: Path) -> None:
    """Seconds of a truth count from the zero of the solution, whether that is a date or not."""
    drive = Scenario.car_drive(90.0).simulate(2)
    insnav.write_mcap(tmp_path / "drive.mcap", drive)
    by_file = insnav.run(tmp_path / "drive.mcap", CONFIG, start=drive.start)
    by_arrays = insnav.run(drive.arrays, CONFIG, start=drive.start)
    a, b = (insnav.compare(s, drive.truth, from_s=70.0) for s in (by_file, by_arrays))
    assert np.array_equal(a.time_s, b.time_s)
    assert np.allclose(a.position_error_n_m, b.position_error_n_m, rtol=0, atol=1e-6)


def test_arrays_written_are_read_again(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    n = 50
    root = rng.normal(size=(n, 3, 3))
    covariance = root @ root.transpose(0, 2, 1)
    covariance = (covariance + covariance.transpose(0, 2, 1)) / 2
    covariance[7] = np.nan
    arrays: dict[str, Any] = {
        "t0_ns": 1_700_000_000_123_456_789,
        "lever_arm_b_m": [0.1, -0.2, -0.3],
        "imu": (np.arange(n) * 0.01, rng.normal(size=(n, 3)), rng.normal(size=(n, 3))),
        "gnss_position": (np.arange(n) * 0.1, rng.normal(size=(n, 3)) + [50, 14, 300], covariance),
        "gnss_velocity": (np.arange(n) * 0.1, rng.normal(size=(n, 3)), np.abs(rng.normal(size=(n, 3)))),
        "magnetic_field": (np.arange(n) * 0.1, rng.normal(size=(n, 3)) * 1e-5),
        "standstill": ([0.5, 2.0], [True, False]),
    }
    path = tmp_path / "log.mcap"
    insnav.write_mcap(path, arrays)
    again = insnav.read_mcap(path, topics={"standing": "/vehicle/standing"})
    assert again["t0_ns"] == arrays["t0_ns"]
    for kind in ["imu", "magnetic_field", "standstill"]:
        for ours, theirs in zip(arrays[kind], again[kind], strict=True):
            # Stamps are whole nanoseconds.
            assert np.allclose(ours, theirs, rtol=0, atol=5e-10 if ours is arrays[kind][0] else 0), kind
    assert np.allclose(arrays["gnss_position"][1], again["gnss_position"][1], rtol=0, atol=1e-13)
    assert np.array_equal(again["gnss_position"][2], covariance, equal_nan=True)
    sigma = np.array([np.diag(s**2) for s in arrays["gnss_velocity"][2]])
    assert np.array_equal(again["gnss_velocity"][2], sigma)
    assert np.array_equal(again["lever_arm_b_m"], arrays["lever_arm_b_m"])
    # And once more: nothing changes any further.
    insnav.write_mcap(tmp_path / "again.mcap", again)
    third = insnav.read_mcap(tmp_path / "again.mcap", topics={"standing": "/vehicle/standing"})
    for kind in ["imu", "gnss_position", "gnss_velocity", "magnetic_field", "standstill"]:
        for ours, theirs in zip(again[kind], third[kind], strict=True):
            assert np.allclose(ours, theirs, rtol=0, atol=1e-13, equal_nan=True), kind


def test_covariances_are_used_as_sigmas_are() -> None:
    """A diagonal covariance says what standard deviations say; one with correlations says something else."""
    drive = Scenario.car_drive(80.0).simulate(3)
    stamps, position, sigma = drive.arrays["gnss_position"]
    diagonal = np.array([np.diag(s**2) for s in sigma])
    by_sigma = quietly(insnav.run, drive.arrays, CONFIG)
    same_columns(by_sigma, quietly(insnav.run, {**drive.arrays, "gnss_position": (stamps, position, diagonal)}, CONFIG))
    tied = diagonal.copy()
    tied[:, 0, 1] = tied[:, 1, 0] = 0.9 * 1.5**2
    other = quietly(insnav.run, {**drive.arrays, "gnss_position": (stamps, position, tied)}, CONFIG)
    assert not np.array_equal(other.latitude_deg, by_sigma.latitude_deg)
    with pytest.raises(insnav.ArgumentError, match=r"\(81, 3, 3\)"):
        insnav.run({**drive.arrays, "gnss_position": (stamps, position, tied[:5])}, CONFIG)


@pytest.mark.parametrize("form", [dict, MappingProxyType, ChainMap, UserDict])
def test_topics_are_any_mapping(form: Any, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    insnav.write_mcap(path, insnav.sim.Scenario.car_drive(70.0).simulate(seed=5))
    topics = {"imu": "/imu/data"}
    assert insnav.read_mcap(path, topics=form(topics)).topics["imu"] == "/imu/data"
    assert len(quietly(insnav.run, path, topics=form(topics))) > 100
    # The control: what is said is used.
    with pytest.raises(insnav.LogError, match="/imu/none"):
        insnav.read_mcap(path, topics=form({"imu": "/imu/none"}))
    with pytest.raises(TypeError, match="(?s)expected a mapping, not list.*topics"):
        insnav.read_mcap(path, topics=["imu"])  # type: ignore[arg-type]


def test_the_zero_of_seconds_is_kept() -> None:
    drive = Scenario.car_drive(80.0).simulate(3)
    zero = 1_704_067_200_000_000_001
    plain, dated = quietly(insnav.run, drive.arrays, CONFIG), quietly(insnav.run, {**drive.arrays, "t0_ns": zero}, CONFIG)
    assert dated.t0_ns == zero and np.array_equal(dated.time_s, plain.time_s)
    assert np.array_equal(dated.time_ns, plain.time_ns + zero) and np.array_equal(dated.latitude_deg, plain.latitude_deg)
    with pytest.raises(insnav.ArgumentError, match="t0_ns"):
        insnav.run({**drive.arrays, "t0_ns": 1.5}, CONFIG)
    with pytest.raises(insnav.ArgumentError, match="lever_arm_b_m"):
        insnav.run({**drive.arrays, "lever_arm_b_m": [1.0, 2.0]}, CONFIG)
    with pytest.raises(insnav.ArgumentError, match="magnetic_field"):
        insnav.run({**drive.arrays, "mag": ([0.0], [[0.0, 0, 0]])}, CONFIG)


def test_the_lever_arm_of_arrays_is_used_where_the_settings_say_nothing() -> None:
    arm = [1.0, -2.0, -1.5]
    drive = Scenario.car_drive(120.0).replace(gnss={"lever_arm_b_m": arm, "position_rate_hz": 5.0}).simulate(3)
    told = {**CONFIG, "gnss": {"lever_arm_b_m": arm}}
    bare = {k: v for k, v in drive.arrays.items() if k != "lever_arm_b_m"}
    same_columns(insnav.run(drive.arrays, CONFIG), insnav.run(bare, told))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        insnav.run(bare, CONFIG)
    assert any("lever arm" in str(w.message) and "not known" in str(w.message) for w in caught)
    zero = quietly(insnav.run, drive.arrays, {**CONFIG, "gnss": {"lever_arm_b_m": [0.0, 0.0, 0.0]}})
    assert not np.array_equal(zero.latitude_deg, insnav.run(drive.arrays, CONFIG).latitude_deg)


@pytest.mark.parametrize("withhold", [None, "100:130", "every:2"])
def test_a_solution_is_read_back(withhold: str | None, data: Path, tmp_path: Path) -> None:
    out = tmp_path / "solution.mcap"
    s = quietly(insnav.run, data / LOGS[1], CONFIG, output=out, withhold=withhold)
    again = insnav.read_solution(out)
    same_columns(s, again)
    assert again.summary["config"] == s.summary["config"] and again.summary["metadata"]["input_crc32"]
    # Comma's car never stands.
    assert len(again.stops) == len(s.stops) == 0


def test_stops_of_a_solution_that_is_read_are_those_of_its_columns(tmp_path: Path) -> None:
    out = tmp_path / "solution.mcap"
    drive = Scenario.car_drive(600.0).simulate(1)
    s = quietly(insnav.run, drive.arrays, CONFIG, output=out)
    read = insnav.read_solution(out).stops
    step = float(np.median(np.diff(s.time_s)))
    assert len(read) == len(s.stops) == 3
    assert read.begin_s == pytest.approx(s.stops.begin_s, abs=1e-6)
    assert (s.stops.end_s - read.end_s >= -1e-9).all() and (s.stops.end_s - read.end_s < 1.5 * step).all()
    assert read.mode.tolist() == [""] * 3 and np.isnan(read.heading_deg).all() and np.isnan(read.held_from_s).all()


def test_stops_of_columns_are_told_apart(tmp_path: Path) -> None:
    s = quietly(insnav.run, Scenario.standing(20.0).simulate(1).arrays, CONFIG)

    def stops(standing: list[int], standing_s: list[float]) -> list[tuple[float, float]]:
        n = len(standing)
        columns = {
            **{name: getattr(s, name)[:n] for name in s.columns},
            "time_s": np.arange(float(n)),
            "standing": np.array(standing, dtype=bool),
            "standing_s": np.array(standing_s, dtype=float),
        }
        found = insnav.Solution(**columns, t0_ns=0, updates=s.updates, summary={}).stops
        return list(zip(found.begin_s.tolist(), found.end_s.tolist(), strict=True))

    assert stops([], []) == []
    assert stops([0, 0, 0], [0, 0, 0]) == []
    assert stops([1, 1, 1], [0.5, 1.5, 2.5]) == [(-0.5, 2)]
    assert stops([0, 1, 1, 0, 1], [0, 0.25, 1.25, 0, 0.75]) == [(0.75, 2), (3.25, 4)]
    # It moved between two epochs.
    assert stops([1, 1, 1, 0], [8, 9, 0.5, 0]) == [(-8, 1), (1.5, 2)]
    # Found after a while, and counted from its begin.
    assert stops([0, 0, 1, 0], [0, 0, 2, 0]) == [(0, 2)]


def test_a_recording_keeps_what_its_file_says(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    insnav.write_mcap(path, Scenario.standing(2.0).simulate(1).arrays)
    recording = insnav.read_mcap(path)
    told = (recording.path, recording.topics, recording.counts, recording.metadata)
    assert recording.path and recording.topics and recording.counts
    position = recording["gnss_position"]
    changed: Any = recording | {"gnss_position": None}
    for again in (recording.copy(), recording | {}, changed):
        assert type(again) is insnav.Recording and again.keys() == recording.keys()
        assert (again.path, again.topics, again.counts, again.metadata) == told
    assert recording["gnss_position"] is position and changed["gnss_position"] is None
    with pytest.raises(TypeError):
        recording | 3  # type: ignore[operator]


def test_files_are_whole_or_not_there(tmp_path: Path, data: Path) -> None:
    path = tmp_path / "log.mcap"
    increments = {"imu_increment": ([0.0, 0.01], np.zeros((2, 3)), np.zeros((2, 3)))}
    with pytest.raises(insnav.LogError, match="increment"):
        insnav.write_mcap(path, increments)
    with pytest.raises(insnav.LogError, match="heading"):
        insnav.write_mcap(path, {"heading": ([0.0], [1.0], [1.0])})
    assert list(tmp_path.iterdir()) == []
    path.write_bytes(b"precious")
    drive = Scenario.standing(2.0).simulate(1)
    contents: list[Any] = [drive, drive.arrays]
    for content in contents:
        with pytest.raises(insnav.LogError, match="log.mcap"):
            insnav.write_mcap(path, content)
        assert path.read_bytes() == b"precious"
    insnav.write_mcap(path, drive.arrays, overwrite=True)
    assert len(messages(path, "/imu/data")) == 401
    with pytest.raises(TypeError, match="data"):
        insnav.write_mcap(tmp_path / "x.mcap", 3)  # type: ignore[arg-type]
    with pytest.raises(insnav.LogError, match="solution"):
        insnav.read_solution(path)
    with pytest.raises(insnav.LogError, match=r"none\.mcap"):
        insnav.read_mcap(tmp_path / "none.mcap")
    out = tmp_path / "solution.mcap"
    quietly(insnav.run, data / LOGS[1], CONFIG, output=out)
    with pytest.raises(insnav.InsnavError, match="IMU|imu"):
        insnav.read_mcap(out)


def test_dates_are_written_as_instants(tmp_path: Path) -> None:
    stamps = np.array(["2024-05-01T12:00:00.000000001", "2024-05-01T12:00:00.010000002"], dtype="datetime64[ns]")
    insnav.write_mcap(tmp_path / "log.mcap", {"imu": (stamps, np.zeros((2, 3)), np.ones((2, 3)))})
    again = insnav.read_mcap(tmp_path / "log.mcap")
    assert again["t0_ns"] == stamps[0].astype(np.int64)
    assert np.array_equal(again["imu"][0], [0.0, 10_000_001 * 1e-9])


def test_recordings_are_pickled(tmp_path: Path) -> None:
    insnav.write_mcap(tmp_path / "log.mcap", Scenario.standing(2.0).simulate(1))
    recording = insnav.read_mcap(tmp_path / "log.mcap")
    again = pickle.loads(pickle.dumps(recording))
    assert isinstance(again, insnav.Recording) and again.topics == recording.topics and again.metadata == recording.metadata
    assert np.array_equal(again["imu"][2], recording["imu"][2])
    assert repr(recording) == "<insnav.Recording: 401 imu, 3 gnss_position, 3 gnss_velocity>"
