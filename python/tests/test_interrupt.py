"""Ctrl-C ends long work at once, leaves nothing behind, and the process goes on; other threads run meanwhile.

The bar is 0.2 s from the signal to the exception. What is measured holds for any build: work is waited for in steps of 25 ms, whatever it is.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import insnav

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")

BAR_S = 0.2

# An hour at 200 Hz and its fixes: the vehicle stands, since what is measured is the time to the end, not the solution.
PRELUDE = """
import os, signal, sys, threading, time
from pathlib import Path
import numpy as np
import insnav

rng = np.random.default_rng(0)
n = 720_000
t = np.arange(n) / 200
gyro = rng.normal(0, 1e-4, (n, 3))
accel = rng.normal(0, 1e-2, (n, 3)) - [0, 0, 9.81]
g = np.arange(3600.0)
place = np.column_stack([np.full(3600, 45.0), np.full(3600, 7.0), np.full(3600, 300.0)]) + rng.normal(0, 1e-7, (3600, 3))
arrays = {"imu": (t, gyro, accel), "gnss_position": (g, place, [1.0, 1.0, 2.0])}
nu = rng.normal(size=(n, 3))
F, G, H = np.eye(3) * 0.9, np.eye(3), np.eye(3)
folder = Path(sys.argv[2])
still = insnav.mechanization.NavState.from_degrees(45.0, 7.0, 300.0)

start = {
    "time_s": 0.0,
    "latitude_deg_longitude_deg_height_m": [45.0, 7.0, 300.0],
    "velocity_n_m_per_s": [0.0] * 3,
    "roll_deg_pitch_deg_heading_deg": [0.0] * 3,
    "sigma_position_n_m": [1.0] * 3,
    "sigma_velocity_n_m_per_s": [0.1] * 3,
    "sigma_attitude_n_deg": [1.0] * 3,
}

# What is given is there before the work begins.
if sys.argv[1] == "from_ecef":
    places = np.full((10_000_000, 3), 4e6)
if sys.argv[1] in ("align_record", "write_mcap"):
    long = np.arange(5 * n) / 200, np.tile(gyro, (5, 1)), np.tile(accel, (5, 1))

if sys.argv[1] == "compare":
    three, cov = np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1))
    columns = {"t0_ns": 0, "time_s": t, "latitude_deg": 45.0 + 0 * t, "longitude_deg": 7.0 + 0 * t, "height_m": 300.0 + 0 * t}
    columns |= {"velocity_n_m_per_s": three, "roll_deg": 0 * t, "pitch_deg": 0 * t, "heading_deg": 0 * t, "position_covariance_n_m2": cov}
    columns |= {"velocity_covariance_n_m2_per_s2": cov, "attitude_covariance_n_rad2": cov, "rate_b_deg_per_s": three}

def propagate():
    eskf = insnav.Eskf(still, "industrial", position_sigma=1.0, velocity_sigma=0.1, attitude_sigma=0.1)
    eskf.propagate(0.005, np.tile(gyro * 0.005, (3, 1)), np.tile(accel * 0.005, (3, 1)))

work = {
    "run": lambda: insnav.run(arrays),
    "run_to_file": lambda: insnav.run(arrays, {"output": {"rate_hz": 200.0}}, output=folder / "out.mcap", time_offset_s=0.0),
    "ahrs": lambda: insnav.ahrs(t, gyro, accel),
    "identify_noise": lambda: insnav.noise.identify_noise(t, gyro, accel),
    "als_estimate": lambda: insnav.noise.als_estimate(nu, F, G, H, np.ones(6), lags=200),
    "lag_covariance": lambda: insnav.noise.lag_covariance(nu, 2000),
    "mdm_estimate": lambda: insnav.noise.mdm_estimate(nu, F, G, H),
    "eskf": propagate,
    "overlapping_allan": lambda: insnav.noise.overlapping_allan(np.tile(nu[:, 0], 20), 0.005),
    "batch": lambda: insnav.Navigator(start=start).batch(arrays),
    "simulate": lambda: insnav.sim.Scenario.car_drive(20_000.0).simulate(1),
    "detect": lambda: insnav.stationary.detect(arrays),
    "attitude_filter": lambda: insnav.AttitudeFilter().run(t, gyro, accel),
    "write_mcap": lambda: insnav.write_mcap(folder / "log.mcap", {"imu": long}),
    "kozadaev2017": lambda: insnav.sim.kozadaev2017(100, jobs=1),
    "lobusov2014": lambda: insnav.sim.lobusov2014(100, jobs=1),
    "belokurov2018": lambda: insnav.sim.belokurov2018(100, jobs=1),
    "forgetting": lambda: insnav.noise.ForgettingProcessNoise(np.eye(30)).run(np.ones((30, 3)), nu[:100_000]),
    "lag_accumulator": lambda: insnav.noise.LagAccumulator(3, 5000).run(nu),
    "from_ecef": lambda: insnav.earth.from_ecef(places),
    "white_noise": lambda: insnav.sim.white_noise(100_000_000, 1),
    "gauss_markov": lambda: insnav.sim.gauss_markov(100_000_000, 1.0, sigma=1.0, tau_s=9.0, seed=1),
    "align_record": lambda: insnav.align.Record(*long),
    "compare": lambda: insnav.compare(columns, columns),
}[sys.argv[1]]
"""

# The signal comes from another thread of the process, which also counts whether it gets to run.
INTERRUPTED = PRELUDE + """
sent = []
def interrupt(after):
    time.sleep(after)
    sent.append(time.perf_counter())
    os.kill(os.getpid(), signal.SIGINT)

for after in map(float, sys.argv[3:]):
    threading.Thread(target=interrupt, args=(after,), daemon=True).start()
    try:
        work()
    except KeyboardInterrupt:
        print("interrupted", time.perf_counter() - sent.pop(), sorted(p.name for p in folder.iterdir()))
    else:
        # Done before the signal came: it must not meet what follows.
        try:
            time.sleep(60)
        except KeyboardInterrupt:
            pass
        print("ended", sorted(p.name for p in folder.iterdir()))
        break
# The process goes on as before.
small = {"imu": (t[:6000], gyro[:6000], accel[:6000]), "gnss_position": (g[:30], place[:30], [1.0, 1.0, 2.0])}
print(len(insnav.run(small)) > 0)
"""


def python(script: str, *arguments: object) -> list[str]:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", script, *map(str, arguments)], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.parametrize(
    "work",
    [
        "run",
        "run_to_file",
        "ahrs",
        "identify_noise",
        "als_estimate",
        "lag_covariance",
        "mdm_estimate",
        "overlapping_allan",
        "batch",
        "eskf",
        "simulate",
        "detect",
        "attitude_filter",
        "write_mcap",
        "kozadaev2017",
        "lobusov2014",
        "belokurov2018",
        "forgetting",
        "lag_accumulator",
        "from_ecef",
        "white_noise",
        "gauss_markov",
        "align_record",
        "compare",
    ],
)
def test_ctrl_c_ends_it(work: str, tmp_path: Path) -> None:
    *lines, alive = python(INTERRUPTED, work, tmp_path, 0.15, 0.6)
    assert alive == "True"
    assert lines[0].startswith("interrupted"), lines
    for line in lines:
        if line.startswith("interrupted"):
            _, latency, *left = line.split(maxsplit=2)
            assert left == ["[]"], line
            assert float(latency) < BAR_S, line
    print(work, lines)


# The signal comes so long after the file was begun; what lay in the folder at that instant is told.
BEGUN = PRELUDE + """
there = []
def interrupt(after):
    while not any(folder.iterdir()):
        time.sleep(0.001)
    time.sleep(after)
    there.append(any(folder.iterdir()))
    there.append(time.perf_counter())
    os.kill(os.getpid(), signal.SIGINT)

for after in map(float, sys.argv[3:]):
    threading.Thread(target=interrupt, args=(after,), daemon=True).start()
    try:
        work()
    except KeyboardInterrupt:
        sent, begun = there.pop(), there.pop()
        print(begun, time.perf_counter() - sent, sorted(p.name for p in folder.iterdir()))
"""


def test_a_file_is_given_up_while_the_run_does_not_listen(tmp_path: Path) -> None:
    """An hour at rest looks for its heading once, for a quarter of a second, when the file has been begun."""
    instants = np.arange(0.0, 0.40, 0.04)
    lines = python(BEGUN, "run_to_file", tmp_path, *instants)
    assert len(lines) == len(instants), lines
    for line in lines:
        begun, latency, *left = line.split(maxsplit=2)
        # It was there when the signal came: else nothing was given up.
        assert begun == "True", lines
        assert left == ["[]"], lines
        assert float(latency) < BAR_S, lines


def test_no_file_is_begun_after_an_interruption(tmp_path: Path) -> None:
    """A drive is simulated before its file is begun, and nobody would remove a file any more. A folder tells when it was last changed."""
    script = """
class Drive:
    scenario, seed = insnav.sim.Scenario.car_drive(4000.0), 1
begin = time.perf_counter()
Drive.scenario.simulate(1)
lasts = time.perf_counter() - begin
def changed():
    return folder.stat().st_mtime_ns
def interrupt():
    time.sleep(lasts / 5)
    os.kill(os.getpid(), signal.SIGINT)
before = changed()
threading.Thread(target=interrupt, daemon=True).start()
try:
    insnav.write_mcap(folder / "drive.mcap", Drive())
except KeyboardInterrupt:
    time.sleep(3 * lasts)
    print("interrupted", changed() == before)
# The control: a file that comes and goes.
(folder / "drive.mcap").touch()
(folder / "drive.mcap").unlink()
print(changed() == before)
"""
    assert python(PRELUDE + script, "run", tmp_path) == ["interrupted True", "False"]


def test_standard_output_that_nobody_reads_is_not_waited_for(tmp_path: Path) -> None:
    """Half of the run goes into a pipe that is full: standard output cannot be taken back, and nobody waits for that."""
    script = PRELUDE + """
def interrupt():
    time.sleep(float(sys.argv[3]))
    sent.append(time.perf_counter())
    os.kill(os.getpid(), signal.SIGINT)
sent = []
threading.Thread(target=interrupt, daemon=True).start()
try:
    insnav.run(arrays, {"output": {"rate_hz": 200.0}}, output="-", time_offset_s=0.0)
except KeyboardInterrupt:
    print(time.perf_counter() - sent[0], file=sys.stderr, flush=True)
os._exit(0)
"""
    with subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", script, "run", str(tmp_path), "3.0"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        try:
            process.wait(30)
            latency = process.stderr.read()
            # The control: it had begun to write.
            begun = os.read(process.stdout.fileno(), 8)
        finally:
            process.kill()
    assert begun == b"\x89MCAP0\r\n" and float(latency) < BAR_S


def test_arrays_in_memory_are_let_go_at_once(tmp_path: Path) -> None:
    """The clock of a signal of the kernel runs on where the interpreter is held, which a thread that sends one would wait for."""
    timed = """
class Enough(Exception): pass
def handler(*_): raise Enough
signal.signal(signal.SIGALRM, handler)
for after in [0.02, 0.1, 0.2]:
    signal.setitimer(signal.ITIMER_REAL, after)
    begin = time.perf_counter()
    try:
        work()
    except Enough:
        print(time.perf_counter() - begin - after)
"""
    latencies = [float(line) for line in python(PRELUDE + timed, "compare", tmp_path)]
    assert len(latencies) == 3 and max(latencies) < BAR_S, latencies


def test_sums_are_as_before_an_interrupted_run(tmp_path: Path) -> None:
    again = """
work = insnav.noise.LagAccumulator(3, 5000)
work.run(nu[:5100])
before = np.array(work.covariance)
threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
try:
    work.run(nu)
except KeyboardInterrupt:
    print(np.array_equal(before, work.covariance))
"""
    assert python(PRELUDE + again, "run", tmp_path) == ["True"]


def test_a_handler_of_ones_own_is_heard(tmp_path: Path) -> None:
    own = """
class Enough(Exception): pass
def handler(*_): raise Enough
signal.signal(signal.SIGALRM, handler)
signal.setitimer(signal.ITIMER_REAL, 0.2)
begin = time.perf_counter()
try:
    work()
except Enough:
    print("heard", time.perf_counter() - begin)
"""
    (line,) = python(PRELUDE + own, "run", tmp_path)
    assert line.startswith("heard") and float(line.split()[1]) < 0.2 + BAR_S


def test_an_output_that_was_begun_is_removed(tmp_path: Path) -> None:
    seen = """
def interrupt():
    while not any(folder.iterdir()):
        time.sleep(0.002)
    print("begun", flush=True)
    os.kill(os.getpid(), signal.SIGINT)
threading.Thread(target=interrupt, daemon=True).start()
try:
    work()
except KeyboardInterrupt:
    print(sorted(p.name for p in folder.iterdir()))
"""
    assert python(PRELUDE + seen, "run_to_file", tmp_path) == ["begun", "[]"]


def counted(work: Any) -> tuple[float, float]:
    """How far another thread counts while the work is done, and without it, both a second."""
    count, stop = [0], threading.Event()

    def run() -> None:
        while not stop.is_set():
            count[0] += 1

    thread = threading.Thread(target=run)
    thread.start()
    begin, at = time.perf_counter(), count[0]
    work()
    busy = (count[0] - at) / (time.perf_counter() - begin)
    begin, at = time.perf_counter(), count[0]
    time.sleep(0.3)
    free = (count[0] - at) / (time.perf_counter() - begin)
    stop.set()
    thread.join()
    return busy, free


@pytest.mark.filterwarnings("ignore::insnav.InsnavWarning")
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one core: who counts has to wait for who works")
def test_other_threads_run_meanwhile() -> None:
    rng = np.random.default_rng(0)
    n = 60_000
    t, gyro, accel = np.arange(n) / 200, rng.normal(0, 1e-4, (n, 3)), rng.normal(0, 1e-2, (n, 3)) - [0, 0, 9.81]
    place = np.tile([45.0, 7.0, 300.0], (300, 1)) + rng.normal(0, 1e-7, (300, 3))
    arrays: Any = {"imu": (t, gyro, accel), "gnss_position": (np.arange(300.0), place, [1.0, 1.0, 2.0])}
    nu = rng.normal(size=(50_000, 3))
    works = {
        "run": lambda: insnav.run(arrays),
        "ahrs": lambda: insnav.ahrs(t, gyro, accel),
        "lag_covariance": lambda: insnav.noise.lag_covariance(nu, 200),
        "als_estimate": lambda: insnav.noise.als_estimate(nu, np.eye(3) * 0.9, np.eye(3), np.eye(3), np.ones(6), lags=50),
    }
    for name, work in works.items():
        # A thread that has to wait for the interpreter counts nothing; on a busy machine it gets its share of the cores.
        busy, free = counted(work)
        assert busy > 0.1 * free, (name, busy, free)
