"""Jobs on a dask cluster."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Sequence
from typing import Any

from insnav._jobs import Outcome, Task
from insnav._optional import needs


def run_on_cluster(tasks: Sequence[Task], client: Any, done: Callable[[int, Outcome], None]) -> None:
    """Tasks on the workers of a `distributed.Client`; ``done`` gets the place of each and what came of it.

    The scheduler gives the task of a lost worker to another one. A task that lost its workers so often that the scheduler gives it
    up may only have been beside the one that killed them: it is tried once more when all others are done.
    """
    distributed = needs("distributed")
    # Not pure, and with a name of its own: what an earlier batch left in the cluster's memory is no result of this one.
    batch = uuid.uuid4().hex

    def submit(index: int, again: str = "") -> Any:
        return client.submit(tasks[index], key=f"insnav-{batch}-{index}{again}", pure=False)

    def killed(future: Any) -> bool:
        try:
            return isinstance(future.exception(), distributed.KilledWorker)
        # It was cancelled, or what it raised cannot be read here.
        except Exception:
            return False

    def outcome(future: Any) -> Outcome:
        try:
            result: Outcome = future.result()
        # What a task raises is its outcome; this is of the cluster: a worker without this package, a task that was cancelled.
        except Exception as e:
            return tasks[places[future]].failed(e)
        return result

    places = {submit(index): index for index in range(len(tasks))}
    suspects = []
    try:
        for future in distributed.as_completed(list(places)):
            if killed(future):
                suspects.append(places[future])
            else:
                done(places[future], outcome(future))
            future.release()
        for index in sorted(suspects):
            future = submit(index, "-again")
            places[future] = index
            done(index, tasks[index].died("whichever it was, and again alone") if killed(future) else outcome(future))
    except BaseException:
        client.cancel(list(places))
        raise
