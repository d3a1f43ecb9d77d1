"""One run of a comparison, and the numbers of a group of runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from palpate_report.run_verdict import RunVerdict

APART = 2e-3  # [m] between the places of runs, from which on they are sites


class ComparedRecord(Protocol):
    """What a comparison reads of a run, or of a curve."""

    @property
    def path(self) -> Path:
        """Where it is."""
        ...

    @property
    def document(self) -> Mapping[str, Any]:
        """Its result."""
        ...

    @property
    def resolved_text(self) -> str | None:
        """The pipeline as run."""
        ...

    @property
    def resolved(self) -> Mapping[str, Any]:
        """The tables of the pipeline as run."""
        ...


@dataclass(frozen=True)
class GroupRun:
    """One run of a comparison."""

    name: str
    group: str
    record: ComparedRecord
    verdict: RunVerdict
    place: tuple[float, float] | None  # [m] where it was palpated; None for a sweep, or where it is not known

    @property
    def tracks(self) -> Mapping[str, Any]:
        """The tracks of its result."""
        tracks: Mapping[str, Any] = self.record.document.get("tracks", {})
        return tracks


def number_of(run: GroupRun, track: str, parameter: str) -> Mapping[str, Any] | None:
    """A run's value; None where it has none, or must not be used."""
    table = run.tracks.get(track)
    if table is None or table["verdict"] == "invalid":
        return None
    found: Mapping[str, Any] | None = table["parameters"].get(parameter)
    return found if found and found["value"] is not None else None


def common_of(runs: Sequence[GroupRun], group: str, track: str, parameter: str) -> float:
    """Median of what the usable runs of a group state for what they have in common [SI]; 0 where none does."""
    found = [number_of(run, track, parameter) for run in runs if group == run.group]
    told = [table["systematic"] for table in found if table and table.get("systematic") is not None]
    return float(np.median(told)) if told else 0.0


def numbers_of(
    runs: Sequence[GroupRun], group: str | None, track: str, parameter: str
) -> tuple[np.ndarray, np.ndarray]:
    """Values and combined uncertainties of the usable runs of a group [SI]."""
    found = [number_of(run, track, parameter) for run in runs if group in (None, run.group)]
    pairs = [
        (table["value"], math.nan if table.get("combined") is None else table["combined"]) for table in found if table
    ]
    values = np.array(pairs).reshape(len(pairs), 2)
    return values[:, 0], values[:, 1]
