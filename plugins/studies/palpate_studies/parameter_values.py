"""The values of one parameter of one track in runs, logs, cycles and curves, each with its verdict and its mark."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import typer
from palpate import ConfigurationError, Flag, LogError, UserError, suggest
from palpate_engine import needs_fact, registry, verdict
from palpate_kit.curves.curve_filter import CurveFilter, curve_filter
from palpate_kit.curves.curve_row import CurveRow
from palpate_kit.curves.fit_folder import FitFolder, is_fit_folder, stale_words
from palpate_kit.runs.result_file import read_flags, read_results, value_verdict
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.runs.run_groups import natural

_MAX_LINES = 20  # on files that are left out, a choice: a screen


@dataclass(frozen=True)
class ParameterValue:
    """One value of a run, log, cycle or curve, with its uncertainty, verdict and mark."""

    name: str  # of the run folder or file; of a log in a fit FOLDER#LOG, of a cycle FOLDER#LOG#CYCLE
    folder: Path  # of the file with the marks of a review
    key: str  # of its mark in that file; "" is the run itself
    track: str
    value: float | None  # [SI]
    std: float | None  # [SI] combined standard uncertainty
    unit: str
    systematic: float | None  # [SI] part of it that repeats have in common; None if not stated
    residual: float | None  # [N] RMS
    flags: tuple[Flag, ...]
    verdict: str
    rejected: str | None  # the reason; None if it was not rejected
    groups: Mapping[str, str] = field(default_factory=dict)  # of a curve: its cells of ``curves.csv`` by column

    @property
    def usable(self) -> bool:
        """True if its value may enter statistics."""
        has_number = self.value is not None and self.verdict != "invalid" and not needs_fact(self.verdict)
        return has_number and self.rejected is None


def report_left_out(failures: Mapping[str, UserError], *, has_values: bool) -> None:
    """Print each file that is left out with the reason, up to twenty of them.

    If no other file has values, raises the error of the first file, which is not printed then.
    """
    paths = [*failures][0 if has_values else 1 :]
    for path in paths[:_MAX_LINES]:
        typer.echo(f"{path} is left out: {failures[path]}", err=True)
    if len(paths) > _MAX_LINES:
        typer.echo(f"and {len(paths) - _MAX_LINES} more", err=True)
    if failures and not has_values:
        raise next(iter(failures.values()))


def readings(
    path: Path, track: str | None, parameter: str, *, first: bool = False, where: str | None = None
) -> Iterator[ParameterValue]:
    """Yield the values of a parameter in a run, or in every log, cycle or curve of `palpate fit`.

    `track` None is the only one, with `first` the first of several. `where` are filter words for curves. Raises
    LogError for a file that is not a result, ConfigurationError for an unknown track or parameter, and for words that
    do not parse.
    """
    if is_fit_folder(path):
        yield from _curve_values(FitFolder(path), track, parameter, first, where)
        return
    if where is not None:
        raise ConfigurationError(f"--where: {path} is not a folder of fits of many curves")
    file = path
    if path.is_dir():
        file = path / "fit.json" if (path / "fit.json").is_file() else path / "result.json"
    results, rejected = read_results(file), RunFolder(file.parent).rejected
    if results.cycles:
        yield from _cycle_values(results.cycles, path, file, track, parameter, first, rejected)
        return
    for log in sorted(results.by_log, key=natural):
        document = results.by_log[log]
        name = f"{path}#{log}" if log else str(path)
        yield _run_value(document, file, track, parameter, first, name=name, key=log, rejected=rejected.get(log))


def _cycle_values(
    cycles: Sequence[Mapping[str, Any]], path: Path, file: Path, track: str | None, parameter: str, first: bool,
    rejected: Mapping[str, str],
) -> Iterator[ParameterValue]:  # fmt: skip
    """Yield the values of the cycles of a file, in the order of logs and cycles.

    `path` is that of the user, `rejected` has the reason for each rejected cycle by its key.
    """
    rows = [row for row in cycles if track in (None, row["track"])]
    track = _chosen_track({row["track"]: None for row in rows}, track, file, first)
    rows = [row for row in rows if row["track"] == track]
    for row in sorted(rows, key=lambda row: (natural(row["log"]), row["cycle"])):
        key = f"{row['log']}#{row['cycle']}"
        estimate = row["unknowns"].get(parameter, {})
        flags = read_flags(row["flags"])
        yield ParameterValue(
            name=f"{path}#{key}",
            folder=file.parent,
            key=key,
            track=track,
            value=estimate.get("value"),
            std=estimate.get("std"),
            unit=estimate.get("unit", ""),
            systematic=estimate.get("systematic"),
            residual=row["rms"],
            flags=flags,
            verdict=verdict(flags),
            rejected=rejected.get(key),
        )


def _curve_values(
    folder: FitFolder, track: str | None, parameter: str, first: bool, where: str | None
) -> Iterator[ParameterValue]:
    """Yield the values of the curves of a folder of fits for which the filter words hold, in their natural order."""
    track = _chosen_track(dict.fromkeys(folder.tracks), track, folder.path, first)
    if parameter not in folder.values:
        raise ConfigurationError(f"{folder.path}: no parameter {parameter!r}{suggest(parameter, folder.values)}")
    meanings = registry.load().meanings
    chosen: CurveFilter = curve_filter(where, folder, meanings)
    stale_note = stale_words(folder)
    if stale_note:
        typer.echo(stale_note, err=True)
    for row in sorted(chosen.choose(folder.rows), key=lambda row: natural(row.curve)):
        if row.track in (track, ""):  # a curve that could not be fitted has no track
            yield _curve_value(folder, row, track, parameter, meanings)


def _curve_value(
    folder: FitFolder, row: CurveRow, track: str, parameter: str, meanings: Mapping[str, Any]
) -> ParameterValue:
    """Return the value of a curve; a flag of a plugin that is not installed is doubtful, and has only its code."""
    flags: list[Flag] = []
    for code in row.flags:
        meaning = meanings.get(code)
        flags.append(Flag(code, code, "doubtful") if meaning is None else Flag(code, meaning.meaning, meaning.severity))
    return ParameterValue(
        name=f"{folder.path}#{row.curve}",
        folder=folder.path,
        key=row.curve,
        track=track,
        value=row.number(parameter),
        std=row.number(f"{parameter}_combined"),
        unit=folder.units.get(parameter, ""),
        systematic=row.systematic(parameter),
        residual=row.number("rms"),
        flags=tuple(flags),
        verdict=row.verdict_of(parameter) or row.verdict or "invalid",
        rejected=row.rejected,
        groups=row.groups,
    )


def _run_value(
    document: dict[str, Any], file: Path, track: str | None, parameter: str, first: bool, *, name: str, key: str,
    rejected: str | None,
) -> ParameterValue:  # fmt: skip
    """Return the value in the document of a run or log, by its name for messages and the key of its mark.

    Raises ConfigurationError for an unknown track or parameter.
    """
    track = _chosen_track(document["tracks"], track, file, first)
    result = document["tracks"][track]
    estimates = {**result["parameters"], "surface": result["surface"]}
    if parameter not in estimates:
        raise ConfigurationError(f"{file}: no parameter {parameter!r}{suggest(parameter, estimates)}")
    estimate = estimates[parameter]
    return ParameterValue(
        name=name,
        folder=file.parent,
        key=key,
        track=track,
        value=estimate["value"],
        std=estimate["combined"],
        unit=estimate["unit"],
        systematic=estimate.get("systematic"),
        residual=result["force_rms"],
        flags=read_flags(result["flags"]),
        verdict=value_verdict(result, estimate),
        rejected=rejected,
    )


def _chosen_track(tracks: Mapping[str, Any], track: str | None, file: Path, first: bool) -> str:
    """Return the name of the chosen track, of None the only one, with `first` the first one.

    Raises LogError for a file without a track, ConfigurationError for an unknown one, and if one must be chosen.
    """
    if not tracks:
        raise LogError(f"{file}: has no result")
    if track is None and (first or len(tracks) == 1):
        return next(iter(tracks))
    if track is None:
        raise ConfigurationError(f"{file}: has {len(tracks)} tracks; choose one with --track: {', '.join(tracks)}")
    if track not in tracks:
        raise ConfigurationError(f"{file}: no track {track!r}{suggest(track, tracks)}")
    return track
