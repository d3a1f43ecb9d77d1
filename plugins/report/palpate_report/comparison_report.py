"""The report of many runs: their results together, group by group and place by place."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from palpate import ConfigurationError, LogError
from palpate_engine import display_unit
from palpate_kit.numerics.group_comparison import CAUTIONS, SHOWN, GroupComparison
from palpate_kit.numerics.repeated_values import combined_of_mean, std_of_mean
from palpate_kit.runs.document_table import table_value
from palpate_kit.runs.pipeline_diff import differences
from palpate_kit.terminal.quantities import value_with_uncertainty
from palpate_kit.terminal.result_screen import LEGEND
from palpate_kit.terminal.result_table import ResultRow, ResultTable

from palpate_report.anonymous import Anonymous
from palpate_report.comparison_figures import caption_of, sites_of, values_by_run
from palpate_report.group_numbers import MIN_SITE_DISTANCE, GroupRun, common_of, compare_runs, numbers_of
from palpate_report.number_texts import readable
from palpate_report.result_box import result_box
from palpate_report.run_contents import RunContents
from palpate_report.run_report import render
from palpate_report.run_verdict import judge
from palpate_report.svg import svg_text

_MAX_ROWS = 200  # runs with a row on the page: a choice
_COMPARED = ("value", "combined", "systematic", "unit", "verdict")  # of each parameter


def comparison_page(groups: Mapping[str, Sequence[Path]], track: str | None, anonymous: bool) -> str:
    """Return the page of many runs, read one by one; raises LogError where one is not a run, or none has a result."""
    pipelines = dict[str, str]()  # each text once: most runs share one
    runs = [_run(name, path, pipelines, anonymous) for name, paths in groups.items() for path in paths]
    return page_of_runs(runs, list(groups), track)


def page_of_runs(
    runs: Sequence[GroupRun],
    groups: Sequence[str],
    track: str | None,
    noun: str = "run",
    notes: Sequence[str] = (),
    study: Mapping[str, Any] | None = None,
    unit: str | None = None,
) -> str:
    """Return the page (HTML) of runs, or of curves as the `noun` says, in groups that are compared.

    `unit` is the column that names the units of replication, `study` a section on the folder of the curves. Raises
    LogError where none has a result, ConfigurationError for an unknown unit.
    """
    if not any(run.tracks for run in runs):
        raise LogError(f"none of these {noun}s has a result: look at them one by one to see why")
    chosen_track = _track_of(runs, track)
    units = _parameter_units(runs, chosen_track)
    pictures = []
    for parameter, si_unit in units.items():
        picture = values_by_run(runs, chosen_track, parameter, si_unit)
        pictures.append({"svg": svg_text(picture), "caption": caption_of(parameter, noun)})
    comparisons = {name: compare_runs(runs, groups, chosen_track, name, unit) for name in units}
    # The first parameter stands for all on the picture of sites.
    sites = sites_of(runs, chosen_track, *next(iter(units.items()))) if units else None
    statistics, tests = [], []
    for parameter, comparison in comparisons.items():
        for group in groups:
            statistics.append(_statistics(runs, comparison, group, chosen_track, parameter, units[parameter]))
        tests += _tests(comparison, parameter, units[parameter])
    return render(
        "comparison.html",
        title=f"{len(runs)} {noun}s",
        noun=noun,
        notes=notes,
        track=chosen_track,
        box=result_box(_table(runs, chosen_track, noun)),
        legend=LEGEND,
        statistics=statistics,
        grouped=len(groups) > 1,
        tests=tests,
        cautions=_cautions(comparisons),
        replicated=any(not comparison.singles for comparison in comparisons.values()),
        pictures=pictures,
        sites=svg_text(sites) if sites is not None else None,
        parameters=list(units),
        rows=[_row(run, chosen_track, units) for run in runs[:_MAX_ROWS]],
        hidden=max(len(runs) - _MAX_ROWS, 0),
        pipeline=_pipelines(runs),
        study=study,
    )


def _table(runs: Sequence[GroupRun], track: str, noun: str) -> ResultTable:
    """Return the table of results of one track of runs; `noun` is what each is called."""
    return ResultTable(tuple(_result_row(run, track) for run in runs), thing=noun)


def _result_row(run: GroupRun, track: str) -> ResultRow:
    table = run.tracks.get(track)
    if table is None:
        return ResultRow(run.name, track, error="no result")
    values = {
        name: table_value(name, value, table["verdict"])
        for name, value in table["parameters"].items()
    }  # fmt: skip
    return ResultRow(run.name, track, values, findings=run.findings)


def _run(group: str, path: Path, pipelines: dict[str, str], anonymous: bool) -> GroupRun:
    """Return a run of a group, from its folder; its pipeline is the same text as that of another run (`pipelines`)."""
    record = RunContents.read(path)
    text = record.resolved_text
    return GroupRun(
        name=record.path.resolve().name,
        group=group,
        verdict=judge(record),
        place=_place(record),
        tracks={name: _compared(table) for name, table in record.document.get("tracks", {}).items()},
        truth=record.document.get("truth", {}),
        pipeline=None if text is None else pipelines.setdefault(text, text),
        veil=Anonymous(record.document, record.resolved, record.path) if anonymous else None,
    )


def _compared(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the numbers of a track that are compared."""
    numbers = {}
    for name, value in table["parameters"].items():
        numbers[name] = {key: value[key] for key in _COMPARED if key in value}
    return {"verdict": table["verdict"], "parameters": numbers}


def _place(record: RunContents) -> tuple[float, float] | None:
    """Return the place [m] at which a run was palpated; None of a sweep, or where it is not known."""
    for _, track in RunContents(record.folder).tracks.values():  # read for this alone, and not kept in memory
        places = track.place[track.usable & np.isfinite(track.place).all(axis=1)]
        if len(places) and np.ptp(places, axis=0).max() < MIN_SITE_DISTANCE:
            x, y = np.median(places, axis=0).tolist()
            return x, y
    return None


def _track_of(runs: Sequence[GroupRun], track: str | None) -> str:
    """Return the track that is compared: the one chosen, or the one that is the main one of most runs."""
    names = list(dict.fromkeys(name for run in runs for name in run.tracks))
    if track is not None and track not in names:
        raise ConfigurationError(f"--track: no run has {track!r} (there are: {', '.join(names)})")
    mains = [run.verdict.main for run in runs if run.verdict.main is not None]
    return track or max(names, key=lambda name: (sum(name in run.tracks for run in runs), mains.count(name)))


def _parameter_units(runs: Sequence[GroupRun], track: str) -> dict[str, str]:
    """Return the SI units of the parameters of a track, by name."""
    tables = [run.tracks[track]["parameters"] for run in runs if track in run.tracks]
    return {name: value["unit"] for table in tables for name, value in table.items()}


def _statistics(
    runs: Sequence[GroupRun], comparison: GroupComparison, group: str, track: str, parameter: str, unit: str
) -> dict[str, Any]:
    """Return the row of a group: mean, scatter, stated uncertainty (rms) and their ratio, of a parameter [unit].

    The scatter needs two values. `comparison` has the means of the units of replication, of which statistics are.
    """
    values, combined = numbers_of(runs, group, track, parameter)
    symbol, factor = display_unit(unit)
    run_count = sum(run.group == group for run in runs)
    row: dict[str, Any] = {"parameter": parameter, "group": group, "unit": symbol}
    row |= {"count": len(values), "of": run_count, "std": "–", "combined": "–", "ratio": "–"}
    if not len(values):
        return row | {"units": "", "mean": "–"}
    if len(values) == 1:
        single_unit = "" if comparison.singles else f"1 ({comparison.unit})"
        return row | {"units": single_unit, "mean": value_with_uncertainty(factor * values[0], factor * combined[0])}
    std = float(values.std(ddof=1))
    stated_uncertainty = float(np.sqrt(np.nanmean(combined**2))) if np.isfinite(combined).any() else math.nan
    unit_group = next(candidate for candidate in comparison.groups if candidate.name == group)
    # Single values are taken in their order, in which neighbours may correlate; units of several are not.
    scatter_of_mean = std_of_mean(values) if comparison.singles else unit_group.std_of_mean
    uncertainty_of_mean = combined_of_mean(scatter_of_mean, common_of(runs, group, track, parameter))
    return row | {
        "units": "" if comparison.singles else f"{unit_group.units} ({comparison.unit})",
        "mean": value_with_uncertainty(factor * unit_group.mean, factor * uncertainty_of_mean),
        "std": f"{factor * std:.3g}",
        "combined": f"{factor * stated_uncertainty:.3g}" if math.isfinite(stated_uncertainty) else "?",
        "ratio": f"{std / stated_uncertainty:.2f}" if stated_uncertainty > 0 else "–",
    }


def _tests(comparison: GroupComparison, parameter: str, unit: str) -> list[dict[str, str]]:
    """Return the differences of groups that were tested, those of the smallest p-values."""
    symbol, factor = display_unit(unit)
    return [
        {
            "parameter": parameter,
            "groups": f"{pair.first}, {pair.second}",
            "difference": f"{factor * pair.difference:.4g} {symbol}",
            "p": f"{pair.corrected:.2g}",
        }
        for pair in comparison.most_significant()
        if math.isfinite(pair.p)
    ]


def _cautions(comparisons: Mapping[str, GroupComparison]) -> list[str]:
    """Return sentences on the comparison of groups, and on its limits."""
    sentences: list[str] = []
    for name, comparison in comparisons.items():
        limit_note = f" Shown are the {SHOWN} smallest p." if comparison.tests > SHOWN else ""
        texts = [f"{comparison.sentence}{limit_note}", comparison.untested if comparison.tests else ""]
        sentences += [f"{readable(name)}: {text}" for text in texts if text]
    # Each caution once, whatever the number of parameters.
    cautions = [CAUTIONS[item.unit] for item in comparisons.values() if item.singles and item.tests]
    return sentences + list(dict.fromkeys(cautions))


def _row(run: GroupRun, track: str, parameters: Iterable[str]) -> dict[str, Any]:
    """Return the row of a run: its values, unless they are invalid, and the reasons of its verdict."""
    table = run.tracks.get(track)
    numbers = table["parameters"] if table is not None and table["verdict"] != "invalid" else {}
    verdict = next((candidate for candidate in run.verdict.tracks if candidate.track == track), None)
    return {
        "name": run.name,
        "group": run.group,
        "reasons": verdict.reasons if verdict else (run.verdict.reasons or (f"it has no track {track}",)),
        "values": [numbers.get(name) for name in parameters],
        "place": run.place,
    }


def _pipelines(runs: Sequence[GroupRun]) -> dict[str, Any]:
    """Return the pipeline of the first run as run, and how those of the others differ from it.

    A run has the text of its pipeline, and a veil that takes host and paths out where the page is anonymous.
    """
    pipelines = [(run, run.pipeline) for run in runs if run.pipeline]
    if not pipelines:
        return {}
    (first, first_text), *others = pipelines
    texts: dict[str, list[str]] = {}
    for run, text in others:
        texts.setdefault(text, []).append(run.name)
    grouped: dict[str, list[str]] = {}
    for text, names in texts.items():
        grouped.setdefault(differences(text, first_text, ()) if text != first_text else "", []).extend(names)
    hide = first.veil.text if first.veil else str  # takes host and paths out of a text
    return {
        "name": first.name,
        "text": hide(first_text),
        "others": [(hide(changes), names) for changes, names in grouped.items()],
    }
