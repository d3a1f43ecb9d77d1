"""Files without a pipeline: how each is read is found out from it, and files that are read alike share a pipeline."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import tomli_w
from palpate import ConfigurationError, to_si
from palpate_engine import Pipeline, Registry, Source, build_pipeline, registry
from palpate_kit.curves.alike_logs import LogPart, alike_logs
from palpate_kit.curves.curve_files import Curve
from palpate_kit.logs.draft_pipeline import rate_note, suggestion_of
from palpate_kit.runs.tip_words import tip_table
from palpate_records.recording import Suggestion

DEVICE = "log"
_READER = f"device.{DEVICE}."
_OF_TIP = re.compile(r"\b(tip|probe|indenter|ball|sphere|kugel)", re.IGNORECASE)
_ACROSS = re.compile(r"diameter|durchmesser", re.IGNORECASE)
_ALIKE = 0.02  # by which a tip may miss what a file states
_TIMED = ("force", "position", "velocity")


@dataclass
class FileGroup:
    """Files that are read alike."""

    text: str  # of their pipeline
    path: Path  # what messages call it
    pipeline: Pipeline
    doubts: tuple[str, ...]  # what in it is a guess
    curves: list[Curve] = field(default_factory=list)


def file_groups(
    files: Iterable[LogPart],
    tip: str,
    model: str,
    choices: Mapping[str, str],
    overrides: Sequence[str],
    refused: dict[str, str],
    notes: list[str],
) -> Iterator[FileGroup]:
    """Files by how they are read, the most first; `refused` takes the others and why, `notes` what is ignored.

    `choices` name the columns of roles, as of ``palpate info --suggest``.

    Raises ConfigurationError for a tip, a model or an override that is none.
    """
    known = registry.load()
    parts = _parts(tip_table(tip, known, "--tip"), known.named("model", model), known)
    stated = {key.strip(): value.strip().strip("\"'") for key, _, value in (text.partition("=") for text in overrides)}
    facts: dict[LogPart, Suggestion] = {}

    def suggested(file: LogPart) -> Suggestion:
        found = _suggestion(file.path, {**dict(file.keys), **choices}, stated, known)
        facts[file] = replace(found, views={})  # without its numbers
        return found

    groups = alike_logs(files, suggested, refused)
    notes += _no_records([log for group in groups for log in group.logs], refused)
    if note := rate_note(choices, facts.values()):
        notes.append(note)
    for group in groups:
        first, suggestion = group.logs[0], group.suggestion
        tables = _tables(suggestion, first.path, parts, stated)
        path = Path(f"pipeline of {first.name}")
        pipeline = _built(tables, path, overrides)
        known_now = [text for key, text in suggestion.guesses.items() if f"{_READER}{key}" in stated]
        others = f" and {len(group.logs) - 1} more" if len(group.logs) > 1 else ""
        doubts = [f"{file.name}: {text}" for file in group.logs for text in _other_tips(facts[file], pipeline)]
        doubts += [f"{first.name}{others}: {text}" for text in suggestion.doubts if text not in known_now]
        curves = [Curve(str(file), str(file.path.resolve())) for file in group.logs]
        yield FileGroup(tomli_w.dumps(tables), path, pipeline, tuple(doubts), curves)


def _no_records(read: Sequence[LogPart], refused: dict[str, str]) -> list[str]:
    """The sheets and tables that are no record, beside others of the same file that are: named, and left out."""
    files = {str(log.path) for log in read if log.part is not None}
    beside = [name for name in refused if name not in files and any(name.startswith(f"{file}:") for file in files)]
    return [f"{name} is no record, and left out: {refused.pop(name)}" for name in beside]


def _suggestion(file: Path, choices: Mapping[str, str], stated: Mapping[str, str], known: Registry) -> Suggestion:
    """How a file is read; raises ConfigurationError with what only the user can say."""
    keys = {key.removeprefix(_READER): value for key, value in stated.items() if key.startswith(_READER)}
    keys.pop("time", None)  # a table, which no choice is
    suggestion = suggestion_of(file, {**keys, **choices}, known)
    asked = [text for text in suggestion.blanks if f"{_READER}{text.partition(':')[0]}" not in stated]
    if asked:
        key = asked[0].partition(":")[0]
        option = f"--{key}" if key in ("force", "position", "time", "rate") else f"--set {_READER}{key}=NUMBER"
        raise ConfigurationError(f"{asked[0]}; say it with {option}")
    for role, columns in suggestion.rivals.items():
        raise ConfigurationError(f"the {role} can be {', '.join(columns)}; say which with --{role}")
    return suggestion


def _other_tips(suggestion: Suggestion, pipeline: Pipeline) -> list[str]:
    """Where a file states another radius of the tip than its pipeline."""
    radius = getattr(next(iter(pipeline.indenters.values())), "radius", None)
    found = []
    for line, name, value in suggestion.facts:
        across = _ACROSS.search(name) is not None
        if radius is None or not _OF_TIP.search(name) or not (across or "radius" in name.lower()):
            continue
        try:
            unit = re.search(r"[\[(]([^\])]+)[\])]", name)
            theirs = to_si(f"{value} {unit[1]}" if unit else value, "m") * (0.5 if across else 1.0)
        except ValueError:
            continue
        if abs(theirs / radius - 1.0) > _ALIKE:
            found.append(f"line {line} states {name}: {value}, and --tip a radius of {1e3 * radius:g} mm")
    return found


def _parts(tip: dict[str, Any], model: str, known: Registry) -> dict[str, Any]:
    table: dict[str, Any] = {"type": model}
    if "indenter" in known.find("model", model).model_fields:
        table["indenter"] = "tip"
    return {"indenter": {"tip": tip}, "model": {model: table}, "estimator": {"fit": {"type": "casadi-fit"}}}


def _tables(suggestion: Suggestion, file: Path, parts: Mapping[str, Any], stated: Mapping[str, str]) -> dict[str, Any]:
    """The tables of the pipeline; units, delays and tare that neither file nor user states are assumed, and flagged."""
    roles = [role for role in _TIMED if role in suggestion.alignment]
    timed = any(f"alignment.{role}.{key}" in stated for role in roles for key in ("delay", "uncertainty"))
    assumed = ["alignment.tare"] if "alignment.tare" not in stated else []
    assumed += [f"alignment.{role}.delay" for role in roles] if not timed else []
    assumed += [f"{_READER}{key}" for key in suggestion.guesses if f"{_READER}{key}" not in stated]
    return {
        "run": {"assumed": assumed},
        "device": {DEVICE: {**suggestion.device, "file": str(file.resolve())}},
        "alignment": dict(suggestion.alignment),
        **parts,
    }


def _built(tables: Mapping[str, Any], path: Path, overrides: Sequence[str]) -> Pipeline:
    source = Source(tomli_w.dumps(tables), path)
    for assignment in overrides:
        source.override(assignment)
    return build_pipeline(source)
