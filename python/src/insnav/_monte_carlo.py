"""Many simulated runs."""

from __future__ import annotations

import operator
import os
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from insnav._errors import ArgumentError
from insnav._insnav import run
from insnav._jobs import Failure, Progress, account, do_all, keywords_of_run, make_folder, raise_all
from insnav._optional import needs

if TYPE_CHECKING:
    import pandas

    from insnav.sim import Scenario

_Path: TypeAlias = str | os.PathLike[str]

_OF_WHOLE_RUNS = ("horizontal_rms_m", "height_rms_m", "velocity_rms_m_per_s", "roll_rms_deg", "pitch_rms_deg", "heading_rms_deg")


@dataclass(frozen=True, eq=False)
class MonteCarlo:
    """What came of many simulated runs of one scenario.

    Attributes
    ----------
    seeds : (n,) of uint64
        Seeds of the runs that were finished: ``scenario.simulate(seed)`` is the run again.
    summaries : tuple of dict
        ``Comparison.summary`` of each, with the keys of ``insnav compare --format json``.
    skipped : (k,) of uint64
        Seeds that had been finished before.
    failures : tuple of Failure
        What came to nothing, by seed.
    """

    seeds: NDArray[np.uint64]
    summaries: tuple[dict[str, Any], ...]
    skipped: NDArray[np.uint64]
    failures: tuple[Failure, ...]

    @property
    def table(self) -> dict[str, NDArray[Any]]:
        """A row a run, a numpy array a column: ``seed``, then the errors of each under the names of ``insnav compare``.

        Those of the whole run have the name itself (``horizontal_rms_m``, ``nees_position``), those of parts begin with the part's
        (``standing_heading_rms_deg``). NaN where a run has none.
        """
        rows = [_errors(summary) for summary in self.summaries]
        names = dict.fromkeys(name for row in rows for name in row)
        return {"seed": self.seeds} | {name: np.array([row.get(name, np.nan) for row in rows], dtype=np.float64) for name in names}

    @property
    def rms(self) -> dict[str, float]:
        """Root mean square over the runs of every error that is a root mean square in each, under its name in :attr:`table`."""
        return {
            name: float(np.sqrt(np.nanmean(np.square(column))))
            for name, column in self.table.items()
            if "_rms_" in name and not np.isnan(column).all()
        }

    @property
    def nees(self) -> dict[str, tuple[float, float]]:
        """Mean over the runs of the normalised estimation error squared per degree of freedom, and its standard error.

        A consistent filter gives 1. Within a run the errors of neighbouring epochs are nearly the same ones, so that the standard error is
        told by how the runs scatter, and is NaN for a single run. ``"position"``, ``"velocity"``, ``"attitude"`` of whole runs;
        parts by their names in :attr:`table`.
        """
        found = {}
        for name, column in self.table.items():
            column = column[~np.isnan(column)]
            if "nees_" in name and len(column):
                error = float(np.std(column, ddof=1) / np.sqrt(len(column))) if len(column) > 1 else float("nan")
                found[name.removeprefix("nees_")] = (float(np.mean(column)), error)
        return found

    def to_pandas(self) -> pandas.DataFrame:
        """:attr:`table` as a data frame with the seed as its index (needs pandas)."""
        frame: pandas.DataFrame = needs("pandas").DataFrame(self.table)
        return frame.set_index("seed")

    def raise_failures(self) -> None:
        """Raise an :class:`insnav.InsnavError` that names all failures, if there are any."""
        raise_all(self.failures, len(self.seeds))

    def __str__(self) -> str:
        lines = [account(len(self.seeds), len(self.skipped), self.failures)]
        lines += [f"{name:24} {value:.4g}" for name, value in self.rms.items() if name in _OF_WHOLE_RUNS]
        lines += [f"nees {name:19} {mean:.3f} ± {error:.3f}" for name, (mean, error) in self.nees.items() if "_" not in name]
        return "\n".join(lines)


def monte_carlo(
    scenario: Scenario,
    runs: int,
    *,
    seed: int = 0,
    config: Mapping[str, Any] | _Path | None = None,
    known_start: bool = False,
    compare: Mapping[str, Any] | None = None,
    output_dir: _Path | None = None,
    resume: bool = True,
    workers: int | None = None,
    client: Any = None,
    progress: bool | Progress | None = None,
    **options: Any,
) -> MonteCarlo:
    """Simulate, navigate and compare with the truth, once a seed.

    The result depends on the scenario, the seeds and the settings only: not on how many workers there are, and in which order they finish.

    Parameters
    ----------
    scenario : insnav.sim.Scenario
        What is simulated.
    runs : int
        How many, with the seeds ``seed``, ``seed + 1``, …: more runs are the same ones and some more.
    seed : int, default 0
        The first seed, from 0; the last one is at most 2**64 - 1.
    config : mapping or path, optional
        Settings of :func:`insnav.run`.
    known_start : bool, default False
        Begin with the true state and the sigmas of the scenario, in place of a start that is found in the data.
    compare : mapping, optional
        Keywords of :func:`insnav.compare`.
    output_dir : path, optional
        Folder for records, one a seed (``.json``), by which a call that was interrupted goes on.
    resume, workers, client, progress
        As of :func:`map`; ``progress`` gets the seed.
    **options
        Other keywords of :func:`insnav.run`, such as ``withhold``.

    Returns
    -------
    MonteCarlo
        Errors by run with the seeds, and what they are together.

    Raises
    ------
    InsnavError
        As of :func:`map`.

    Examples
    --------
    >>> import insnav
    >>> drives = insnav.batch.monte_carlo(insnav.sim.Scenario.car_drive(60.0), 2, seed=7, workers=0)
    >>> drives.seeds
    array([7, 8], dtype=uint64)
    >>> drives.table["horizontal_rms_m"].shape, sorted(drives.nees)[:3]
    ((2,), ['attitude', 'position', 'standing_nees_attitude'])
    """
    if runs < 0:
        raise ArgumentError(f"runs: {runs}, expected 0 or more", "bad_option")
    seed = operator.index(seed)
    if seed < 0 or seed + runs > 2**64:
        raise ArgumentError(f"seed: {seed} and {runs} runs, expected seeds from 0 to 2**64 - 1", "bad_option")
    if "start" in options:
        raise TypeError("start: give known_start=True; the state is another one for each seed")
    keywords = keywords_of_run({"config": config, **options})
    folder = None
    if output_dir is not None:
        folder = Path(output_dir)
        make_folder(folder)
    batch = uuid.uuid4().hex
    seeds = [seed + i for i in range(runs)]
    jobs = [_Seed(scenario, s, keywords, known_start, dict(compare or {}), folder, batch, resume) for s in seeds]
    outcomes = do_all(_simulate, jobs, seeds, workers=workers, client=client, progress=progress)
    done = [(s, outcome) for s, outcome in zip(seeds, outcomes, strict=True) if not isinstance(outcome, Failure)]
    return MonteCarlo(
        seeds=np.array([s for s, _ in done], dtype=np.uint64),
        summaries=tuple(outcome["summary"] for _, outcome in done),
        skipped=np.array([s for s, outcome in done if outcome["skipped"]], dtype=np.uint64),
        failures=tuple(outcome for outcome in outcomes if isinstance(outcome, Failure)),
    )


@dataclass(frozen=True)
class _Seed:
    """One simulated run, as a worker gets it."""

    scenario: Scenario
    seed: int
    keywords: dict[str, Any]
    known_start: bool
    compare: dict[str, Any]
    folder: Path | None
    batch: str
    resume: bool


def _simulate(job: _Seed) -> dict[str, Any]:
    from insnav import compare
    from insnav._records import Record, hash_of_settings

    record = None
    if job.folder is not None:
        asked = {"compare": job.compare, "known_start": job.known_start, **job.keywords}
        inputs = {
            "seed": job.seed,
            "scenario_sha256": hash_of_settings(job.scenario.to_dict()),
            "settings_sha256": hash_of_settings(asked),
        }
        record = Record(job.folder / f"seed-{job.seed:06}.json", inputs, job.batch)
        if (done := record.result()) is not None and (job.resume or done.batch == job.batch):
            return {"skipped": done.batch != job.batch, "summary": done.result}
        record.claim()
    simulated = job.scenario.simulate(job.seed)
    start = simulated.start if job.known_start else None
    solution = run(simulated.arrays, start=start, **job.keywords)
    summary = compare(solution, simulated.truth, **job.compare).summary
    if record is not None:
        record.finish(summary)
    return {"skipped": False, "summary": summary}


def _errors(summary: Mapping[str, Any]) -> dict[str, float]:
    """The numbers of a comparison, flat."""
    flat: dict[str, float] = {}

    def add(prefix: str, values: Mapping[str, Any]) -> None:
        for name, value in values.items():
            if isinstance(value, Mapping):
                add(f"{prefix}{name}_", value)
            elif isinstance(value, (int, float)) and not isinstance(value, bool):
                flat[f"{prefix}{name}"] = float(value)

    for part in ("all", "standing", "moving", "withheld"):
        if isinstance(summary.get(part), Mapping):
            add("" if part == "all" else f"{part}_", summary[part])
    return flat
