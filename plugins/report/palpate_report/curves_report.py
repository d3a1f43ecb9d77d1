"""The report of a folder of fits: its curves together, group by group."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from palpate import ConfigurationError, PalpateError, suggest
from palpate_engine import build_pipeline, inherited_approval, registry, resolved_text, verdict_word
from palpate_kit.curves.curve_filter import curve_filter
from palpate_kit.curves.curve_pipelines import curve_source
from palpate_kit.curves.curve_row import CurveRow
from palpate_kit.curves.fit_folder import FitFolder
from palpate_kit.terminal.result_table import ResultFinding

from palpate_report.anonymous import Anonymous
from palpate_report.comparison_report import page_of_runs
from palpate_report.folder_facts import FolderFacts
from palpate_report.folder_section import folder_section
from palpate_report.group_numbers import GroupRun
from palpate_report.run_verdict import LEVELS, RunVerdict, TrackVerdict


def curves_page(
    path: Path, track: str | None, anonymous: bool, by: str | None, where: str | None, unit: str | None = None
) -> str:
    """Return the whole page of a folder of fits, its curves in groups by a column of ``curves.csv``, compared by units.

    `by` names the column, `unit` that of the units of replication, `where` has filter words. Raises LogError, and
    ConfigurationError for an unknown track, column, unit or filter word.
    """
    facts = folder_facts(path, track, by, where)
    folder, rows = facts.folder, facts.rows
    veil = Anonymous({}, {}, folder.path) if anonymous else None
    severities = {code: meaning.severity for code, meaning in registry.load().meanings.items()}
    first, *other_runs = [_run(folder, row, by, severities) for row in rows]
    runs = [replace(first, pipeline=_pipeline_text(folder, rows[0].curve), veil=veil), *other_runs]
    groups = list(dict.fromkeys(run.group for run in runs))
    study = folder_section(facts, veil.text if veil else str)
    return page_of_runs(runs, groups, facts.track, "curve", _notes(rows, where, path), study, unit)


def _pipeline_text(folder: FitFolder, curve: str) -> str:
    """Return the pipeline of a curve as it is run, seen from the folder; where its parts are not here, that of all
    curves."""
    try:
        with inherited_approval(folder.approved):
            return resolved_text(build_pipeline(curve_source(folder, curve)), folder.path)
    except PalpateError:
        return folder.settings_text(folder.dialect_of(curve))


def folder_facts(path: Path, track: str | None, by: str | None, where: str | None) -> FolderFacts:
    """Return the rows of a folder of fits that are reported; raises LogError, ConfigurationError."""
    folder = FitFolder(path)
    for option, name, choices in (("--track", track, folder.tracks), ("--by", by, folder.columns)):
        if name is not None and name not in choices:
            raise ConfigurationError(f"{option} {name}: {path} has no such{suggest(name, choices)}")
    chosen = track or next(iter(folder.tracks), "")
    rows = curve_filter(where, folder, registry.load().meanings).choose(folder.rows)
    rows = [row for row in rows if row.track in (chosen, "")]
    if not rows:
        raise ConfigurationError(f"--where {where!r}: holds of no curve" if where else f"{path}: has no curves")
    return FolderFacts(folder, chosen, rows)


def _run(folder: FitFolder, row: CurveRow, by: str | None, severities: Mapping[str, str]) -> GroupRun:
    """Return a curve, by its row, as a run of a comparison; `severities` are those of flags by code."""
    parameters = {
        name: {
            "value": row.number(name),
            "verdict": row.cells.get(f"{name}_verdict"),
            "combined": row.number(f"{name}_combined"),
            "systematic": row.systematic(name),
            "unit": folder.units.get(name, ""),
        }
        for name in folder.values
        if name != "surface"
    }
    verdict = row.verdict if row.usable else "invalid"
    table: dict[str, Any] = {"parameters": parameters, "verdict": verdict, "flags": [], "force_rms": row.number("rms")}
    level = verdict_word(verdict)
    findings = tuple(ResultFinding.of_cell(row.cells.get("findings", ""), severities))
    judged = RunVerdict(level, (TrackVerdict(row.track, level, _reasons(row, level)),), _reasons(row, level), row.track)
    group = (row.groups.get(by) or "none") if by else "curves"
    tracks = {row.track: table} if row.track else {}
    return GroupRun(row.curve, group, judged, row.place, tracks, cells=row.groups, findings=findings)


def _reasons(row: CurveRow, level: str) -> tuple[str, ...]:
    if row.rejected is not None:
        return (f"rejected: {row.rejected}",)
    if row.error or not row.cells:
        return (row.error or "not fitted yet",)
    return row.flags if level != LEVELS[0] else ()


def _notes(rows: Sequence[CurveRow], where: str | None, path: Path) -> list[str]:
    """Return the notes on the rows that are shown."""
    rejected = sum(row.rejected is not None for row in rows)
    notes = [f"Only curves of {where}."] if where else []
    if rejected:
        notes.append(f"{rejected} of {len(rows)} curves were rejected and are in no number.")
    if old := sum(row.state == "stale" for row in rows):
        notes.append(f"{old} of {len(rows)} rows were made with other settings: palpate fit {path.name} repeats them.")
    return notes
