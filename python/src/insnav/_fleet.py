"""Many logs."""

from __future__ import annotations

import os
import uuid
from collections.abc import Callable, Iterable, Mapping
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

_Path: TypeAlias = str | os.PathLike[str]
_Each: TypeAlias = Mapping[_Path, Mapping[str, Any]] | Callable[[Path], Mapping[str, Any] | None]


@dataclass(frozen=True)
class Run:
    """A log that was navigated.

    Attributes
    ----------
    file : Path
        The log.
    output : Path or None
        The solution, if there is an ``output_dir``.
    skipped : bool
        Whether it had been finished before.
    summary : dict
        ``Solution.summary``, with the keys of ``insnav run --format json``.
    """

    file: Path
    output: Path | None
    skipped: bool
    summary: dict[str, Any]


@dataclass(frozen=True)
class BatchResult:
    """What came of a fleet of logs.

    Attributes
    ----------
    runs : tuple of Run
        What was navigated, now or before, in the order in which the logs were given.
    failures : tuple of Failure
        What was not, in the same order.
    """

    runs: tuple[Run, ...]
    failures: tuple[Failure, ...]

    @property
    def skipped(self) -> tuple[Path, ...]:
        """Logs that had been finished before."""
        return tuple(run.file for run in self.runs if run.skipped)

    @property
    def table(self) -> dict[str, NDArray[Any]]:
        """A row a run, a numpy array a column: the log, its output, how long it is, its start, stops, what became of fixes, its end.

        What a run has none of is NaN, or empty text.
        """
        rows = [_row(run) for run in self.runs]
        return {name: _column([row[name] for row in rows]) for name in (rows[0] if rows else {})}

    def to_pandas(self) -> pandas.DataFrame:
        """:attr:`table` as a data frame with the log as its index (needs pandas)."""
        frame: pandas.DataFrame = needs("pandas").DataFrame(self.table)
        return frame.set_index("file") if len(frame) else frame

    def raise_failures(self) -> None:
        """Raise an :class:`insnav.InsnavError` that names all failures, if there are any."""
        raise_all(self.failures, len(self.runs))

    def __str__(self) -> str:
        return account(len(self.runs), len(self.skipped), self.failures)


# The name is that of the idea, in this module only.
def map(
    files: Iterable[_Path],
    config: Mapping[str, Any] | _Path | None = None,
    *,
    each: _Each | None = None,
    output_dir: _Path | None = None,
    root: _Path | None = None,
    resume: bool = True,
    workers: int | None = None,
    client: Any = None,
    progress: bool | Progress | None = None,
    **options: Any,
) -> BatchResult:
    """Navigate many logs, each as :func:`insnav.run` does.

    Parameters
    ----------
    files : iterable of paths
        The logs. One that is named twice is navigated once.
    config : mapping or path, optional
        Settings for all of them, as of :func:`insnav.run`.
    each : mapping or callable, optional
        What is different for a log: keywords of :func:`insnav.run`, ``config`` among them, in the place of those for all. A mapping by
        log, or a function of the log's absolute path; it is called here, not on the workers.
    output_dir : path, optional
        Folder for the solutions. Each has a record beside it (``.json``): hashes of the input, the settings and the output, this
        package's version, the summary.
    root : path, optional
        Folder that all logs are below: solutions have the same places below ``output_dir``. Without it they lie side by side, named by
        the log and eight digits that stand for its path, so that logs of one name do not meet.
    resume : bool, default True
        Skip what was finished before with the same input, settings and version, all by content. What was half done, or whose output is
        no longer what it was, is done again. What another call works on at the same time is a failure (``output_busy``), and so is a
        file in the place of an output or a record that is neither (``output_exists``).
    workers : int, optional
        Processes, each with one run at a time; as many as cores unless given. 0: none, one run after the other in this process.
    client : distributed.Client, optional
        The workers of its cluster, in place of processes here. They need this package and the same folders. A run whose worker is lost
        is given to another one, and is not done twice if it was finished.
    progress : bool or callable, optional
        ``progress(done, total, log)`` after each log. True: a line on standard error. Absent: a line where that is a terminal.
    **options
        All other keywords of :func:`insnav.run` but ``output`` and ``overwrite``.

    Returns
    -------
    BatchResult
        Summaries, what was skipped, and what failed. A log that cannot be navigated raises nothing here.

    Raises
    ------
    InsnavError
        Settings or a start that are wrong for all, an ``output_dir`` that cannot be (``LogError``), or worker processes that cannot be started.

    Examples
    --------
    >>> import insnav
    >>> result = insnav.batch.map(["/nowhere/monday.mcap"], workers=0)
    >>> len(result.runs), [(f.item.name, f.error) for f in result.failures]
    (0, [('monday.mcap', 'LogError')])
    """
    if isinstance(files, (str, os.PathLike)):
        raise ArgumentError(
            f"files: {os.fspath(files)!r} is one path, expected several", "bad_option", "give a list: [path]", argument="files"
        )
    logs = [Path(text) for text in dict.fromkeys(os.path.abspath(os.fspath(file)) for file in files)]
    jobs = []
    outputs: dict[Path, Path] = {}
    batch = uuid.uuid4().hex
    common = keywords_of_run({"config": config, **options})
    for log, own in zip(logs, _own_keywords(each, logs), strict=True):
        keywords = {**common, **keywords_of_run(own)}
        output = None
        if output_dir is not None:
            output = _output(log, Path(output_dir), root)
            if output in outputs:
                raise ArgumentError(
                    f"files: {outputs[output]} and {log} would have the same output {output}", "same_output", "rename one, or leave out root"
                )
            outputs[output] = log
            make_folder(output.parent)
        jobs.append(_Log(log, output, keywords, batch, resume))
    outcomes = do_all(_navigate, jobs, logs, workers=workers, client=client, progress=progress)
    runs, failures = [], []
    for job, outcome in zip(jobs, outcomes, strict=True):
        if isinstance(outcome, Failure):
            failures.append(outcome)
        else:
            runs.append(Run(job.file, job.output, outcome["skipped"], outcome["summary"]))
    return BatchResult(tuple(runs), tuple(failures))


@dataclass(frozen=True)
class _Log:
    """One log, as a worker gets it."""

    file: Path
    output: Path | None
    keywords: dict[str, Any]
    batch: str
    resume: bool


def _navigate(job: _Log) -> dict[str, Any]:
    if job.output is None:
        return {"skipped": False, "summary": run(job.file, **job.keywords).summary}
    from insnav._records import Record, hash_of_file, hash_of_settings

    try:
        content = hash_of_file(job.file)
    except OSError:
        # It says what is wrong with a log that cannot be opened.
        run(job.file, **job.keywords)
        raise
    inputs = {"input_sha256": content, "settings_sha256": hash_of_settings(job.keywords)}
    record = Record(job.output.with_suffix(".json"), inputs, job.batch, job.output)

    def finished() -> dict[str, Any] | None:
        if (done := record.result()) is not None and (job.resume or done.batch == job.batch):
            return {"skipped": done.batch != job.batch, "summary": done.result}
        return None

    if (outcome := finished()) is not None:
        return outcome
    try:
        with record.alone():
            # Whoever had the place until now may have done it.
            if (outcome := finished()) is not None:
                return outcome
            record.claim()
            record.begin()
            summary = run(job.file, output=job.output, overwrite=True, **job.keywords).summary
            record.finish(summary)
    except Exception:
        # What somebody else finished meanwhile is as good.
        if (outcome := finished()) is not None:
            return outcome
        raise
    return {"skipped": False, "summary": summary}


def _own_keywords(each: _Each | None, logs: list[Path]) -> list[Mapping[str, Any]]:
    if each is None:
        return [{} for _ in logs]
    if callable(each):
        return [each(log) or {} for log in logs]
    by_log = {Path(os.path.abspath(os.fspath(file))): own for file, own in each.items()}
    for unknown in by_log.keys() - set(logs):
        raise ArgumentError(f"each: {unknown} is none of the files", "bad_option", "its keys are paths as in files")
    return [by_log.get(log, {}) for log in logs]


def _output(log: Path, folder: Path, root: _Path | None) -> Path:
    name = log.stem if log.suffix == ".mcap" else log.name
    if root is None:
        import hashlib

        place = hashlib.sha256(os.fspath(log).encode(errors="surrogateescape")).hexdigest()[:8]
        return folder / f"{name}-{place}.insnav.mcap"
    above = os.path.abspath(os.fspath(root))
    if not log.is_relative_to(above):
        raise ArgumentError(f"root: {log} is not below {above}", "bad_option", "name a folder that all files are below, or none")
    return folder / log.relative_to(above).with_name(f"{name}.insnav.mcap")


def _row(run: Run) -> dict[str, Any]:
    s = run.summary
    start, last = s.get("alignment") or {}, s.get("final") or {}
    aiding = {a["name"]: a for a in s["aiding"]}
    row = {
        "file": os.fspath(run.file),
        "output": os.fspath(run.output) if run.output else "",
        "skipped": run.skipped,
        "imu_samples": s["imu_samples"],
        "duration_s": s["duration_s"],
        "elapsed_s": s["elapsed_s"],
        "distance_m": s["distance_m"],
        "imu_grade": s["imu_grade"],
        "time_offset_s": s["time_offset_s"]["value"],
        "heading_source": start.get("heading_source", ""),
        "sigma_heading_at_start_deg": start.get("sigma_heading_deg"),
        "stops": len(s["stops"]),
        "standing_s": sum(stop["end_s"] - stop["begin_s"] for stop in s["stops"]),
    }
    for name in ("gnss_position", "gnss_velocity"):
        what = aiding.get(name, {})
        row[f"{name}_used"] = what.get("used", 0)
        row[f"{name}_rejected"] = what.get("rejected", 0)
        row[f"{name}_nis_mean"] = what.get("nis_mean")
    for name in ("sigma_horizontal_m", "sigma_height_m", "sigma_heading_deg"):
        row[f"{name.removesuffix('_deg').removesuffix('_m')}_at_end_{name.rsplit('_', 1)[1]}"] = last.get(name)
    row["warnings"] = " ".join(warning["code"] for warning in s["warnings"])
    return row


def _column(values: list[Any]) -> NDArray[Any]:
    if any(isinstance(value, str) for value in values):
        return np.array(["" if value is None else value for value in values], dtype=np.str_)
    if all(isinstance(value, bool) for value in values):
        return np.array(values, dtype=np.bool_)
    if all(isinstance(value, int) for value in values):
        return np.array(values, dtype=np.int64)
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


