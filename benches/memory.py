#!/usr/bin/env python3
"""Anonymous memory of `insnav run` on a long drive: the log is simulated in a temporary folder, RssAnon is read from /proc.

    cargo build --release -p insnav-cli
    python3 benches/memory.py target/release/insnav [HOURS]

The log is mapped, so what the kernel keeps of it is not counted: it is given back when another program needs the room.
Exit code 1 when the peak is above 100 MB.
"""

import os
import subprocess
import sys
import tempfile
import time

LIMIT_MB = 100

SCENARIO = """\
duration_s = {duration}
ready_route = "car"
[start]
latitude_deg = 50.1
longitude_deg = 14.4
height_m = 250
heading_deg = 70
[imu]
rate_hz = 100
[gnss]
position_rate_hz = 5.0
velocity_rate_hz = 5.0
"""


def rss_anon_mb(pid):
    with open(f"/proc/{pid}/status") as status:
        for line in status:
            if line.startswith("RssAnon:"):
                return int(line.split()[1]) / 1024
    return 0.0


def main():
    command = os.path.abspath(sys.argv[1])
    hours = float(sys.argv[2]) if len(sys.argv) > 2 else 10.0
    with tempfile.TemporaryDirectory() as folder:
        scenario, log = os.path.join(folder, "long.toml"), os.path.join(folder, "long.mcap")
        with open(scenario, "w") as file:
            file.write(SCENARIO.format(duration=3600 * hours))
        subprocess.run([command, "simulate", scenario, "-o", log], check=True, stdout=subprocess.DEVNULL)
        begin = time.monotonic()
        run = subprocess.Popen(
            [command, "run", log, "--format", "json"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        peak = 0.0
        while run.poll() is None:
            try:
                peak = max(peak, rss_anon_mb(run.pid))
            except OSError:
                break
            time.sleep(0.01)
        code = run.wait()
        size = os.path.getsize(log) / 1e6
        print(
            f"{hours} h, log of {size:.0f} MB: {time.monotonic() - begin:.1f} s, "
            f"peak of anonymous memory {peak:.1f} MB (limit {LIMIT_MB}), exit code {code}"
        )
        return 1 if code != 0 or peak > LIMIT_MB else 0


if __name__ == "__main__":
    sys.exit(main())
