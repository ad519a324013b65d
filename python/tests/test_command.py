"""The command in the wheel is the command."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def installed() -> Path:
    """The script that the wheel has put beside the interpreter."""
    path = Path(sysconfig.get_path("scripts")) / "insnav"
    assert path.is_file(), f"no script at {path}"
    return path


@pytest.fixture(scope="module")
def log(installed: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated log, large enough for half a minute of driving."""
    folder = tmp_path_factory.mktemp("logs")
    scenario = folder / "scenario.toml"
    example = subprocess.run([installed, "simulate", "--example"], check=True, capture_output=True, timeout=60).stdout
    scenario.write_bytes(example)
    subprocess.run([installed, "simulate", scenario, "-o", folder / "drive.mcap"], check=True, capture_output=True, timeout=300)
    return folder / "drive.mcap"


def both(installed: Path, command: Path, *arguments: object, **options: object) -> subprocess.CompletedProcess[bytes]:
    """The same arguments to both, which must answer alike; the answer of the installed one."""
    texts = [str(a) for a in arguments]
    ours, theirs = (
        subprocess.run([program, *texts], capture_output=True, timeout=300, **options)  # type: ignore[call-overload]
        for program in (installed, command)
    )
    assert (ours.returncode, ours.stdout, ours.stderr) == (theirs.returncode, theirs.stdout, theirs.stderr)
    result: subprocess.CompletedProcess[bytes] = ours
    return result


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--version"], 0),
        (["--help"], 0),
        (["run", "--help"], 0),
        ([], 2),
        (["fly"], 2),
        (["run", "--nonsense"], 2),
        (["run", "nowhere.mcap"], 1),
        (["run", "nowhere.mcap", "--format", "json"], 1),
        (["info", "."], 1),
        (["completions", "bash"], 0),
    ],
)
def test_says_and_ends_the_same(installed: Path, command: Path, arguments: list[str], code: int, tmp_path: Path) -> None:
    assert both(installed, command, *arguments, cwd=tmp_path).returncode == code


def test_runs_a_log_to_the_last_byte(installed: Path, command: Path, log: Path, tmp_path: Path) -> None:
    assert b"/imu" in both(installed, command, "info", log).stdout
    outputs = []
    for name, program in [("ours", installed), ("theirs", command)]:
        target = tmp_path / f"{name}.mcap"
        subprocess.run([program, "run", log, "-o", target, "--format", "json"], check=True, capture_output=True, timeout=300)
        outputs.append(target.read_bytes())
    assert outputs[0] == outputs[1] and len(outputs[0]) > 1000


def test_streams(installed: Path, command: Path, log: Path) -> None:
    with log.open("rb") as stream:
        ours = subprocess.run([installed, "run", "-", "-o", "-"], stdin=stream, capture_output=True, check=True, timeout=300)
    with log.open("rb") as stream:
        theirs = subprocess.run([command, "run", "-", "-o", "-"], stdin=stream, capture_output=True, check=True, timeout=300)
    assert ours.stdout == theirs.stdout and ours.stdout.startswith(b"\x89MCAP0\r\n") and ours.stdout.endswith(b"\x89MCAP0\r\n")


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_a_reader_that_goes_away_ends_it(installed: Path, command: Path, log: Path) -> None:
    codes = []
    for program in (installed, command):
        with subprocess.Popen([program, "run", str(log), "-o", "-"], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            assert process.stdout is not None and process.stderr is not None
            process.stdout.close()
            codes.append((process.wait(timeout=300), process.stderr.read()))
    assert codes[0] == codes[1] and codes[0][0] in (0, 141)


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it(installed: Path, tmp_path: Path, end: signal.Signals) -> None:
    # A pipe that nobody writes to: it waits for its log for ever, the output begun or not.
    target = tmp_path / "out.mcap"
    with subprocess.Popen([installed, "run", "-", "-o", target], stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        time.sleep(1.0)
        assert process.poll() is None
        sent = time.monotonic()
        process.send_signal(end)
        code = process.wait(timeout=10)
        latency = time.monotonic() - sent
    assert code == 128 + end
    assert latency < 0.5, latency
    assert list(tmp_path.iterdir()) == []


def test_starts_without_numpy(installed: Path) -> None:
    names = "import sys; sys.argv = ['insnav', '--version']; import insnav_command\ntry: insnav_command.main()\nexcept SystemExit as end: print(end.code, sorted({'numpy', 'insnav'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", names], capture_output=True, check=True, text=True, timeout=60)
    assert done.stdout.splitlines()[-1] == "0 []"


def test_is_on_the_path(installed: Path) -> None:
    assert shutil.which("insnav", path=str(installed.parent)) == str(installed)
