"""One log through the command, the Rust API and Python: the same numbers to the last bit."""

from __future__ import annotations

import io
import subprocess
import warnings
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import insnav

mcap_reader = pytest.importorskip("mcap.reader")
DecoderFactory = pytest.importorskip("mcap_ros2.decoder").DecoderFactory

Table = dict[str, NDArray[np.float64]]
COLUMNS = {
    "latitude_deg": ["latitude_deg"],
    "longitude_deg": ["longitude_deg"],
    "height_m": ["height_m"],
    "velocity_n_m_per_s": [f"velocity_{d}_m_per_s" for d in ("north", "east", "down")],
    "roll_deg": ["roll_deg"],
    "pitch_deg": ["pitch_deg"],
    "heading_deg": ["heading_deg"],
    "sigma_position_n_m": [f"sigma_{d}_m" for d in ("north", "east", "down")],
}


def by_rust(program: Path, log: Path) -> Table:
    said = subprocess.run([str(program), str(log)], capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    rows = np.genfromtxt(io.StringIO(said.stdout), delimiter=",", names=True)
    # Nanoseconds need more digits than a float has.
    stamps = [int(line.split(",", 1)[0]) for line in said.stdout.splitlines()[1:]]
    table = {name: np.column_stack([rows[c] for c in names]).squeeze() for name, names in COLUMNS.items()}
    table["time_ns"] = np.array(stamps)
    table["sigma_heading_deg"] = rows["sigma_heading_deg"]
    return table


def by_command(command: Path, log: Path, out: Path) -> Table:
    said = subprocess.run([str(command), "run", str(log), "-o", str(out), "--format", "json"], capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    with out.open("rb") as stream:
        reader = mcap_reader.make_reader(stream, decoder_factories=[DecoderFactory()])
        states = [m.decoded_message for m in reader.iter_decoded_messages(topics=["/insnav/state"])]
    table = {name: np.array([[getattr(s, c) for c in names] for s in states]).squeeze() for name, names in COLUMNS.items()}
    table["time_ns"] = np.array([s.header.stamp.sec * 10**9 + s.header.stamp.nanosec for s in states])
    table["sigma_heading_deg"] = np.array([s.sigma_heading_deg for s in states])
    return table


def by_python(log: Path) -> Table:
    with warnings.catch_warnings():
        # Real logs have something to warn of, which is not what this test is about.
        warnings.simplefilter("ignore", insnav.InsnavWarning)
        s = insnav.run(log)
    table = {name: getattr(s, name) for name in [*COLUMNS, "time_ns"]}
    table["sigma_heading_deg"] = s.sigma_attitude_n_deg[:, 2]
    return table


@pytest.mark.parametrize("log", ["mcap_real/rtkexp_drive_ros2_zstd.mcap", "mcap_real/comma2k19_ros2_lz4.mcap"])
def test_command_rust_and_python_agree_to_the_last_bit(
    log: str, data: Path, command: Path, rust_example: Path, tmp_path: Path
) -> None:
    rust = by_rust(rust_example, data / log)
    others = {"command": by_command(command, data / log, tmp_path / "out.mcap"), "python": by_python(data / log)}
    assert len(rust["time_ns"]) > 1000
    for name, values in rust.items():
        for who, table in others.items():
            assert np.array_equal(table[name], values), (who, name)
    # One unit in the last place would be seen.
    assert not np.array_equal(np.nextafter(rust["height_m"], 0.0), rust["height_m"])
