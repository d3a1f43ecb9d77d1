"""What runs, logs, cycles and curves say of one parameter of one track, each by its name, and which were rejected."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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

_TOLD = 20  # files that are left out, one line each


@dataclass(frozen=True)
class ParameterValue:
    """One value with what it is judged by."""

    name: str  # of the run folder or file; of a log in a fit FOLDER#LOG, of a cycle FOLDER#LOG#CYCLE
    folder: Path  # where marks of a review stand
    key: str  # under which they stand there; "" is the run itself
    track: str
    value: float | None  # [SI]
    std: float | None  # [SI] combined standard uncertainty
    unit: str
    systematic: float | None  # [SI] part of it that repeats have in common; None if not stated
    residual: float | None  # [N] RMS
    flags: tuple[Flag, ...]
    verdict: str
    rejected: str | None  # the reason; None where it was not
    groups: Mapping[str, str] = field(default_factory=dict)  # of a curve: what ``curves.csv`` says of it

    @property
    def usable(self) -> bool:
        """True if its value may enter statistics."""
        has_number = self.value is not None and self.verdict != "invalid" and not needs_fact(self.verdict)
        return has_number and self.rejected is None


def tell_left_out(failures: Mapping[str, UserError], others: bool) -> None:
    """Say which files are left out, and why, up to twenty; raises what the first failed with if no other is left."""
    told = [*failures][0 if others else 1 :]
    for path in told[:_TOLD]:
        typer.echo(f"{path} is left out: {failures[path]}", err=True)
    if len(told) > _TOLD:
        typer.echo(f"and {len(told) - _TOLD} more", err=True)
    if failures and not others:
        raise next(iter(failures.values()))


def readings(
    path: Path, track: str | None, parameter: str, *, first: bool = False, where: str | None = None
) -> Iterator[ParameterValue]:
    """Readings of a run, or of every log, cycle or curve of `palpate fit`; `first`: of the first of several tracks.

    Of curves those `where` filter words hold. Raises LogError for what is not a result, ConfigurationError for an
    unknown track or parameter, and for words that do not parse.
    """
    if is_fit_folder(path):
        yield from _of_curves(FitFolder(path), track, parameter, first, where)
        return
    if where is not None:
        raise ConfigurationError(f"--where: {path} is not a folder of fits of many curves")
    file = path
    if path.is_dir():
        file = path / "fit.json" if (path / "fit.json").is_file() else path / "result.json"
    results, rejected = read_results(file), RunFolder(file.parent).rejected
    if results.cycles:
        rows = [row for row in results.cycles if track in (None, row["track"])]
        name = _chosen({row["track"]: None for row in rows}, track, file, first)
        rows = [row for row in rows if row["track"] == name]
        for row in sorted(rows, key=lambda row: (natural(row["log"]), row["cycle"])):
            key = f"{row['log']}#{row['cycle']}"
            known, flags = row["unknowns"].get(parameter, {}), read_flags(row["flags"])
            yield ParameterValue(
                f"{path}#{key}", file.parent, key, name, known.get("value"), known.get("std"), known.get("unit", ""),
                known.get("systematic"), row["rms"], flags, verdict(flags), rejected.get(key),
            )  # fmt: skip
        return
    for log in sorted(results.by_log, key=natural):
        yield _of_run(results.by_log[log], file, track, parameter, (path, log), first)


def _of_curves(
    folder: FitFolder, track: str | None, parameter: str, first: bool, where: str | None
) -> Iterator[ParameterValue]:
    name = _chosen(dict.fromkeys(folder.tracks), track, folder.path, first)
    if parameter not in folder.values:
        raise ConfigurationError(f"{folder.path}: no parameter {parameter!r}{suggest(parameter, folder.values)}")
    meanings = registry.load().meanings
    chosen: CurveFilter = curve_filter(where, folder, meanings)
    if old := stale_words(folder):
        typer.echo(old, err=True)
    for row in sorted(chosen.choose(folder.rows), key=lambda row: natural(row.curve)):
        if row.track in (name, ""):
            yield _of_curve(folder, row, name, parameter, meanings)


def _of_curve(
    folder: FitFolder, row: CurveRow, track: str, parameter: str, meanings: Mapping[str, Any]
) -> ParameterValue:
    flags = tuple(
        Flag(code, meanings[code].meaning if code in meanings else code,
             meanings[code].severity if code in meanings else "doubtful")
        for code in row.flags
    )  # fmt: skip
    return ParameterValue(
        f"{folder.path}#{row.curve}", folder.path, row.curve, track, row.number(parameter),
        row.number(f"{parameter}_combined"), folder.units.get(parameter, ""), row.systematic(parameter),
        row.number("rms"), flags, row.verdict_of(parameter) or row.verdict or "invalid", row.rejected, row.groups,
    )  # fmt: skip


def _of_run(
    document: dict[str, Any], file: Path, track: str | None, parameter: str, named: tuple[Path, str], first: bool
) -> ParameterValue:
    name = _chosen(document["tracks"], track, file, first)
    result = document["tracks"][name]
    known = {**result["parameters"], "surface": result["surface"]}
    if parameter not in known:
        raise ConfigurationError(f"{file}: no parameter {parameter!r}{suggest(parameter, known)}")
    found, (path, key) = known[parameter], named
    return ParameterValue(
        f"{path}#{key}" if key else str(path), file.parent, key, name, found["value"], found["combined"], found["unit"],
        found.get("systematic"), result["force_rms"], read_flags(result["flags"]), value_verdict(result, found),
        RunFolder(file.parent).rejected.get(key),
    )  # fmt: skip


def _chosen(tracks: Mapping[str, Any], track: str | None, file: Path, first: bool) -> str:
    if not tracks:
        raise LogError(f"{file}: has no result")
    if track is None and (first or len(tracks) == 1):
        return next(iter(tracks))
    if track is None:
        raise ConfigurationError(f"{file}: has {len(tracks)} tracks; choose one with --track: {', '.join(tracks)}")
    if track not in tracks:
        raise ConfigurationError(f"{file}: no track {track!r}{suggest(track, tracks)}")
    return track
