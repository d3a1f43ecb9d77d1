"""Reading ``result.json`` and ``fit.json``, of this version or an older one, checked key by key."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate import Flag, LogError
from palpate_engine import SCHEMA, bounded_text, json_document, needs_fact, registry as registries, verdict

from palpate_kit.runs.result_model import FitFileDocument, ResultDocument, problems
from palpate_kit.runs.run_model import Document

# What versions of an older schema did not write yet, by the tables that have it now.
_SINCE_TRACK: dict[str, Any] = {"derived": {}, "budget": []}
_SINCE_TOUCH = {"by": "threshold", "lag": 0.0}
_SINCE_TARE = {"until": None}


@dataclass(frozen=True)
class Results:
    """The results in a file: that of a run, or those of every log of a fit."""

    by_log: Mapping[str, dict[str, Any]]  # under "" that of a run
    cycles: Sequence[Mapping[str, Any]]  # fits of single cycles; see `CycleDocument`


def read_result(path: Path) -> dict[str, Any]:
    """Return the contents of ``result.json`` as this version writes them; raises LogError with the key that is
    damaged."""
    return _result(_document(path), path)


def read_results(path: Path) -> Results:
    """Return the results in a ``result.json`` or ``fit.json``; raises LogError with the key that is damaged."""
    document = _document(path)
    if "logs" not in document:
        return Results({"": _result(document, path)}, ())
    for cycle in _tables(document.get("cycles")):
        _upgrade_flags(cycle)
    _demand_valid(document, FitFileDocument, path)
    return Results(
        {log: _result(result, path, f"logs.{log}.") for log, result in document["logs"].items()},
        document.get("cycles", ()),
    )


def is_whole(path: Path) -> bool:
    """Return True if a result can be read as a document at all; half a file, or none, means that the run is not
    done."""
    try:
        return isinstance(json_document(bounded_text(path)), dict)
    except (OSError, ValueError, RecursionError):
        return False


@contextmanager
def open_table(path: Path, place: str) -> Iterator[None]:
    """Within the context a table is read that no schema describes, such as `details`; raises LogError with its name
    where that fails."""
    try:
        yield
    except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else error
        raise LogError(f"{path}: is a damaged result of palpate: {place}: {reason}") from error


def read_flags(tables: Iterable[Mapping[str, Any]]) -> tuple[Flag, ...]:
    """Return the flags of a result that was read."""
    return tuple(map(Flag.of_table, tables))


def _is_number(value: Mapping[str, Any]) -> bool:
    """Return True if the verdict of a value leaves a number to calculate with; results before schema 5 have none."""
    verdict = value.get("verdict") or ""
    return verdict != "invalid" and not needs_fact(verdict)


def value_verdict(track: Mapping[str, Any], value: Mapping[str, Any]) -> str:
    """Return the verdict of a value of a track: its own where it gives no number to calculate with, else that of the
    track."""
    return str(track["verdict"] if _is_number(value) else value["verdict"])


def values_by_name(track: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the parameters of a track and what follows from them, by name; none that gives no number to calculate
    with."""
    values = {**track.get("derived", {}), **track["parameters"]}
    return {name: value for name, value in values.items() if value["value"] is not None and _is_number(value)}


def estimate_of(value: Mapping[str, Any]) -> float | None:
    """Return the number that was estimated, also of what has no value to calculate with; None if it has none."""
    number: float | None = value["value"] if value["value"] is not None else value.get("estimate")
    return number


def usable_value(track: Mapping[str, Any], name: str) -> dict[str, Any] | None:
    """Return what a track says of a parameter; None where it has no value, or one that may not be used."""
    return values_by_name(track).get(name) if track["verdict"] != "invalid" else None


def _document(path: Path) -> dict[str, Any]:
    """Return the document in a file; raises LogError if it is not a result."""
    try:
        document = json_document(bounded_text(path))
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise LogError(f"{path}: is not a result of palpate: {error}") from error
    if not isinstance(document, dict) or not document.keys() & {"tracks", "logs"}:
        raise LogError(f"{path}: is not a result of palpate: it has no tracks")
    return document


def _result(document: Any, path: Path, place: str = "") -> dict[str, Any]:
    """Return the document of a ``result.json`` in the form of the present schema, whatever version wrote it.

    `place` is its place within the file, for messages. Raises LogError for a newer schema, or another document.
    """
    if isinstance(document, dict):
        schema = document.get("schema", 1)
        if schema not in range(1, SCHEMA + 1):
            writer = document.get("palpate", "another version")
            reads = f"this palpate reads up to {SCHEMA}: update it"
            raise LogError(f"{path}: {place}schema is {schema} (of palpate {writer}); {reads}")
        if schema < SCHEMA:
            _upgrade(document)
            document["schema"] = SCHEMA
    _demand_valid(document, ResultDocument, path, place)
    checked: dict[str, Any] = document
    for track in checked["tracks"].values():
        for value in (*track["parameters"].values(), *track["derived"].values()):
            if value["value"] is None and value.get("estimate") is not None:  # as it was written before
                value["value"] = value.pop("estimate")
    return checked


def _demand_valid(document: Any, model: type[Document], path: Path, place: str = "") -> None:
    if mistakes := problems(document, model):
        more = f" (and {len(mistakes) - 1} more)" if len(mistakes) > 1 else ""
        raise LogError(f"{path}: is a damaged result of palpate: {place}{mistakes[0]}{more}")


def _upgrade(document: dict[str, Any]) -> None:
    """Rename and complete the tables of a result of an earlier version; damaged entries are left as they are."""
    for run in _tables([document.get("run")]):
        for live in _tables([run.get("live")]):
            if "rest" in live:
                live["standstill"] = live.pop("rest")
        for key, since in (("tare", _SINCE_TARE), ("first_touch", _SINCE_TOUCH)):
            for table in _tables([run.get(key)]):
                run[key] = {**since, **table}
    tracks = document.get("tracks")
    for track in _tables([*tracks.values()] if isinstance(tracks, dict) else []):
        _upgrade_flags(track)
        for key, value in _SINCE_TRACK.items():
            track.setdefault(key, value)


def _upgrade_flags(table: dict[str, Any]) -> None:
    """Turn flags that are texts ``code: sentence``, as in schema 1, into tables, and add the verdict that they amount
    to."""
    entries = table.get("flags")
    if isinstance(entries, list) and all(isinstance(entry, str) for entry in entries):
        texts = [entry.partition(": ") for entry in entries]
        flags = registries.load().judged(Flag(code, message) for code, _, message in texts)
        table["flags"] = [flag.table() for flag in flags]
        table.setdefault("verdict", verdict(flags))


def _tables(entries: Any) -> list[dict[str, Any]]:
    """Return those of a document's entries that are tables; none without such a list."""
    return [entry for entry in entries if isinstance(entry, dict)] if isinstance(entries, list) else []
