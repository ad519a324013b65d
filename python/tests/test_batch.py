"""`insnav.batch.map`: on processes and on a cluster, with workers that die, interrupted, resumed."""

from __future__ import annotations

import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
import uuid
import warnings
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insnav
from insnav import _cluster, _locks, _workers, batch
from insnav._jobs import Task, do_all
from insnav._records import Record, hash_of_file

CONFIG: dict[str, Any] = {"imu": {"grade": "consumer"}, "gnss": {"lever_arm_b_m": [0.0, 0.0, 0.0]}}

@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Five drives, three of which have the same name; the last is long enough to be killed in."""
    folder = tmp_path_factory.mktemp("fleet")
    logs = []
    for seed, (name, duration_s) in enumerate(
        [("monday/log", 90.0), ("tuesday/log", 100.0), ("wednesday/log", 110.0), ("short", 90.0), ("long", 600.0)]
    ):
        log = folder / f"{name}.mcap"
        log.parent.mkdir(exist_ok=True)
        insnav.write_mcap(log, insnav.sim.Scenario.car_drive(duration_s).simulate(seed))
        logs.append(log)
    return logs


@pytest.fixture(scope="module")
def serial(fleet: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What one run after the other makes of them, in this process."""
    folder = tmp_path_factory.mktemp("serial")
    result = batch.map(fleet, CONFIG, output_dir=folder, workers=0)
    assert not result.failures, result
    return folder


def contents(folder: Path, pattern: str = "*.mcap") -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob(pattern))}


def records(folder: Path) -> dict[str, Any]:
    return {path.name: json.loads(path.read_text()) for path in folder.glob("*.json")}


def test_every_log_is_run_as_run_does(fleet: list[Path], serial: Path, tmp_path: Path) -> None:
    told: list[tuple[int, int, Any]] = []
    result = batch.map(
        [*fleet, fleet[0]], CONFIG, output_dir=tmp_path, workers=2, progress=lambda *what: told.append(what)
    )
    assert [run.file for run in result.runs] == fleet and not result.failures and not result.skipped
    assert contents(tmp_path) == contents(serial)
    assert sorted(what[0] for what in told) == [1, 2, 3, 4, 5] and {what[2] for what in told} == set(fleet)
    for run in result.runs:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", insnav.InsnavWarning)
            alone = insnav.run(run.file, CONFIG)
        assert run.output is not None
        assert {**run.summary, "elapsed_s": 0} == {**alone.summary, "elapsed_s": 0}
    table = result.table
    assert table["file"].tolist() == [str(log) for log in fleet]
    assert np.array_equal(table["duration_s"], [run.summary["duration_s"] for run in result.runs])
    assert {name: column.dtype.kind for name, column in table.items()} == {
        name: column.dtype.kind for name, column in batch.map(fleet[:1], workers=0).table.items()
    }
    assert "batch_failed" not in str(result) and "5 of 5 finished" in str(result)


def test_outputs_of_one_name_lie_side_by_side_or_as_the_logs_do(fleet: list[Path], serial: Path, tmp_path: Path) -> None:
    names = [run.output.name for run in batch.map(fleet[:3], CONFIG, output_dir=serial, workers=0).runs if run.output]
    assert len(set(names)) == 3 and all(name.startswith("log-") for name in names)
    root = Path(os.path.commonpath(fleet))
    result = batch.map(fleet, CONFIG, output_dir=tmp_path, root=root, workers=2)
    outputs = [str(run.output.relative_to(tmp_path)) for run in result.runs if run.output]
    assert outputs == [f"{log.relative_to(root).with_suffix('')}.insnav.mcap" for log in fleet]
    with pytest.raises(insnav.ArgumentError, match="root"):
        batch.map(fleet, output_dir=tmp_path, root=tmp_path)


def test_failures_are_named_and_stop_nothing(fleet: list[Path], tmp_path: Path) -> None:
    noise = tmp_path / "noise.mcap"
    noise.write_bytes(b"This is no log." * 10)
    files = [tmp_path / "missing.mcap", fleet[3], noise]
    ways: list[dict[str, Any]] = [{"workers": 0}, {"workers": 2}, {"workers": 1, "output_dir": tmp_path / "out"}]
    for options in ways:
        result = batch.map(files, CONFIG, **options)
        assert [run.file for run in result.runs] == [fleet[3]]
        missing, broken = result.failures
        for failure in [missing, broken]:
            with pytest.raises(insnav.InsnavError) as caught:
                insnav.run(str(failure.item))
            expected = caught.value
            assert (failure.error, failure.code, failure.message, failure.remedy) == (
                type(expected).__name__,
                expected.code,
                expected.message,
                expected.remedy,
            )
        with pytest.raises(insnav.InsnavError, match=r"1 of 3 finished(.|\n)*missing(.|\n)*noise"):
            result.raise_failures()
    batch.map([fleet[3]], CONFIG, workers=0).raise_failures()


def test_what_is_wrong_for_all_is_said_once_and_at_once(fleet: list[Path], tmp_path: Path) -> None:
    with pytest.raises(insnav.InsnavError, match="lever_arm"):
        batch.map(fleet, {"gnss": {"lever_arm": [0, 0, 0]}})
    settings = tmp_path / "car.toml"
    settings.write_text("[gnss]\nlever_arm = [0, 0, 0]\n")
    with pytest.raises(insnav.InsnavError, match="car.toml"):
        batch.map(fleet, settings)
    with pytest.raises(TypeError, match="output: not a keyword"):
        batch.map(fleet, output="here")
    with pytest.raises(TypeError, match="smoothing: not a keyword"):
        batch.map(fleet, smoothing=True)
    with pytest.raises(insnav.ArgumentError, match="each: .*elsewhere"):
        batch.map(fleet, each={"elsewhere.mcap": {}})
    with pytest.raises(insnav.ArgumentError, match="workers"):
        batch.map(fleet, workers=-1)


def test_a_log_may_have_settings_of_its_own(fleet: list[Path]) -> None:
    logs = fleet[:2]
    own = {"imu": {"grade": "industrial"}}
    by_mapping = batch.map(logs, CONFIG, each={os.path.relpath(logs[1]): {"config": own}}, workers=0)
    by_function = batch.map(logs, CONFIG, each=lambda log: {"config": own} if log == logs[1] else None, workers=2)
    for result in [by_mapping, by_function]:
        assert result.table["imu_grade"].tolist() == ["consumer", "industrial"]
    withheld = batch.map(logs, CONFIG, each={logs[0]: {"withhold": "every:2"}}, time_offset_s=0.0, workers=0)
    assert withheld.runs[0].summary["withheld"] > 0 == withheld.runs[1].summary["withheld"]


def test_settings_from_a_file_are_those_of_the_mapping(fleet: list[Path], serial: Path, tmp_path: Path) -> None:
    settings = tmp_path / "car.toml"
    settings.write_text('# A comment.\n[gnss]\nlever_arm_b_m = [0.0, 0.0, 0.0]\n[imu]\ngrade = "consumer"\n')
    assert batch.map(fleet, settings, output_dir=serial, workers=0).skipped == tuple(fleet)


def test_skips_what_is_finished_and_only_that(fleet: list[Path], serial: Path, tmp_path: Path) -> None:
    logs = [shutil.copy(log, tmp_path / f"{n}.mcap") for n, log in enumerate(fleet[:3])]
    out = tmp_path / "out"

    def again(config: Any = CONFIG, **options: Any) -> list[int]:
        """Which are run anew."""
        result = batch.map(logs, config, output_dir=out, workers=0, **options)
        assert len(result.runs) == 3
        return [n for n, run in enumerate(result.runs) if not run.skipped]

    assert again() == [0, 1, 2]
    before, first = contents(out), batch.map(logs, CONFIG, output_dir=out, workers=0)
    assert again() == []
    # By content: neither the stamp of a file counts, nor the order of keys, nor what is not given.
    os.utime(logs[0])
    assert again({"gnss": {**CONFIG["gnss"], "time_offset_s": None}, "imu": CONFIG["imu"]}, withhold=None) == []
    assert batch.map(logs, CONFIG, output_dir=out, workers=0).runs[1].summary == first.runs[1].summary
    outputs = [run.output for run in first.runs if run.output is not None]
    # Each of these makes one run invalid.
    outputs[0].write_bytes(outputs[0].read_bytes()[:-1])
    outputs[1].unlink()
    record = outputs[2].with_suffix(".json")
    record.write_text(record.read_text()[:100])
    assert again() == [0, 1, 2] and contents(out) == before
    shutil.copy(fleet[3], logs[1])
    assert again() == [1]
    assert contents(out) != before
    shutil.copy(fleet[1], logs[1])
    assert again() == [1] and contents(out) == before
    assert again({"imu": {"grade": "industrial"}}) == [0, 1, 2]
    assert again(withhold="every:2") == [0, 1, 2]
    assert again(withhold="every:2") == []
    assert again(resume=False) == [0, 1, 2] and contents(out) == before
    stored = json.loads(record.read_text())
    assert stored["begun"] == 1 and stored["inputs"]["insnav"] == insnav.__version__
    stored["inputs"]["insnav"] = "0.0.1"
    record.write_text(json.dumps(stored))
    assert again() == [2]


def test_a_file_of_somebody_else_is_left_alone(fleet: list[Path], tmp_path: Path) -> None:
    (run,) = batch.map(fleet[:1], CONFIG, output_dir=tmp_path, workers=0).runs
    assert run.output is not None
    run.output.with_suffix(".json").unlink()
    run.output.write_bytes(b"precious")
    (failure,) = batch.map(fleet[:1], CONFIG, output_dir=tmp_path, workers=0).failures
    assert failure.error == "LogError" and failure.code == "output_exists" and str(run.output) in failure.message
    assert run.output.read_bytes() == b"precious"


OURS = '{\n "batch": "' + "0123456789abcdef" * 2 + '",\n "begun": 1,'


@pytest.mark.parametrize("text", ['{"steps": [1, 2]}', '{"inputs": {}}', '{"batch": "x", "inputs": 5}', "[]", "My notes.", '{\n "speed'])
def test_a_record_of_somebody_else_is_left_alone(text: str, fleet: list[Path], tmp_path: Path) -> None:
    (run,) = batch.map(fleet[:1], CONFIG, output_dir=tmp_path, workers=0).runs
    assert run.output is not None
    record, made = run.output.with_suffix(".json"), run.output.read_bytes()
    record.write_text(text)
    (failure,) = batch.map(fleet[:1], CONFIG, output_dir=tmp_path, workers=0).failures
    assert failure.error == "LogError" and failure.code == "output_exists" and str(record) in failure.message
    assert record.read_text() == text and run.output.read_bytes() == made


@pytest.mark.parametrize(
    ("text", "known"), [(OURS, True), (OURS[:46], True), (OURS[:20], False), (OURS[:1], False), ("", False)]
)
def test_a_record_that_was_cut_is_evidence_once_it_names_its_call(text: str, known: bool, tmp_path: Path) -> None:
    record = Record(tmp_path / "a.json", {}, uuid.uuid4().hex, tmp_path / "a.mcap")
    record.path.write_text(text)
    record.claim()
    (tmp_path / "a.mcap").write_bytes(b"something")
    if known:
        record.claim()
    else:
        with pytest.raises(insnav.LogError, match="no record"):
            record.claim()


def test_two_batches_in_one_folder_never_mix(fleet: list[Path], serial: Path, tmp_path: Path) -> None:
    results: list[batch.BatchResult] = []

    def work(settings: dict[str, Any]) -> None:
        results.append(batch.map(fleet[:3], settings, output_dir=tmp_path, workers=1, resume=False))

    other = {"imu": {"grade": "industrial"}}
    threads = [threading.Thread(target=work, args=(settings,)) for settings in [CONFIG, other] * 2]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 4
    for name, record in records(tmp_path).items():
        output = tmp_path / name.replace(".json", ".mcap")
        assert record["output_sha256"] == hash_of_file(output)
        # The solution is that of the settings that the record is of.
        of_config = output.read_bytes() == (serial / output.name).read_bytes()
        assert of_config == (record["result"]["imu_grade"] == "consumer")
    for failure in [failure for result in results for failure in result.failures]:
        assert failure.code == "output_busy", failure
    assert len(records(tmp_path)) == 3 and not list(tmp_path.glob(".*"))


def test_a_record_is_not_stored_beside_the_output_of_another_call(tmp_path: Path) -> None:
    first, second = (Record(tmp_path / "a.json", {"n": n}, uuid.uuid4().hex, tmp_path / "a.mcap") for n in range(2))
    first.begin()
    second.begin()
    (tmp_path / "a.mcap").write_bytes(b"of whomever")
    with pytest.raises(insnav.LogError, match="another call works on it") as caught:
        first.finish({})
    assert caught.value.code == "output_busy" and first.result() is None
    second.finish({})
    assert second.result() is not None and first.result() is None


@pytest.mark.skipif(os.name != "posix", reason="locks of POSIX")
def test_who_works_on_an_output_is_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_locks, "GRACE_S", 0.1)
    mine, same = (Record(tmp_path / "a.json", {}, "a" * 32, tmp_path / "a.mcap") for _ in range(2))
    other = Record(tmp_path / "a.json", {}, "b" * 32, tmp_path / "a.mcap")
    order = []

    def wait() -> None:
        with same.alone():
            order.append("same")

    waiting = threading.Thread(target=wait)
    with mine.alone():
        with pytest.raises(insnav.LogError, match="another call"), other.alone():
            pass
        waiting.start()
        time.sleep(0.3)
        order.append("mine")
    waiting.join()
    assert order == ["mine", "same"]
    with other.alone():
        pass
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(os.name != "posix", reason="tells by signals who lives")
def test_clears_away_only_what_nobody_writes_any_more(tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    record = Record(tmp_path / "a.json", {}, uuid.uuid4().hex, tmp_path / "a.mcap")
    lives, dead, own = os.getppid(), ended.pid, os.getpid()
    kept = [f".a.mcap.{lives}.partial", f".a.json.{dead}-{'0' * 8}-{'1' * 8}.partial", ".a.mcap.notes.partial", f".a.mcap.{lives}.2.partial"]
    gone = [f".a.mcap.{dead}.partial", f".a.mcap.{dead}.1.partial", f".a.mcap.{own}.partial", f".a.json.{dead}.partial"]
    for name in kept + gone:
        (tmp_path / name).touch()
    record.begin()
    (tmp_path / "a.mcap").touch()
    record.finish({})
    assert sorted(path.name for path in tmp_path.glob(".*")) == sorted(kept)


INTERRUPTED = """
import multiprocessing, os, signal, sys, threading, time
from insnav._jobs import do_all

if __name__ == "__main__":
    threading.Timer(float(sys.argv[1]), os.kill, (os.getpid(), signal.SIGINT)).start()
    try:
        do_all(time.sleep, [60.0] * 2, [0, 1], workers=2, client=None, progress=None)
    except KeyboardInterrupt:
        begin = time.monotonic()
        while multiprocessing.active_children() and time.monotonic() < begin + 20:
            time.sleep(0.01)
        print("interrupted", len(multiprocessing.active_children()))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.parametrize("after", [0.1, 0.2, 0.3, 2.0])
def test_workers_end_however_early_the_batch_is_interrupted(after: float, tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(INTERRUPTED)
    done = subprocess.run([sys.executable, str(script), str(after)], capture_output=True, text=True, timeout=60)
    # Left alone they would sleep for a minute.
    assert done.stdout.split() == ["interrupted", "0"], done


INTERRUPTED_IN_MID_RUN = """
import os, signal, sys, threading, time
from pathlib import Path
from insnav import batch

if __name__ == "__main__":
    out = Path(sys.argv[1])

    def interrupt():
        while not list(out.glob(".long-*.mcap.*.partial")):
            time.sleep(0.002)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    try:
        batch.map(sys.argv[2:], {"output": {"rate_hz": 200.0}}, output_dir=out, workers=2)
    except KeyboardInterrupt:
        # What is seen by who catches it, not some time later.
        print(sorted(path.name for path in out.iterdir() if path.name.startswith(".")), flush=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="a process of Windows can only be killed")
def test_an_interrupted_batch_leaves_nothing_half_written(fleet: list[Path], tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(INTERRUPTED_IN_MID_RUN)
    for trial in range(3):
        out = tmp_path / f"out{trial}"
        done = subprocess.run(
            [sys.executable, str(script), str(out), str(fleet[4]), str(fleet[0])], capture_output=True, text=True, timeout=60
        )
        assert (done.stdout, done.stderr) == ("[]\n", ""), done


DEAF = """
import os, signal, sys, threading, time
from pathlib import Path
from insnav import _workers
from insnav._jobs import do_all

def hear_nothing(place):
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])
    Path(place).touch()
    time.sleep(60)

if __name__ == "__main__":
    _workers.GRACE_S, second = map(float, sys.argv[2:])
    places = [Path(sys.argv[1], name) for name in "ab"]
    begun = []

    def interrupt():
        while not all(place.exists() for place in places):
            time.sleep(0.002)
        begun.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(second)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    try:
        do_all(hear_nothing, places, [0, 1], workers=2, client=None, progress=None)
    except KeyboardInterrupt:
        print(time.monotonic() - begun[0], flush=True)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
"""


@pytest.mark.skipif(os.name != "posix", reason="a process of Windows can only be killed")
@pytest.mark.parametrize(("grace", "second", "least", "most"), [(0.5, 30.0, 0.5, 10.0), (30.0, 0.2, 0.2, 10.0)])
def test_workers_that_hear_nothing_are_killed(
    grace: float, second: float, least: float, most: float, tmp_path: Path
) -> None:
    """After the grace, or at the second interruption; the process itself ends too, which waits for all workers. They would sleep for a minute."""
    script = tmp_path / "script.py"
    script.write_text(DEAF)
    done = subprocess.run(
        [sys.executable, str(script), str(tmp_path), str(grace), str(second)], capture_output=True, text=True, timeout=25
    )
    assert least <= float(done.stdout) < most, done


def end_once(place: str) -> dict[str, Any]:
    """Told to end from elsewhere, as by a guard of the machine's memory, the first time."""
    if not Path(place).exists():
        Path(place).touch()
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(60)
    return {"place": place}


@pytest.mark.skipif(os.name != "posix", reason="a process of Windows can only be killed")
def test_a_worker_that_is_told_to_end_by_somebody_else_counts_as_killed(tmp_path: Path) -> None:
    place = str(tmp_path / "once")
    assert do_all(end_once, [place], [0], workers=1, client=None, progress=None) == [{"place": place}]


def test_a_worker_whose_successor_dies_too_has_lost_its_job(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        """An executor whose process has gone."""

        def submit(self, *_: Any) -> Any:
            raise BrokenProcessPool("gone")

        def shutdown(self, **_: Any) -> None:
            pass

    worker = _workers._Worker()
    worker.start()
    assert worker._pid.result() > 0
    worker.stop()
    begun = worker._pid
    monkeypatch.setattr(worker, "_pool", Broken())
    monkeypatch.setattr(worker, "start", lambda: None)
    monkeypatch.setattr(_workers, "_pool", Broken)
    assert isinstance(worker.submit(Task(abs, 1, 1)).exception(), BrokenProcessPool)
    assert worker._pid is begun


class NoCluster:
    """A client whose futures are done, and raise what a cluster raises outside of the task."""

    def submit(self, task: Task, key: str, pure: bool) -> Any:
        return self.Future(task)

    def cancel(self, futures: Any) -> None:
        raise AssertionError("nothing is to be cancelled")

    class Future:
        def __init__(self, task: Task) -> None:
            self.task = task

        def exception(self) -> None:
            if self.task.item == 2:
                raise RuntimeError("cancelled")

        def result(self) -> Any:
            if self.task.item in (1, 2):
                raise ModuleNotFoundError("No module named 'insnav'")
            return self.task()

        def release(self) -> None:
            pass


def test_what_a_cluster_raises_outside_of_a_task_is_that_ones_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    class Distributed:
        class KilledWorker(Exception):
            pass

        as_completed = staticmethod(iter)

    monkeypatch.setattr(_cluster, "needs", lambda name: Distributed)
    outcomes = do_all(number, list(range(4)), list(range(4)), workers=None, client=NoCluster(), progress=None)
    for n, outcome in enumerate(outcomes):
        if n in (1, 2):
            assert isinstance(outcome, batch.Failure) and outcome.item == n and outcome.error == "ModuleNotFoundError"
        else:
            assert outcome == {"number": n}


def number(item: int) -> dict[str, Any]:
    return {"number": item}


@pytest.mark.parametrize("unit", ["D", "s", "us", "ns"])
def test_a_start_on_a_date_is_refused_once(unit: str, fleet: list[Path]) -> None:
    date = np.array("2026-01-01", dtype=f"datetime64[{unit}]")[()]
    start: Any = {"time_s": date}
    with pytest.raises(insnav.ArgumentError, match="start: time_s is a date"):
        batch.map(fleet, CONFIG, start=start, workers=0)
    with pytest.raises(insnav.ArgumentError, match="start: time_s is a date"):
        batch.map(fleet, CONFIG, each={fleet[0]: {"start": {"time_s": date.item() if unit == "D" else date}}})


def test_a_start_that_is_wrong_for_all_is_refused_once(fleet: list[Path]) -> None:
    start: Any = {
        "latitude_deg_longitude_deg_height_m": [50.0, 14.0, 300.0],
        "velocity_n_m_per_s": [0.0] * 3,
        "roll_deg_pitch_deg_heading_deg": [0.0, 0.0, 90.0],
        "sigma_position_n_m": [1.0] * 3,
        "sigma_velocity_n_m_per_s": [0.1] * 3,
        "sigma_attitude_n_deg": [1.0] * 3,
    }
    wrong: list[tuple[Any, str]] = [
        ({**start, "latitude_deg": 50.0}, "unknown key `latitude_deg`"),
        ({**start, "sigma_position_n_m": [0.0, 1.0, 1.0]}, "sigma_position_n_m"),
        ({}, "is missing"),
        (3, "a mapping"),
    ]
    for given, words in wrong:
        with pytest.raises(insnav.ArgumentError, match=words) as caught:
            batch.map(fleet, CONFIG, start=given, workers=0)
        with pytest.raises(insnav.ArgumentError) as of_run:
            insnav.run(fleet[0], CONFIG, start=given)
        assert str(caught.value) == str(of_run.value)
    # It needs no instant: each log begins with it.
    for given in (start, {**start, "time_s": None}, {**start, "time_s": 1.0}):
        assert batch.map([], start=given, workers=0).runs == ()


def test_a_folder_that_cannot_be_is_told(fleet: list[Path], tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    for folder, why in ((file, "it is a file"), (file / "below", os.strerror(20))):
        for way in ("map", "monte_carlo"):
            with pytest.raises(insnav.LogError, match=why) as caught:
                if way == "map":
                    batch.map(fleet[:1], CONFIG, output_dir=folder, workers=0)
                else:
                    batch.monte_carlo(insnav.sim.Scenario.standing(2.0), 1, output_dir=folder, workers=0)
            assert caught.value.path == str(folder) and caught.value.code == "output_not_writable" and caught.value.remedy


def mark_and_maybe_die(item: tuple[int, str]) -> dict[str, Any]:
    """Three is killed the first time, five each time, seven raises."""
    number, folder = item
    before = len(list(Path(folder).glob(f"{number}-*")))
    Path(folder, f"{number}-{before}").touch()
    if number == 5 or (number == 3 and before == 0):
        os.kill(os.getpid(), signal.SIGKILL)
    if number == 7:
        raise RuntimeError("seven")
    return {"number": number}


@pytest.mark.parametrize("workers", [1, 3])
def test_a_process_that_dies_takes_nobody_along(workers: int, tmp_path: Path) -> None:
    items = [(number, str(tmp_path)) for number in range(10)]
    outcomes = do_all(mark_and_maybe_die, items, list(range(10)), workers=workers, client=None, progress=None)
    for number, outcome in enumerate(outcomes):
        if number in (5, 7):
            assert isinstance(outcome, batch.Failure) and outcome.item == number
            assert outcome.error == {5: "WorkerDied", 7: "RuntimeError"}[number]
            assert ("mark_and_maybe_die" in outcome.traceback) == (number == 7)
        else:
            assert outcome == {"number": number}
    # Who did not die ran once.
    marks = sorted(path.name for path in tmp_path.iterdir())
    assert marks == sorted([f"{n}-0" for n in range(10)] + ["3-1", "5-1"])


def state(pid: int) -> str:
    """One letter: R running, S sleeping, T stopped, Z ended and waited for by nobody yet; empty where there is none."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return ""


by_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="tells by /proc what processes do")


def kill_one_in_mid_run(folder: Path, killed: list[int], stop: threading.Event) -> None:
    """The first process that writes the long solution: the name of what it has half written tells."""
    while not stop.is_set():
        for half in folder.glob(".long-*.mcap.*.partial"):
            pid = int(half.name.split(".")[-2])
            # Held still, so that it is killed in the midst of it and not just after.
            os.kill(pid, signal.SIGSTOP)
            until(lambda: state(pid) == "T")
            if half.exists():
                os.kill(pid, signal.SIGKILL)
                killed.append(pid)
                return
            os.kill(pid, signal.SIGCONT)
        time.sleep(0.002)


def until(condition: Callable[[], bool], limit_s: float = 20.0) -> bool:
    end = time.monotonic() + limit_s
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.01)
    return True


@by_proc
def test_a_run_whose_process_is_killed_is_run_again(fleet: list[Path], serial: Path, tmp_path: Path) -> None:
    killed: list[int] = []
    stop = threading.Event()
    killer = threading.Thread(target=kill_one_in_mid_run, args=(tmp_path, killed, stop))
    killer.start()
    result = batch.map(fleet, CONFIG, output_dir=tmp_path, workers=2)
    stop.set()
    killer.join()
    assert len(killed) == 1
    assert not result.failures and not result.skipped
    assert contents(tmp_path) == contents(serial)
    assert {name: record["begun"] for name, record in records(tmp_path).items()} == {
        name: 2 if name.startswith("long-") else 1 for name in records(serial)
    }
    assert not list(tmp_path.glob(".*")), "what died half-way is cleared away"


@by_proc
def test_a_cluster_loses_nothing_and_does_nothing_twice(fleet: list[Path], serial: Path, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="distributed is not installed")
    killed: list[int] = []
    stop = threading.Event()
    killer = threading.Thread(target=kill_one_in_mid_run, args=(tmp_path, killed, stop))
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        workers = set(client.run(os.getpid).values())
        assert len(workers) == 2
        late: list[int] = []

        def wait_for_all_then_kill(done: int, total: int, item: Any) -> None:
            """Results that are finished, but in the memory of their worker only, are lost with it."""
            if done > 1:
                return
            # Who waits in vain goes on, and fails below: `late` is then empty.
            if not until(lambda: sum("result" in record for record in records(tmp_path).values()) == total, 60.0):
                return
            pid = next(iter(client.run(os.getpid).values()))
            os.kill(pid, signal.SIGKILL)
            late.append(pid)

        killer.start()
        result = batch.map(fleet, CONFIG, output_dir=tmp_path, client=client, progress=wait_for_all_then_kill)
        stop.set()
        killer.join()
        assert len(killed) == 1 and killed[0] in workers and len(late) == 1
        again = batch.map(fleet, CONFIG, output_dir=tmp_path, client=client)
    assert [run.file for run in result.runs] == fleet and not result.failures and not result.skipped
    assert contents(tmp_path) == contents(serial)
    assert {name: record["begun"] for name, record in records(tmp_path).items()} == {
        name: 2 if name.startswith("long-") else 1 for name in records(serial)
    }
    assert again.skipped == tuple(fleet)
    assert [run.summary for run in again.runs] == [run.summary for run in result.runs]


def test_a_job_that_kills_every_worker_of_a_cluster_is_named(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="distributed is not installed")
    items = [(number, str(tmp_path)) for number in range(10)]
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        outcomes = do_all(mark_and_maybe_die, items, list(range(10)), workers=None, client=client, progress=None)
    for number, outcome in enumerate(outcomes):
        if number in (5, 7):
            assert isinstance(outcome, batch.Failure)
            assert outcome.error == {5: "WorkerDied", 7: "RuntimeError"}[number]
        else:
            assert outcome == {"number": number}


SCRIPT = """
import sys
from insnav import batch

def tell(done, total, log):
    print(done, log, flush=True)

if __name__ == "__main__":
    batch.map(sys.argv[2:], {config!r}, output_dir=sys.argv[1], workers=2, progress=tell)
"""


def start_script(out: Path, fleet: list[Path], text: str = SCRIPT) -> subprocess.Popen[str]:
    script = out.parent / "script.py"
    script.write_text(text.replace("{config!r}", repr(CONFIG)))
    arguments = [sys.executable, str(script), str(out), *map(str, [fleet[4], *fleet[:4]])]
    return subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@by_proc
@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGKILL])
def test_a_batch_that_was_interrupted_goes_on(end: signal.Signals, fleet: list[Path], serial: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    script = start_script(out, fleet)
    assert script.stdout is not None
    first = script.stdout.readline().split()
    # The long one is under way on the other worker.
    assert until(lambda: bool(list(out.glob(".long-*.mcap.*.partial"))))
    halves = list(out.glob(".long-*.mcap.*.partial"))
    script.send_signal(end)
    script.communicate(timeout=20)
    assert script.returncode != 0 and len(first) == 2 and len(halves) == 1
    worker = int(halves[0].name.split(".")[-2])
    assert until(lambda: state(worker) in ("", "Z")), "no worker outlives the batch"
    finished = [name for name, record in records(out).items() if "result" in record]
    assert 1 <= len(finished) < 5
    result = batch.map(fleet, CONFIG, output_dir=out, workers=2)
    assert not result.failures and len(result.skipped) == len(finished) and Path(first[1]) in result.skipped
    assert contents(out) == contents(serial)
    assert not list(out.glob(".*"))


def test_a_script_without_its_guard_is_told(fleet: list[Path], tmp_path: Path) -> None:
    script = start_script(tmp_path / "out", fleet, SCRIPT.replace('__name__ == "__main__"', "True"))
    _, said = script.communicate(timeout=60)
    assert script.returncode != 0
    # Python's own tracker of semaphores may have the last word: two lines, what it warns of and where.
    told = [line for line in said.splitlines() if "resource_tracker" not in line]
    assert 'below `if __name__ == "__main__":`' in told[-1], said


def test_tells_of_progress_where_somebody_looks(
    fleet: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    batch.map(fleet[3:4], CONFIG, workers=0)
    assert capsys.readouterr().err == "", "no terminal"
    batch.map(fleet[3:4], CONFIG, workers=0, progress=True)
    assert capsys.readouterr().err == f"1/1 {fleet[3]}\n"


def test_nothing_to_do_is_done() -> None:
    for workers in [0, None]:
        result = batch.map([], workers=workers)
        assert result.runs == () == result.failures and result.table == {}
    assert not multiprocessing.active_children()
