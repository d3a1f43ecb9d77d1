"""The report of many runs: what they say together, group by group and place by place."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from palpate import ConfigurationError, LogError
from palpate.host import WIDTHS, differences, figure_of, legend_outside, measured, people, rounded, style

from palpate_report.anonymous import Anonymous
from palpate_report.page import render
from palpate_report.reading import Record
from palpate_report.svg import svg_text
from palpate_report.verdict import LEVELS, RunVerdict, judge

_APART = 2e-3  # [m] between the places of runs, from which on they are sites
_SHOWN = 200  # runs whose rows are on the page
_MARKS = "osD^vPX"
_CAUTION = (
    "p is the chance of such a difference between repeats (Welch's t-test). Sites of one material differ, too: before "
    "a difference is called a lump, compare it with the spread over a dozen sites."
)


@dataclass(frozen=True)
class Run:
    """One run of a comparison."""

    name: str
    group: str
    record: Record
    verdict: RunVerdict
    place: tuple[float, float] | None  # [m] where it was palpated; None for a sweep, or where nobody knows

    @property
    def tracks(self) -> Mapping[str, Any]:
        """The tracks of its result."""
        tracks: Mapping[str, Any] = self.record.document.get("tracks", {})
        return tracks


def groups_of(runs: Sequence[Path], patterns: Sequence[str]) -> dict[str, list[Record]]:
    """Run folders by group, in the natural order of their names; raises ConfigurationError, LogError."""
    found: dict[str, list[Path]] = {"runs": list(runs)} if runs else {}
    for text in patterns:
        name, equals, pattern = text.partition("=")
        if not (name and equals and pattern):
            raise ConfigurationError(f'--group {text}: write NAME=PATTERN, such as soft="runs/soft_*"')
        base = Path(pattern).anchor or "."
        paths = list(Path(base).glob(str(Path(pattern).relative_to(base)) if Path(pattern).anchor else pattern))
        if not paths:
            raise ConfigurationError(f"--group {text}: nothing matches {pattern!r}")
        found[name] = [*found.get(name, []), *paths]
    if not found:
        raise ConfigurationError("name at least one run folder, or a --group NAME=PATTERN")
    return {name: [Record.read(path) for path in sorted(set(paths), key=_natural)] for name, paths in found.items()}


def _natural(path: Path) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", str(path)) if part]


def comparison_page(groups: Mapping[str, Sequence[Record]], track: str | None, anonymous: bool) -> str:
    """The whole page of many runs; raises LogError where none of them has a result."""
    runs = [run for name, records in groups.items() for run in _runs(name, records)]
    if not any(run.tracks for run in runs):
        raise LogError("none of these runs has a result: report them one by one to see why")
    chosen = _track_of(runs, track)
    parameters = _parameters(runs, chosen)
    counts = {level: sum(run.verdict.level == level for run in runs) for level in LEVELS}
    pictures = [
        {"svg": svg_text(_values(runs, chosen, name, unit)), "caption": _caption(name)}
        for name, unit in parameters.items()
    ]
    sites = _sites(runs, chosen, *next(iter(parameters.items()))) if parameters else None
    veils = (
        {run.name: Anonymous(run.record.document, run.record.resolved, run.record.path) for run in runs}
        if anonymous
        else {}
    )
    return render(
        "comparison.html",
        title=f"{len(runs)} runs",
        track=chosen,
        counts=counts,
        levels=LEVELS,
        statistics=[
            _statistics(runs, group, chosen, name, unit) for name, unit in parameters.items() for group in groups
        ],
        grouped=len(groups) > 1,
        tests=[row for name, unit in parameters.items() for row in _tests(runs, list(groups), chosen, name, unit)],
        caution=_CAUTION,
        pictures=pictures,
        sites=svg_text(sites) if sites is not None else None,
        parameters=list(parameters),
        rows=[_row(run, chosen, parameters) for run in runs[:_SHOWN]],
        hidden=max(len(runs) - _SHOWN, 0),
        pipeline=_pipelines(runs, veils),
    )


def _runs(group: str, records: Sequence[Record]) -> list[Run]:
    found = []
    for record in records:
        name = record.path.resolve().name
        found.append(Run(name, group, record, judge(record), _place(record)))
    return found


def _place(record: Record) -> tuple[float, float] | None:
    for _, track in record.tracks.values():
        known = track.place[track.usable & np.isfinite(track.place).all(axis=1)]
        if len(known) and np.ptp(known, axis=0).max() < _APART:
            x, y = np.median(known, axis=0).tolist()
            return x, y
    return None


def _track_of(runs: Sequence[Run], track: str | None) -> str:
    """The track that is compared: the one chosen, or the one that is the main one of most runs."""
    known = list(dict.fromkeys(name for run in runs for name in run.tracks))
    if track is not None and track not in known:
        raise ConfigurationError(f"--track: no run has {track!r} (there are: {', '.join(known)})")
    mains = [run.verdict.main for run in runs if run.verdict.main is not None]
    return track or max(known, key=lambda name: (sum(name in run.tracks for run in runs), mains.count(name)))


def _parameters(runs: Sequence[Run], track: str) -> dict[str, str]:
    tables = [run.tracks[track]["parameters"] for run in runs if track in run.tracks]
    return {name: found["unit"] for table in tables for name, found in table.items()}


def _found(run: Run, track: str, parameter: str) -> Mapping[str, Any] | None:
    """A run's value; None where it has none, or must not be used."""
    table = run.tracks.get(track)
    if table is None or table["verdict"] == "invalid":
        return None
    found: Mapping[str, Any] | None = table["parameters"].get(parameter)
    return found if found and found["value"] is not None else None


def _numbers(runs: Sequence[Run], group: str | None, track: str, parameter: str) -> tuple[np.ndarray, np.ndarray]:
    """Values and combined uncertainties of the usable runs of a group [SI]."""
    found = [_found(run, track, parameter) for run in runs if group in (None, run.group)]
    pairs = [
        (table["value"], math.nan if table.get("combined") is None else table["combined"]) for table in found if table
    ]
    values = np.array(pairs).reshape(len(pairs), 2)
    return values[:, 0], values[:, 1]


def _statistics(runs: Sequence[Run], group: str, track: str, parameter: str, unit: str) -> dict[str, Any]:
    values, combined = _numbers(runs, group, track, parameter)
    word, factor = people(unit)
    of_group = sum(run.group == group for run in runs)
    row: dict[str, Any] = {"parameter": parameter, "group": group, "unit": word, "count": len(values), "of": of_group}
    if len(values) < 2:
        return row | {
            "mean": "–" if not len(values) else rounded(factor * values[0]),
            "std": "–",
            "combined": "–",
            "ratio": "–",
        }
    std, stated = (
        float(values.std(ddof=1)),
        float(np.sqrt(np.nanmean(combined**2))) if np.isfinite(combined).any() else math.nan,
    )
    return row | {
        "mean": measured(factor * float(values.mean()), factor * std / math.sqrt(len(values))),
        "std": f"{factor * std:.3g}",
        "combined": f"{factor * stated:.3g}" if math.isfinite(stated) else "?",
        "ratio": f"{std / stated:.2f}" if stated > 0 else "–",
    }


def _tests(runs: Sequence[Run], groups: Sequence[str], track: str, parameter: str, unit: str) -> list[dict[str, str]]:
    """Welch's t-test between each two groups of at least two runs each."""
    word, factor = people(unit)
    rows = []
    for first, second in combinations(groups, 2):
        (a, _), (b, _) = (_numbers(runs, group, track, parameter) for group in (first, second))
        if min(len(a), len(b)) < 2 or a.var() + b.var() == 0:
            continue
        from scipy.stats import ttest_ind

        tested: Any = ttest_ind(a, b, equal_var=False)
        p = float(tested.pvalue)
        change = factor * float(b.mean() - a.mean())
        rows.append(
            {
                "parameter": parameter,
                "groups": f"{first}, {second}",
                "difference": f"{change:.4g} {word}",
                "p": f"{p:.2g}",
            }
        )
    return rows


def _caption(parameter: str) -> str:
    return f"{parameter.replace('_', ' ')} of each run; bars are two combined uncertainties, hollow: to be looked at"


@style()
def _values(runs: Sequence[Run], track: str, parameter: str, unit: str) -> Any:
    word, factor = people(unit)
    figure, axes = figure_of(width=WIDTHS["double"], height=50.0)
    axis = axes[0, 0]
    groups = list(dict.fromkeys(run.group for run in runs))
    for i, group in enumerate(groups):
        look: dict[str, Any] = {"color": f"C{i % 7}", "linestyle": "none", "linewidth": 0.8}
        for level in LEVELS[:2]:
            chosen = [
                (k, _found(run, track, parameter))
                for k, run in enumerate(runs, 1)
                if run.group == group and _level(run, track) == level
            ]
            points = [(k, found["value"], found.get("combined") or 0.0) for k, found in chosen if found]
            if not points:
                continue
            number, value, combined = np.array(points).T
            fill = {} if level == LEVELS[0] else {"markerfacecolor": "white"}
            label = group if level == LEVELS[0] else f"{group}: look at it"
            axis.errorbar(
                number,
                factor * value,
                2 * factor * combined,
                marker=_MARKS[i % len(_MARKS)],
                label=label,
                **look,
                **fill,
            )
        values, _ = _numbers(runs, group, track, parameter)
        if len(values) > 1:
            numbers = [k for k, run in enumerate(runs, 1) if run.group == group]
            axis.hlines(
                factor * values.mean(), min(numbers) - 0.3, max(numbers) + 0.3, color=look["color"], linewidth=0.6
            )
    truths = {run.record.document.get("truth", {}).get(parameter) for run in runs}
    if len(truths) == 1 and None not in truths:
        axis.axhline(factor * truths.pop(), color="black", linestyle=":", linewidth=0.6, label="truth")
    axis.xaxis.get_major_locator().set_params(integer=True)
    axis.set(xlabel="run", ylabel=f"{parameter.replace('_', ' ')} [{word}]", xlim=(0.4, len(runs) + 0.6))
    legend_outside(axis, 4)
    return figure


def _level(run: Run, track: str) -> str | None:
    return next((found.level for found in run.verdict.tracks if found.track == track), None)


@style()
def _sites(runs: Sequence[Run], track: str, parameter: str, unit: str) -> Any:
    """The places of the runs, coloured by value; None where they are one place."""
    found = [(run.place, table["value"]) for run in runs if run.place and (table := _found(run, track, parameter))]
    if len(found) < 2 or np.ptp(np.array([place for place, _ in found]), axis=0).max() < _APART:
        return None
    word, factor = people(unit)
    figure, axes = figure_of(width=WIDTHS["middle"], height=70.0)
    x, y = 1e3 * np.array([place for place, _ in found]).T
    shown = axes[0, 0].scatter(x, y, c=[factor * value for _, value in found], s=40, edgecolors="black", linewidths=0.4)
    figure.colorbar(shown, ax=axes[0, 0], shrink=0.8, label=f"{parameter.replace('_', ' ')} [{word}]")
    axes[0, 0].set(xlabel="x [mm]", ylabel="y [mm]")
    axes[0, 0].set_aspect("equal", adjustable="datalim")
    return figure


def _row(run: Run, track: str, parameters: Mapping[str, str]) -> dict[str, Any]:
    table = run.tracks.get(track)
    own = next((found for found in run.verdict.tracks if found.track == track), None)
    return {
        "name": run.name,
        "group": run.group,
        "level": own.level if own else run.verdict.level,
        "reasons": own.reasons if own else (run.verdict.reasons or (f"it has no track {track}",)),
        "values": [(table or {}).get("parameters", {}).get(name) for name in parameters],
        "place": run.place,
    }


def _pipelines(runs: Sequence[Run], veils: Mapping[str, Anonymous]) -> dict[str, Any]:
    """The pipeline of the first run as run, and how those of the others differ from it."""
    known = [(run, text) for run in runs if (text := run.record.resolved_text)]
    if not known:
        return {}
    (first, own), *others = known
    told: dict[str, list[str]] = {}
    for run, text in others:
        told.setdefault(differences(text, own, ()) if text != own else "", []).append(run.name)
    hide = veils[first.name].text if first.name in veils else str
    return {"name": first.name, "text": hide(own), "others": [(hide(what), names) for what, names in told.items()]}
