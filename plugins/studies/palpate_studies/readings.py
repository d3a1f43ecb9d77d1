"""What runs, logs and cycles say of one parameter of one track, each by its name, and which were rejected."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate import ConfigurationError, Flag, LogError
from palpate.host import RunFolder, read_flags, suggest, upgraded, verdict


@dataclass(frozen=True)
class Reading:
    """One value with what it is judged by."""

    name: str  # of the run folder or file; of a log in a fit FOLDER#LOG, of a cycle FOLDER#LOG#CYCLE
    folder: Path  # where marks of a review stand
    key: str  # under which they stand there; "" is the run itself
    track: str
    value: float | None  # [SI]
    std: float | None  # [SI] combined standard uncertainty
    unit: str
    residual: float | None  # [N] RMS
    flags: tuple[Flag, ...]
    verdict: str
    rejected: str | None  # the reason; None where it was not

    @property
    def usable(self) -> bool:
        """Whether its value may enter statistics."""
        return self.value is not None and self.verdict != "invalid" and self.rejected is None


def natural(path: Path | str) -> list[tuple[int, str]]:
    """A key that sorts run_2 before run_10."""
    return [(int(part), "") if part.isdigit() else (0, part) for part in re.split(r"(\d+)", str(path)) if part]


def readings(path: Path, track: str | None, parameter: str, *, first: bool = False) -> Iterator[Reading]:
    """Readings of a run, or of every log, or cycle, of `palpate fit`; `first`: of the first of several tracks.

    Raises LogError for what is no result, ConfigurationError where there is no such track or parameter.
    """
    file = path
    if path.is_dir():
        file = path / "fit.json" if (path / "fit.json").is_file() else path / "result.json"
    document = _document(file)
    folder = file.parent
    rejected = RunFolder(folder).rejected
    if document.get("cycles"):
        rows = [row for row in document["cycles"] if track in (None, row["track"])]
        name = _chosen({row["track"]: None for row in rows}, track, file, first)
        rows = [row for row in rows if row["track"] == name]
        for row in sorted(rows, key=lambda row: (natural(row["log"]), row["cycle"])):
            key = f"{row['log']}#{row['cycle']}"
            known, flags = row["unknowns"].get(parameter, {}), read_flags(row["flags"])
            yield Reading(
                f"{path}#{key}", folder, key, name, known.get("value"), known.get("std"), known.get("unit", ""),
                row["rms"], flags, verdict(flags), rejected.get(key),
            )  # fmt: skip
    elif "logs" in document:
        for log in sorted(document["logs"], key=natural):
            yield _of_run(upgraded(document["logs"][log], file), file, track, parameter, (path, log), first)
    else:
        yield _of_run(upgraded(document, file), file, track, parameter, (path, ""), first)


def _document(file: Path) -> dict[str, Any]:
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise LogError(f"{file}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise LogError(f"{file}: is no result of palpate: {error}") from error
    if not isinstance(document, dict):
        raise LogError(f"{file}: is no result of palpate")
    return document


def _of_run(
    document: dict[str, Any], file: Path, track: str | None, parameter: str, named: tuple[Path, str], first: bool
) -> Reading:
    name = _chosen(document["tracks"], track, file, first)
    result = document["tracks"][name]
    known = {**result["parameters"], "surface": result["surface"]}
    if parameter not in known:
        raise ConfigurationError(f"{file}: there is no parameter {parameter!r}{suggest(parameter, known)}")
    found, (path, key) = known[parameter], named
    std = found.get("combined", found.get("std"))
    return Reading(
        f"{path}#{key}" if key else str(path), file.parent, key, name, found["value"], std, found["unit"],
        result.get("force_rms"), read_flags(result["flags"]), result["verdict"],
        RunFolder(file.parent).rejected.get(key),
    )  # fmt: skip


def _chosen(tracks: Mapping[str, Any], track: str | None, file: Path, first: bool) -> str:
    if track is None and tracks and (first or len(tracks) == 1):
        return next(iter(tracks))
    if track is None:
        raise ConfigurationError(f"{file}: has {len(tracks)} tracks; choose one with --track: {', '.join(tracks)}")
    if track not in tracks:
        raise ConfigurationError(f"{file}: there is no track {track!r}{suggest(track, tracks)}")
    return track
