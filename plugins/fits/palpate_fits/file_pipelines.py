"""Files without a pipeline: how each is read is found out from it, and files that are read alike share a pipeline."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomli_w
from palpate import ConfigurationError, UserError, to_si
from palpate.host import Pipeline, Registry, Source, build_pipeline, registry, suggest
from palpate_kit.logs.draft_pipeline import readers_of, suggestion_of
from palpate_kit.logs.recording import Suggestion

from palpate_fits.curves import Curve

DEVICE, SETTINGS = "log", "pipeline.toml"
_TIMED = ("force", "position", "velocity")


@dataclass
class FileGroup:
    """Files that are read alike."""

    text: str  # of their pipeline
    path: Path  # what messages call it
    pipeline: Pipeline
    curves: list[Curve] = field(default_factory=list)


def tip_table(text: str, known: Registry) -> dict[str, Any]:
    """The table of a tip such as "sphere 3 mm", "sphere diameter 6 mm" or "blunt-cone angle 30 deg tip_radius 1 mm".

    A single value is that of the one key that the tip needs, the radius of a sphere. Raises ConfigurationError.
    """
    name, *words = text.split() or [""]
    tips = known.parts["indenter"]
    if name not in tips:
        raise ConfigurationError(f"--tip {text!r}: there is no tip {name!r}{suggest(name, list(tips))}")
    fields = known.find("indenter", name).model_fields
    keys = [*fields, "diameter"] if "radius" in fields else list(fields)
    needed = [key for key, about in fields.items() if about.is_required()]
    table: dict[str, list[str]] = {}
    if words and words[0] not in keys:
        if words[0][:1].isalpha() or len(needed) != 1:
            wrong = f"has no {words[0]!r}{suggest(words[0], keys)}" if words[0][:1].isalpha() else "needs a key each"
            raise ConfigurationError(f"--tip {text!r}: {name} {wrong} (keys: {', '.join(keys)})")
        words = [needed[0], *words]
    for word in words:
        if word in keys:
            table[word] = []
        else:
            table[list(table)[-1]].append(word)
    values: dict[str, Any] = {key: " ".join(value) for key, value in table.items()}
    if "diameter" in values:
        try:
            values["radius"] = 0.5 * to_si(values.pop("diameter"), "m")
        except ValueError as error:
            raise ConfigurationError(f"--tip {text!r}: diameter: {error}") from error
    if missing := [key for key in needed if not values.get(key)]:
        raise ConfigurationError(f'--tip {text!r}: {name} needs its {missing[0]}, as in --tip "{name} 3 mm"')
    return {"type": name, **values}


def files_among(sources: Sequence[Path], known: Registry) -> list[Path]:
    """The files, and of folders all that a device reads and palpate did not write; raises ConfigurationError."""
    readers = readers_of(known).values()
    found: list[Path] = []
    for source in sources:
        if not source.exists():
            raise ConfigurationError(f"{source}: there is no such file or folder")
        if source.is_dir():
            own = {settings.parent for settings in source.rglob(SETTINGS)}
            files = [path for path in sorted(source.rglob("*")) if path.is_file() and not own & {*path.parents}]
            found += [path for path in files if any(reader.recognises(path) for reader in readers)]
        else:
            found.append(source)
    if not found:
        raise ConfigurationError(f"{', '.join(map(str, sources))}: holds no file that palpate can read")
    return list(dict.fromkeys(found))


def file_groups(
    files: Iterable[Path],
    tip: str,
    model: str,
    choices: Mapping[str, str],
    overrides: Sequence[str],
    refused: dict[str, str],
) -> Iterator[FileGroup]:
    """Files by how they are read; `refused` takes those of which that cannot be told, with what must be said.

    `choices` name the columns of roles, as of ``palpate info --suggest``.

    Raises ConfigurationError for a tip, a model or an override that is none.
    """
    known = registry.load()
    parts = _parts(tip_table(tip, known), known.named("model", model), known)
    groups: dict[str, FileGroup] = {}
    for file in files:
        try:
            suggestion = _suggestion(file, choices, overrides)
        except UserError as error:
            refused[str(file)] = str(error).removeprefix(f"{file}: ")
            continue
        key = json.dumps([{**suggestion.device, "file": ""}, suggestion.alignment], default=str)
        if key not in groups:
            tables = _tables(suggestion, file, parts, overrides)
            path = Path(f"pipeline of {file.name}")
            groups[key] = FileGroup(tomli_w.dumps(tables), path, _built(tables, path, overrides))
        groups[key].curves.append(Curve(str(file), str(file.resolve())))
    yield from groups.values()


def _suggestion(file: Path, choices: Mapping[str, str], overrides: Sequence[str]) -> Suggestion:
    """How a file is read; raises ConfigurationError with what only the user can say."""
    suggestion = suggestion_of(file, dict(choices))
    answers = {assignment.partition("=")[0].strip() for assignment in overrides}
    asked = [text for text in suggestion.blanks if f"device.{DEVICE}.{text.partition(':')[0]}" not in answers]
    if asked:
        key = asked[0].partition(":")[0]
        option = f"--{key}" if key in ("force", "position", "time", "rate") else f"--set device.{DEVICE}.{key}="
        raise ConfigurationError(f"{asked[0]}; say it with {option}")
    return suggestion


def _parts(tip: dict[str, Any], model: str, known: Registry) -> dict[str, Any]:
    table: dict[str, Any] = {"type": model}
    if "indenter" in known.find("model", model).model_fields:
        table["indenter"] = "tip"
    return {"indenter": {"tip": tip}, "model": {model: table}, "estimator": {"fit": {"type": "casadi-fit"}}}


def _tables(suggestion: Suggestion, file: Path, parts: Mapping[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """The tables of the pipeline; delays and tare that neither file nor user states are assumed, and flagged."""
    stated = {assignment.partition("=")[0].strip() for assignment in overrides}
    roles = [role for role in _TIMED if role in suggestion.alignment]
    timed = any(f"alignment.{role}.{key}" in stated for role in roles for key in ("delay", "uncertainty"))
    assumed = ["alignment.tare"] if "alignment.tare" not in stated else []
    assumed += [f"alignment.{role}.delay" for role in roles] if not timed else []
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
