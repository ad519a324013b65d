# %% [markdown]
# # A fleet of logs
#
# A week of logs is navigated on all cores of a machine by `insnav.batch.map`, or on as many machines as there are by the same call with a
# `dask.distributed` client. What was finished is not done again, and what fails is named and stops nothing else. The logs of this example are
# simulated; in life they are a list of files that all workers can read.
#
# The work stands in a function, since every worker process imports this file anew.

# %%
import os
import tempfile
from pathlib import Path
from typing import Any

from distributed import Client, LocalCluster

import insnav


# %%
def record_a_week(folder: Path) -> list[Path]:
    """A log a day, all of the same name, as loggers do; the one of the third day was cut off."""
    logs = []
    for day in range(5):
        log = folder / f"day{day}" / "drive.mcap"
        log.parent.mkdir()
        insnav.write_mcap(log, insnav.sim.Scenario.car_drive(100.0).simulate(seed=day))
        logs.append(log)
    os.truncate(logs[2], logs[2].stat().st_size // 2)
    return logs


# %% [markdown]
# The first call works on two processes of this machine. Settings are for all; the last car has its antenna elsewhere. The second call gets a
# cluster, and has nothing left to do but the log that could not be read: it has been recovered meanwhile.


# %%
def main() -> None:
    settings = {"imu": {"grade": "consumer"}, "gnss": {"lever_arm_b_m": [0.0, 0.0, 0.0]}}
    moved = {"imu": {"grade": "consumer"}, "gnss": {"lever_arm_b_m": [0.4, 0.0, -1.1]}}
    with tempfile.TemporaryDirectory() as place:
        week, solutions = Path(place) / "logs", Path(place) / "solutions"
        week.mkdir()
        logs = record_a_week(week)
        options: dict[str, Any] = {"output_dir": solutions, "root": week, "each": {logs[4]: {"config": moved}}}

        result = insnav.batch.map(logs, settings, workers=2, **options)
        print(result)
        for run in result.runs:
            print(run.output, f"{run.summary['distance_m']:.0f} m", len(run.summary["stops"]), "stops")

        insnav.write_mcap(logs[2], insnav.sim.Scenario.car_drive(100.0).simulate(seed=2), overwrite=True)
        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
            result = insnav.batch.map(logs, settings, client=client, **options)
        print(result)
        assert len(result.skipped) == 4 and not result.failures
        columns = ["duration_s", "distance_m", "stops", "gnss_position_used", "sigma_heading_at_end_deg"]
        print({name: result.table[name].tolist() for name in columns})

        # How good is such a drive, again and again? Errors against the truth, a seed a run.
        many = insnav.batch.monte_carlo(insnav.sim.Scenario.car_drive(100.0), 4, seed=10, config=settings, workers=2)
        print(many)


if __name__ == "__main__":
    main()
