"""One run of a comparison, and the numbers of a group of runs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from palpate_kit.curves.replication_unit import replication_unit, unit_of
from palpate_kit.numerics.group_comparison import RUN, GroupComparison, compare_groups
from palpate_kit.runs.result_file import usable_value
from palpate_kit.runs.run_groups import natural
from palpate_kit.terminal.result_table import ResultFinding

from palpate_report.anonymous import Anonymous
from palpate_report.run_verdict import RunVerdict

MIN_SITE_DISTANCE = 2e-3  # [m] between the places of runs, from which on they are sites: a choice


@dataclass(frozen=True)
class GroupRun:
    """One run of a comparison, with the numbers alone, so that memory holds a hundred thousand of them."""

    name: str
    group: str
    verdict: RunVerdict
    place: tuple[float, float] | None  # [m] where it was palpated; None for a sweep, or where it is not known
    tracks: Mapping[str, Any]  # verdict and parameters of each
    truth: Mapping[str, float | None] = field(default_factory=dict)
    pipeline: str | None = None  # as run; None where it is not known
    veil: Anonymous | None = None  # for what is shown of the pipeline
    cells: Mapping[str, str] | None = None  # of a curve, by column of ``curves.csv``
    findings: tuple[ResultFinding, ...] = ()  # of a curve


def number_of(run: GroupRun, track: str, parameter: str) -> Mapping[str, Any] | None:
    """Return a run's value; None where it has none, or must not be used."""
    table = run.tracks.get(track)
    return usable_value(table, parameter) if table is not None else None


def common_of(runs: Sequence[GroupRun], group: str, track: str, parameter: str) -> np.ndarray:
    """Return the uncertainties (m,) [SI] that the usable runs of a group have in common."""
    values = [number_of(run, track, parameter) for run in runs if group == run.group]
    return np.array([value["systematic"] for value in values if value and value.get("systematic") is not None])


def numbers_of(
    runs: Sequence[GroupRun], group: str | None, track: str, parameter: str
) -> tuple[np.ndarray, np.ndarray]:
    """Return values and combined uncertainties of the usable runs of a group [SI], in the natural order of names."""
    ordered = sorted(runs, key=lambda run: natural(run.name))
    pairs = []
    for run in ordered:
        number = number_of(run, track, parameter) if group in (None, run.group) else None
        if number:
            pairs.append((number["value"], math.nan if number.get("combined") is None else number["combined"]))
    values = np.array(pairs).reshape(len(pairs), 2)
    return values[:, 0], values[:, 1]


def compare_runs(
    runs: Sequence[GroupRun], groups: Sequence[str], track: str, parameter: str, unit: str | None = None
) -> GroupComparison:
    """Return the comparison of groups of runs or curves with values, by a parameter [SI].

    Each run is a unit of replication; of curves, which have cells, the units are named by the column `unit`, or one
    that is found. Raises ConfigurationError for an unknown unit of replication.
    """
    by_group = {group: [run for run in runs if run.group == group] for group in groups}
    replication = RUN
    if any(run.cells is not None for run in runs):
        replication = replication_unit({group: [run.cells or {} for run in by_group[group]] for group in groups}, unit)
    values: dict[str, list[tuple[str, float]]] = {}
    for group in groups:
        for i, run in enumerate(by_group[group]):
            number = number_of(run, track, parameter)
            if number is not None:
                member = str(i) if run.cells is None else unit_of(run.name, run.cells, replication)
                values.setdefault(group, []).append((member, float(number["value"])))
    return compare_groups(values, replication)
