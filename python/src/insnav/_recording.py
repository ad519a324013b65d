"""What `insnav.read_mcap` returns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class Recording(dict[str, Any]):
    """A log as arrays: a dictionary for :func:`insnav.run` (see :class:`insnav.Arrays`), and what the file says besides.

    Attributes
    ----------
    path : str
        The file.
    topics : dict of str
        The topic of each role: ``"imu"``, ``"gnss"``, ….
    counts : dict
        How many samples of each kind there are, and what became of the others: dropped, put into their place, ….
    metadata : dict of str
        The record that this program writes into its own logs; empty for others.
    """

    path: str
    topics: dict[str, str]
    counts: dict[str, Any]
    metadata: dict[str, str]

    def __init__(
        self,
        arrays: Mapping[str, Any],
        *,
        path: str = "",
        topics: Mapping[str, str] | None = None,
        counts: Mapping[str, Any] | None = None,
        metadata: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(arrays)
        self.path = path
        self.topics = dict(topics or {})
        self.counts = dict(counts or {})
        self.metadata = dict(metadata or {})

    def copy(self) -> Recording:
        """Another one of the same arrays, with what the file says."""
        return self._with(self)

    def __or__(self, other: Mapping[str, Any]) -> Recording:  # type: ignore[override]
        """With other arrays in the place of some: what the file says stays."""
        return self._with({**self, **other}) if isinstance(other, Mapping) else NotImplemented

    def _with(self, arrays: Mapping[str, Any]) -> Recording:
        return Recording(arrays, path=self.path, topics=self.topics, counts=self.counts, metadata=self.metadata)

    def __repr__(self) -> str:
        kinds = ", ".join(f"{len(columns[0])} {kind}" for kind, columns in self.items() if isinstance(columns, tuple))
        return f"<insnav.Recording: {kinds or 'nothing'}>"
