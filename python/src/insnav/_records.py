"""What is known of a job that was done before: records beside outputs, by the content of what went in."""

from __future__ import annotations

import hashlib
import json
import os
import re
import socket
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from insnav._errors import LogError
from insnav._insnav import __version__
from insnav._locks import locked

#: How a record begins, were it cut right after that.
_HEAD = '{\n "batch": "'
_BEGINS_AS_OURS = re.compile(re.escape(_HEAD) + "[0-9a-f]{32}\"")
_CUT_BEFORE_THAT = re.compile(re.escape(_HEAD) + "[0-9a-f]{0,32}")
#: Of the name of a file that is half written, between the name that it is to have and `.partial`: the process, of records more, of several outputs a number.
_WRITER = re.compile("([0-9]+)(?:-([0-9a-f]{8})-[0-9a-f]{8}|\\.[0-9]+)?")


def hash_of_file(path: Path) -> str:
    """SHA-256 of a file's content."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def hash_of_settings(settings: Mapping[str, Any]) -> str:
    """SHA-256 of settings, whatever the order of their keys; what is None is not given."""
    return hashlib.sha256(json.dumps(_plain(settings), sort_keys=True).encode()).hexdigest()


def _plain(value: Any) -> Any:
    """The same in what JSON knows: arrays are lists, paths are text, keys with None are left out."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items() if item is not None}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value


@dataclass(frozen=True)
class Done:
    """A job that was finished."""

    result: dict[str, Any]
    #: The call that finished it.
    batch: str


class Record:
    """The record of one job: a JSON file that appears whole or not at all.

    Parameters
    ----------
    path : path
        Where it is, or is to be.
    inputs : mapping
        What the job's result depends on; a record of anything else is of another job.
    batch : str
        Names the call that does the job now.
    output : path or None
        The file that the job makes, if any.
    """

    def __init__(self, path: Path, inputs: Mapping[str, Any], batch: str, output: Path | None = None) -> None:
        self.path = path
        self.inputs = {"insnav": __version__, **inputs}
        self.batch = batch
        self.output = output
        # How often this call has begun with it: more than once where a worker was lost.
        self._begun = 1
        # Processes that began it and did not finish it, and this one.
        self._processes: list[str] = []

    def result(self) -> Done | None:
        """What the job came to, if it was finished with the same inputs and its output is still what it was."""
        stored = self._stored()
        if stored is None or stored.get("inputs") != self.inputs or not isinstance(stored.get("result"), dict):
            return None
        if self.output is not None:
            try:
                unchanged = hash_of_file(self.output) == stored.get("output_sha256")
            except OSError:
                return None
            if not unchanged:
                return None
        return Done(stored["result"], str(stored.get("batch")))

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Nobody else works on the output meanwhile.

        Raises
        ------
        LogError
            Another call does.
        """
        assert self.output is not None
        with locked(self.output.with_name(f".{self.output.name}.lock"), self.batch) as got:
            if not got:
                raise self._taken()
            yield

    def claim(self) -> None:
        """Make sure that nothing of anybody else is in the way.

        A record that was cut, or is empty, is none that anybody needs: it is written anew. An output needs more for evidence: a record
        that names its call.

        Raises
        ------
        LogError
            There is an output without a record, or a file in the record's place that is no record.
        """
        if self._stored() is not None:
            return
        try:
            text = self.path.read_text(errors="replace")
        except FileNotFoundError:
            text = ""
        except OSError:
            raise self._foreign(self.path, "it is no record") from None
        if _BEGINS_AS_OURS.match(text):
            return
        if not (_HEAD.startswith(text) or _CUT_BEFORE_THAT.fullmatch(text)):
            raise self._foreign(self.path, "it is no record")
        if self.output is not None and self.output.exists():
            raise self._foreign(self.output, "it has no record")

    def _foreign(self, path: Path, why: str) -> LogError:
        return LogError(
            f"{path}: there is a file that is none of this function's, for {why}",
            "output_exists",
            "move it away, or choose another output_dir",
            path=os.fspath(path),
        )

    def _taken(self) -> LogError:
        return LogError(
            f"{self.output or self.path}: another call works on it at the same time",
            "output_busy",
            "wait until that has ended, or choose another output_dir",
            path=os.fspath(self.output or self.path),
        )

    def begin(self) -> None:
        """Say that the job is under way: what lies at the place of its output from now on is its own."""
        stored = self._stored() or {}
        before = stored.get("begun", 0) if stored.get("batch") == self.batch else 0
        self._begun = before + 1
        earlier = stored.get("processes")
        self._processes = [*(earlier if isinstance(earlier, list) else []), f"{os.getpid()}-{_host()}"]
        self._store({"processes": self._processes, "inputs": self.inputs})

    def finish(self, result: Mapping[str, Any]) -> None:
        """Say what came of it, and clear away what died on the way.

        Raises
        ------
        LogError
            Another call has begun with the output meanwhile, which may be that call's.
        """
        content: dict[str, Any] = {"inputs": self.inputs, "result": result}
        if self.output is not None:
            # Where files cannot be locked, this is what keeps a record from standing beside another call's output.
            if (self._stored() or {}).get("batch") != self.batch:
                raise self._taken()
            content["output"] = self.output.name
            content["output_sha256"] = hash_of_file(self.output)
        for whole in (self.path, self.output):
            if whole is not None:
                self._clear(whole)
        self._store(content)

    def _clear(self, whole: Path) -> None:
        """Remove what is half written, unless somebody may still write it."""
        own = {int(process.partition("-")[0]) for process in self._processes}
        for half in whole.parent.glob(f".{glob_literal(whole.name)}.*.partial"):
            writer = _WRITER.fullmatch(half.name[len(whole.name) + 2 : -len(".partial")])
            if writer is None:
                continue
            process, host = int(writer[1]), writer[2]
            if f"{process}-{host}" in self._processes if host else process in own:
                half.unlink(missing_ok=True)
            elif host in (None, _host()) and not _lives(process):
                half.unlink(missing_ok=True)

    def _stored(self) -> dict[str, Any] | None:
        """What the record says; none where there is none, or something else."""
        try:
            stored = json.loads(self.path.read_text())
        except (OSError, ValueError):
            return None
        ours = isinstance(stored, dict) and isinstance(stored.get("inputs"), dict) and isinstance(stored.get("batch"), str)
        return stored if ours else None

    def _store(self, content: Mapping[str, Any]) -> None:
        # Many hosts may write here, and many threads of a process.
        writer = f"{os.getpid()}-{_host()}-{uuid.uuid4().hex[:8]}"
        temporary = self.path.with_name(f".{self.path.name}.{writer}.partial")
        try:
            with temporary.open("w") as stream:
                json.dump({"batch": self.batch, "begun": self._begun, **content}, stream, indent=1)
                stream.flush()
                os.fsync(stream.fileno())
            # On other systems a rename over an existing file fails; this does not.
            os.replace(temporary, self.path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise


def _host() -> str:
    """Eight digits that stand for this machine."""
    return hashlib.sha256(socket.gethostname().encode(errors="surrogateescape")).hexdigest()[:8]


def _lives(process: int) -> bool:
    """Whether there is such a process on this machine; of systems that do not tell, yes."""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        pass
    return True


def glob_literal(name: str) -> str:
    """A pattern that matches this name only."""
    return "".join(f"[{c}]" if c in "*?[" else c for c in name)
