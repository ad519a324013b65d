"""Fleets of logs, and many simulated runs: on all cores of a machine, or on a dask cluster.

:func:`map` navigates many logs as :func:`insnav.run` does one; :func:`monte_carlo` simulates, navigates and compares with the truth,
once a seed. What fails is collected by name and stops nothing else, killed worker processes included. With ``output_dir`` both
can be interrupted and called again: what was finished with the same input, settings and version is not done again.

Work is done by processes of its own, one run each at a time, or by the workers of a ``distributed.Client``. A script that calls these
functions does so below ``if __name__ == "__main__":``, since every worker process imports it.
"""

from insnav._fleet import BatchResult, Run, map
from insnav._jobs import Failure
from insnav._monte_carlo import MonteCarlo, monte_carlo

__all__ = ["BatchResult", "Failure", "MonteCarlo", "Run", "map", "monte_carlo"]
