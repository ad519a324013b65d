"""`insnav.run` on recorded logs, held against the command and against the file it writes."""

from __future__ import annotations

import gzip
import json
import subprocess
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import insnav

mcap_reader = pytest.importorskip("mcap.reader")
DecoderFactory = pytest.importorskip("mcap_ros2.decoder").DecoderFactory

LOGS = ["mcap_real/rtkexp_drive_ros2_zstd.mcap", "mcap_real/comma2k19_ros2_lz4.mcap"]
CONFIG: dict[str, Any] = {"imu": {"grade": "automotive"}, "gnss": {"time_offset_s": -0.1, "sigma_scale": 1.5}}


def quietly(*args: Any, **options: Any) -> insnav.Solution:
    """Real logs have something to warn of, which is not what these tests are about."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", insnav.InsnavWarning)
        return insnav.run(*args, **options)


@pytest.mark.parametrize("log", LOGS)
def test_writes_the_file_that_the_command_writes(log: str, data: Path, command: Path, tmp_path: Path) -> None:
    by_command, by_python = tmp_path / "command.mcap", tmp_path / "python.mcap"
    settings = ["imu.grade=automotive", "gnss.time_offset_s=-0.1", "gnss.sigma_scale=1.5"]
    arguments = [str(command), "run", str(data / log), "-o", str(by_command), "--format", "json", "--withhold", "every:2"]
    for setting in settings:
        arguments += ["--set", setting]
    said = subprocess.run(arguments, capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    s = quietly(data / log, CONFIG, output=by_python, withhold="every:2")
    assert by_python.read_bytes() == by_command.read_bytes()
    expected = json.loads(said.stdout)
    # Names of files, and the time the computer took.
    for key in ["input", "output", "also", "elapsed_s"]:
        del expected[key]
    assert {k: v for k, v in s.summary.items() if k != "elapsed_s"} == expected


@pytest.mark.parametrize("log", LOGS)
def test_columns_are_those_of_the_file(log: str, data: Path, tmp_path: Path) -> None:
    out = tmp_path / "solution.mcap"
    s = quietly(str(data / log), CONFIG, output=str(out))
    with out.open("rb") as stream:
        reader = mcap_reader.make_reader(stream, decoder_factories=[DecoderFactory()])
        states = [m.decoded_message for m in reader.iter_decoded_messages(topics=["/insnav/state"])]
        (metadata,) = [m for m in reader.iter_metadata() if m.name == "insnav"]

    def column(*names: str) -> NDArray[np.float64]:
        values = np.array([[getattr(state, name) for name in names] for state in states])
        return values[:, 0] if len(names) == 1 else values

    assert len(s) == len(states) > 1000
    assert s.t0_ns == int(metadata.metadata["t0_ns"])
    assert s.time_ns.tolist() == [st.header.stamp.sec * 10**9 + st.header.stamp.nanosec for st in states]
    for name in ["latitude_deg", "longitude_deg", "height_m", "roll_deg", "pitch_deg", "heading_deg"]:
        assert np.array_equal(getattr(s, name), column(name)), name
    ned, xyz = ["north", "east", "down"], ["x", "y", "z"]
    for ours, theirs in {
        "velocity_n_m_per_s": [f"velocity_{d}_m_per_s" for d in ned],
        "quaternion_nb_wxyz": [f"q_nb_{c}" for c in "wxyz"],
        "rate_b_deg_per_s": [f"rate_{c}_deg_per_s" for c in xyz],
        "gyro_bias_deg_per_hour": [f"gyro_bias_{c}_deg_per_hour" for c in xyz],
        "accel_bias_mg": [f"accel_bias_{c}_mg" for c in xyz],
        "sigma_position_n_m": [f"sigma_{d}_m" for d in ned],
        "sigma_velocity_n_m_per_s": [f"sigma_velocity_{d}_m_per_s" for d in ned],
        "sigma_attitude_n_deg": ["sigma_rotation_north_deg", "sigma_rotation_east_deg", "sigma_heading_deg"],
        "sigma_gyro_bias_deg_per_hour": [f"sigma_gyro_bias_{c}_deg_per_hour" for c in xyz],
        "sigma_accel_bias_mg": [f"sigma_accel_bias_{c}_mg" for c in xyz],
    }.items():
        assert np.array_equal(getattr(s, ours), column(*theirs)), ours
    for ours, theirs_like in {
        "position_covariance_n_m2": "position_covariance_{}_m2",
        "velocity_covariance_n_m2_per_s2": "velocity_covariance_{}_m2_per_s2",
        "attitude_covariance_n_rad2": "attitude_covariance_{}_rad2",
    }.items():
        for i, row in enumerate(["nn ne nd", "ne ee ed", "nd ed dd"]):
            assert np.array_equal(getattr(s, ours)[:, i], column(*map(theirs_like.format, row.split()))), ours
    assert np.array_equal(s.standing, column("motion") != 0)
    assert np.array_equal(s.standing_s, column("standing_s"))
    ratios = [f"stop_{what}_ratio" for what in ["specific_force", "angular_rate", "mean_rate", "speed"]]
    assert np.array_equal(s.stop_ratios, column(*ratios), equal_nan=True)


def test_arrays_do_as_the_log_does(data: Path) -> None:
    """The log was made from these tables by another program."""
    folder = data / "rtkexp_drive_0708"

    def table(name: str) -> Any:
        with gzip.open(folder / name, "rt") as stream:
            return np.genfromtxt(stream, delimiter=",", names=True)

    def columns(t: Any, *names: str) -> NDArray[np.float64]:
        return np.column_stack([t[name] for name in names])

    imu, gnss = table("imu.csv.gz"), table("gnss.csv.gz")
    # At every sample: which one is nearest to an even grid may hang on the last digit of the stamps.
    config: dict[str, Any] = {
        "imu": {"grade": "automotive"},
        "gnss": {"time_offset_s": -0.21, "velocity_lag_s": 0.128},
        "output": {"rate_hz": 0.0},
    }
    by_log = quietly(data / LOGS[0], config)
    by_arrays = quietly(
        {
            "imu": (imu["t_s"], columns(imu, "gx", "gy", "gz"), columns(imu, "ax", "ay", "az")),
            "gnss_position": (gnss["t_s"], columns(gnss, "lat_deg", "lon_deg", "h_m"), columns(gnss, "sn", "se", "sd")),
            "gnss_velocity": (gnss["t_s"], columns(gnss, "vn", "ve", "vd"), columns(gnss, "svn", "sve", "svd")),
        },
        config,
    )
    assert len(by_arrays) == len(by_log)
    # Both count from the first IMU stamp. Those of the log went through a float of Unix seconds (a quarter of a
    # microsecond, 10 µm at 35 m/s), the numbers of the table have five to nine digits.
    assert np.abs(by_arrays.time_s - by_log.time_s).max() < 1e-6
    north = (by_arrays.latitude_deg - by_log.latitude_deg) * 111e3
    east = (by_arrays.longitude_deg - by_log.longitude_deg) * 111e3 * np.cos(np.radians(40))
    # But where a fix falls on the very instant of an epoch: which comes first hangs on the last digit.
    apart = np.hypot(north, east) > 5e-4
    assert apart.sum() < 10
    assert np.abs(by_arrays.heading_deg - by_log.heading_deg)[~apart].max() < 1e-3


def test_refuses_to_overwrite_unless_told(data: Path, tmp_path: Path) -> None:
    out = tmp_path / "solution.mcap"
    out.write_bytes(b"precious")
    with pytest.raises(insnav.InsnavError) as caught:
        quietly(data / LOGS[1], output=out)
    assert str(out) in str(caught.value) and caught.value.remedy
    assert out.read_bytes() == b"precious"
    quietly(data / LOGS[1], output=out, overwrite=True)
    assert out.read_bytes()[:5] == b"\x89MCAP"


def test_names_the_log_that_cannot_be_read(data: Path, tmp_path: Path) -> None:
    missing, noise = tmp_path / "missing.mcap", tmp_path / "noise.mcap"
    noise.write_bytes(b"This is no log." * 10)
    for path in [missing, noise]:
        with pytest.raises(insnav.InsnavError) as caught:
            insnav.run(path)
        assert str(path) in str(caught.value)
    with pytest.raises(insnav.InsnavError, match="imu_axes"):
        insnav.run(data / LOGS[0], imu_axes="enu")  # type: ignore[arg-type]
    with pytest.raises(insnav.InsnavError, match="topics"):
        insnav.run(data / LOGS[0], topics={"gps": "/fix"})
    with pytest.raises(insnav.InsnavError, match="/nowhere"):
        insnav.run(data / LOGS[0], topics={"imu": "/nowhere"})
    with pytest.raises(insnav.InsnavError, match="withhold"):
        insnav.run(data / LOGS[0], withhold="every:1")
    with pytest.raises(TypeError, match="imu_axes"):
        insnav.run({}, imu_axes="frd")
