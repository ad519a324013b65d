"""Files that one process at a time works on."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

#: How long somebody else's lock is waited for: a worker that was ended a moment ago may still be about to go.
GRACE_S = 3.0


@contextmanager
def locked(path: Path, owner: str) -> Iterator[bool]:
    """Hold the lock that the file stands for, which exists while it is held; it ends with the process, however that ends.

    Who has the same owner is waited for, as where a cluster takes a worker for lost that is not. False is what others get.
    Where the file system or the operating system has none, everybody gets it.
    """
    if os.name != "posix":
        yield True
        return
    stream = _acquire(path, owner)
    if stream is None:
        yield False
        return
    try:
        yield True
    finally:
        # Before it is let go: who waits for it sees that the file is no longer the one of that name.
        try:
            path.unlink(missing_ok=True)
        except OSError:
            pass
        os.close(stream)


def _acquire(path: Path, owner: str) -> int | None:
    end = time.monotonic() + GRACE_S
    while True:
        stream = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            if _lock(stream):
                if _is(stream, path):
                    os.ftruncate(stream, 0)
                    os.write(stream, owner.encode())
                    kept, stream = stream, -1
                    return kept
                continue
            holder = os.pread(stream, 64, 0).decode(errors="replace")
        finally:
            if stream >= 0:
                os.close(stream)
        if holder != owner and time.monotonic() > end:
            return None
        time.sleep(0.02)


def _lock(stream: int) -> bool:
    import fcntl

    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        # No locks here.
        pass
    return True


def _is(stream: int, path: Path) -> bool:
    """Whether the open file is still the one of that name."""
    try:
        return os.path.samestat(os.fstat(stream), os.stat(path))
    except OSError:
        return False
