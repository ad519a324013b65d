"""One log through the command, the Rust API and Python: the same numbers to the last bit, all of them."""

from __future__ import annotations

import json
import subprocess
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import insnav
from insnav import _frames

mcap_reader = pytest.importorskip("mcap.reader")
DecoderFactory = pytest.importorskip("mcap_ros2.decoder").DecoderFactory

#: A column each: epochs by the names of the fields of `/insnav/state`, measurements by those of `/insnav/updates` after "update".
Table = dict[str, NDArray[Any]]

#: Columns that are numbers of the message as they are, and those that are told otherwise.
FIELDS = [
    name
    for column in _frames.COLUMNS
    for name in column.flat
    if name not in ("time_s", "time_ns", "standing")
]
UPDATES = ("measurement", "dof", "residual", "sigma", "nis")
VERDICTS = np.array(["accepted", "inflated", "rejected", "reset", "frozen"])


def numbers(values: list[Any]) -> NDArray[Any]:
    # JSON has no NaN.
    return np.array([np.nan if value is None else value for value in values])


def by_rust(program: Path, log: Path) -> Table:
    said = subprocess.run([str(program), str(log), "json"], capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    rows = [json.loads(line) for line in said.stdout.splitlines()]
    states = [row for row in rows if "latitude_deg" in row]
    updates = [row for row in rows if "verdict" in row]
    return {
        "time_ns": np.array([row["header"] for row in states]),
        "standing": numbers([row["motion"] for row in states]) == 1,
        **{name: numbers([row[name] for row in states]) for name in FIELDS},
        "update_time_ns": np.array([row["time"] for row in updates]),
        "update_verdict": np.array([row["verdict"] for row in updates]),
        **{f"update_{name}": numbers([row[name] for row in updates]) for name in UPDATES},
    }


def by_command(command: Path, log: Path, out: Path) -> Table:
    said = subprocess.run([str(command), "run", str(log), "-o", str(out), "--format", "json"], capture_output=True, text=True)
    assert said.returncode == 0, said.stderr

    def messages(topic: str) -> list[Any]:
        with out.open("rb") as stream:
            reader = mcap_reader.make_reader(stream, decoder_factories=[DecoderFactory()])
            return [m.decoded_message for m in reader.iter_decoded_messages(topics=[topic])]

    def stamps(of: list[Any]) -> NDArray[np.int64]:
        return np.array([m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in of])

    states, updates = messages("/insnav/state"), messages("/insnav/updates")
    return {
        "time_ns": stamps(states),
        "standing": np.array([s.motion for s in states]) == 1,
        **{name: np.array([getattr(s, name) for s in states]) for name in FIELDS},
        "update_time_ns": stamps(updates),
        "update_verdict": VERDICTS[[u.verdict for u in updates]],
        **{f"update_{name}": np.array([getattr(u, name) for u in updates]) for name in UPDATES},
    }


def by_python(log: Path, config: dict[str, Any] | None = None) -> Table:
    with warnings.catch_warnings():
        # Real logs have something to warn of, which is not what this test is about.
        warnings.simplefilter("ignore", insnav.InsnavWarning)
        s = insnav.run(log, config)
    flat = _frames.flat(s)
    return {
        **{name: flat[name] for name in ("time_ns", "standing", *FIELDS)},
        # Seconds of a drive tell nanoseconds.
        "update_time_ns": s.t0_ns + np.rint(s.updates.time_s * 1e9).astype(np.int64),
        "update_verdict": s.updates.verdict,
        **{f"update_{name}": getattr(s.updates, name) for name in UPDATES},
    }


def different(a: Table, b: Table) -> list[str]:
    """Columns that are not the same to the last bit."""
    assert a.keys() == b.keys()
    return [name for name in a if not np.array_equal(a[name], b[name], equal_nan=a[name].dtype.kind == "f")]


@pytest.mark.parametrize("log", ["mcap_real/rtkexp_drive_ros2_zstd.mcap", "mcap_real/comma2k19_ros2_lz4.mcap"])
def test_command_rust_and_python_agree_to_the_last_bit(
    log: str, data: Path, command: Path, rust_example: Path, tmp_path: Path
) -> None:
    rust = by_rust(rust_example, data / log)
    assert len(rust["time_ns"]) > 1000 and len(rust["update_nis"]) > 100
    assert len(rust) > 60
    assert different(rust, by_command(command, data / log, tmp_path / "out.mcap")) == []
    assert different(rust, by_python(data / log)) == []


def test_one_bit_of_a_setting_is_seen(data: Path) -> None:
    """The control: a lever arm that is longer by a unit in the last place (2e-16 m) is another solution in nearly every column."""
    log = data / "mcap_real/comma2k19_ros2_lz4.mcap"
    arm = {"gnss": {"lever_arm_b_m": [1.0, 0.0, 0.0]}}
    longer = {"gnss": {"lever_arm_b_m": [float(np.nextafter(1.0, 2.0)), 0.0, 0.0]}}
    table = by_python(log, arm)
    assert different(table, by_python(log, arm)) == []
    seen = different(table, by_python(log, longer))
    # Latitude and longitude are told in steps of 1e-9 m at best.
    for name in ("height_m", "velocity_north_m_per_s", "heading_deg", "accel_bias_x_mg", "attitude_covariance_nn_rad2", "update_residual", "update_nis"):
        assert name in seen
    assert len(seen) > len(table) / 2
    assert not {"time_ns", "update_time_ns", "update_measurement"} & set(seen)
