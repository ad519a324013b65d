"""Many jobs, their progress and what became of each."""

from __future__ import annotations

import inspect
import os
import sys
import traceback
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from insnav._errors import ArgumentError, InsnavError, InsnavWarning, LogError
from insnav._insnav import Navigator, given_settings, run

Progress: TypeAlias = Callable[[int, int, Any], None]


@dataclass(frozen=True)
class Failure:
    """A log or a simulated run that came to nothing, and why.

    Attributes
    ----------
    item : Path or int
        The log; of :func:`monte_carlo` the seed.
    error : str
        Name of the exception's class; ``"WorkerDied"`` where the process that worked on it was killed, and again when it was
        tried alone.
    code, message, remedy : str
        As :class:`insnav.InsnavError` has them.
    traceback : str
        Where it came from, if it is none of this package's errors.
    """

    item: Path | int
    error: str
    code: str
    message: str
    remedy: str
    traceback: str = ""

    def __str__(self) -> str:
        return f"{self.item}: {self.error}: {self.message}" + (f"; {self.remedy}" if self.remedy else "")


#: What a job comes to: what it returns, or why not.
Outcome: TypeAlias = "dict[str, Any] | Failure"
#: A function of a module, of one argument; both pickle, and so does what it returns.
Job: TypeAlias = "Callable[[Any], dict[str, Any]]"


@dataclass(frozen=True)
class Task:
    """A job with its argument and the name that its failure is to have."""

    job: Job
    item: Any
    name: Path | int

    def __call__(self) -> Outcome:
        """Do it. What it raises becomes its outcome, which crosses to another process whatever the exception is made of."""
        try:
            return self.job(self.item)
        except (KeyboardInterrupt, SystemExit):
            raise
        # A panic of compiled code is no Exception.
        except BaseException as e:
            return self.failed(e)

    def failed(self, e: BaseException) -> Failure:
        """Its outcome when this was raised."""
        error = type(e).__name__
        if isinstance(e, InsnavError):
            return Failure(self.name, error, e.code, e.message, e.remedy)
        return Failure(self.name, error, "unexpected", str(e), "", "".join(traceback.format_exception(e)))

    def died(self, when: str) -> Failure:
        """Its outcome when the process that worked on it was killed."""
        return Failure(
            self.name,
            "WorkerDied",
            "worker_died",
            f"the process that worked on it was killed, {when}",
            "see the system's log: who needs more memory than there is is killed; try fewer workers, or this one alone",
        )


def account(runs: int, skipped: int, failures: Sequence[Failure]) -> str:
    """How many were finished, and what was not."""
    before = f" ({skipped} of them before)" if skipped else ""
    lines = [f"{runs} of {runs + len(failures)} finished{before}"]
    lines += [f"  {failure}" for failure in failures]
    return "\n".join(lines)


def raise_all(failures: Sequence[Failure], runs: int) -> None:
    """One error for all of them."""
    if failures:
        raise InsnavError(account(runs, 0, failures), "batch_failed")


def keywords_of_run(given: Mapping[str, Any]) -> dict[str, Any]:
    """Keywords of `run`, checked as far as that can be done here, and settings as a mapping: workers may be elsewhere."""
    known = [name for name in inspect.signature(run).parameters if name not in ("log", "output", "overwrite")]
    for name in given:
        if name not in known:
            raise TypeError(f"{name}: not a keyword of insnav.run that can be given here ({', '.join(known)})")
    if (start := given.get("start")) is not None:
        # What is wrong with it is wrong for every log: a navigator says so, which wants an instant too.
        instant = {"time_s": 0.0} if isinstance(start, Mapping) and start.get("time_s") is None else {}
        Navigator(start={**start, **instant} if instant else start)
    return {**given, "config": given_settings(given["config"])} if "config" in given else dict(given)


def make_folder(folder: Path) -> None:
    """Make a folder for outputs, and those above it, unless it is there.

    Raises
    ------
    LogError
        It cannot be.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as e:
        why = "it is a file" if isinstance(e, FileExistsError) else e.strerror
        raise LogError(
            f"output_dir: {folder}: cannot be made: {why}", "output_not_writable", "choose a folder that can be made and written", path=os.fspath(folder)
        ) from e


def do_all(
    job: Job,
    items: Sequence[Any],
    names: Sequence[Path | int],
    *,
    workers: int | None,
    client: Any,
    progress: bool | Progress | None,
) -> list[Outcome]:
    """All of them: on processes, on a cluster if there is a client, or here; what came of each, in their order."""
    if workers is not None and workers < 0:
        raise ArgumentError(f"workers: {workers}, expected 0 or more", "bad_option", "leave it out for as many as there are cores")
    if workers is not None and client is not None:
        raise TypeError("workers: a client brings its own")
    # Not before they are needed: multiprocessing takes longer to import than all of this package.
    from insnav import _cluster, _workers

    tell = _telling(progress)
    outcomes: dict[int, Outcome] = {}

    def done(index: int, outcome: Outcome) -> None:
        outcomes[index] = outcome
        tell(len(outcomes), len(items), names[index])

    tasks = [Task(job, item, name) for item, name in zip(items, names, strict=True)]
    if client is not None:
        _cluster.run_on_cluster(tasks, client, done)
    elif workers == 0:
        for index, task in enumerate(tasks):
            with warnings.catch_warnings():
                # They are in the summary; a hundred runs of them are no reading.
                warnings.simplefilter("ignore", InsnavWarning)
                outcome = task()
            done(index, outcome)
    else:
        _workers.run_on_processes(tasks, workers or os.cpu_count() or 1, done)
    return [outcomes[index] for index in range(len(items))]


def _telling(progress: bool | Progress | None) -> Progress:
    """The caller's own, or a line on a terminal unless told otherwise."""
    if callable(progress):
        return progress
    if progress is False or (progress is None and not sys.stderr.isatty()):
        return lambda done, total, item: None

    def line(done: int, total: int, item: Any) -> None:
        text = f"{done}/{total} {item}"
        if sys.stderr.isatty():
            # Over the line before, cut to what one line has.
            print(f"\r\x1b[K{text[:78]}", end="\n" if done == total else "", file=sys.stderr, flush=True)
        else:
            print(text, file=sys.stderr, flush=True)

    return line
