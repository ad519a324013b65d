"""Jobs on worker processes of this machine."""

from __future__ import annotations

import os
import signal
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import connection, get_context, parent_process
from multiprocessing.process import BaseProcess
from types import FrameType

from insnav._errors import InsnavError, InsnavWarning
from insnav._jobs import Outcome, Task

#: How long workers that are to end have for putting away what they have half written.
GRACE_S = 2.0


def run_on_processes(tasks: Sequence[Task], workers: int, done: Callable[[int, Outcome], None]) -> None:
    """Tasks on worker processes, one at a time each; ``done`` gets the place of each and what came of it.

    Each worker is an executor of its own: when it dies, that breaks no other, and it is known what it was working on. That job
    is tried once more when all others are done and nothing else needs memory.
    """
    waiting: deque[int] = deque(range(len(tasks)))
    again: deque[int] = deque()
    idle: list[_Worker] = []
    running: dict[Future[Outcome], tuple[_Worker, int]] = {}
    finished = False
    try:
        for _ in range(min(workers, len(tasks))):
            # First it is known, then it has a process: an interruption ends those that there are.
            idle.append(_Worker())
            idle[-1].start()
        while waiting or again or running:
            while idle and waiting:
                index = waiting.popleft()
                worker = idle.pop()
                running[worker.submit(tasks[index])] = (worker, index)
            if again and not waiting and not running:
                index = again.popleft()
                worker = idle.pop()
                future = worker.submit(tasks[index])
                running[future] = (worker, index)
                wait(running)
                if _broke(future):
                    del running[future]
                    idle.append(worker)
                    worker.replace()
                    done(index, tasks[index].died("and again when it was tried alone"))
                    continue
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                worker, index = running.pop(future)
                idle.append(worker)
                if _broke(future):
                    worker.replace()
                    again.append(index)
                else:
                    done(index, future.result())
        finished = True
    finally:
        everyone = [*idle, *(worker for worker, _ in running.values())]
        if finished:
            for worker in everyone:
                worker.stop()
        else:
            _end(everyone)


def _end(workers: Sequence[_Worker]) -> None:
    """End them in the midst of what they do; who has not gone after the grace, or at a second interruption, is killed.

    They put away what they have half written, except on Windows, where a process can only be killed: there the next call does it.
    """
    # Afterwards an executor no longer tells.
    processes = [process for worker in workers for process in worker.processes()]
    left = {process.sentinel for process in processes}
    try:
        for worker in workers:
            worker.leave()
        for process in processes:
            process.terminate()
        end = time.monotonic() + GRACE_S
        while left and (rest := end - time.monotonic()) > 0:
            left.difference_update(gone for gone in connection.wait(left, rest) if isinstance(gone, int))
    finally:
        for process in processes:
            if process.sentinel in left:
                process.kill()


def _broke(future: Future[Outcome]) -> bool:
    return isinstance(future.exception(), BrokenProcessPool)


class _Worker:
    """A process that does one job at a time."""

    def __init__(self) -> None:
        self._pool = _pool()
        # Whether a process of its has ever begun.
        self._worked = False

    def start(self) -> None:
        """Have a process."""
        self._pid = self._pool.submit(os.getpid)

    def submit(self, task: Task) -> Future[Outcome]:
        try:
            return self._pool.submit(_do, task)
        except BrokenProcessPool:
            # It died between two jobs.
            self.replace()
        try:
            return self._pool.submit(_do, task)
        except BrokenProcessPool as e:
            # And so did the next one, before it had the job: that counts as if it had died of it, lest this go on for ever.
            future: Future[Outcome] = Future()
            future.set_exception(e)
            return future

    def replace(self) -> None:
        """Another process in the place of one that died."""
        self._worked = self._worked or not isinstance(self._pid.exception(), BrokenProcessPool)
        if not self._worked:
            raise InsnavError(
                "worker processes end before they begin",
                "workers_do_not_start",
                'call this below `if __name__ == "__main__":`, since every worker imports the script anew; '
                "or work in this process with workers=0",
            )
        self._pool.shutdown(wait=False)
        self._pool = _pool()
        self.start()

    def stop(self) -> None:
        """Wait for it, and let its process go."""
        self._pool.shutdown(wait=True)

    def leave(self) -> None:
        """Give it nothing more, and wait for nothing."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def processes(self) -> list[BaseProcess]:
        """Its process, which may be importing yet, and know of nothing."""
        return list((self._pool._processes or {}).values())


def _pool() -> ProcessPoolExecutor:
    return ProcessPoolExecutor(1, mp_context=get_context("spawn"), initializer=_begin)


class _Ended(SystemExit):
    """This process has been told to end."""


def _do(task: Task) -> Outcome:
    try:
        return task()
    except _Ended:
        # What was half written is put away. The executor would send this on as if the job had raised it.
        os._exit(128 + signal.SIGTERM)


def _begin() -> None:
    # The process that waits for the workers hears an interruption, and ends them.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _told_to_end)
    # They are in the summary.
    warnings.simplefilter("ignore", InsnavWarning)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _told_to_end(number: int, frame: FrameType | None) -> None:
    # Once: what is put away because of it is put away undisturbed.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise _Ended(128 + number)


def _end_with_parent() -> None:
    # Whoever is killed cannot end its workers, which would wait for work for ever.
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)
