"""The pipeline as resolved: every setting with the value that was used, written back as TOML."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w
from palpate.contact import ContactModel
from palpate.parts import Part, Settings
from palpate.registry import Registry

from palpate_engine.config.file_version import FORMAT, KEY
from palpate_engine.config.pipeline import Pipeline
from palpate_engine.config.third_parties import third_party_versions
from palpate_engine.config.unit_plausibility import UNCHECKED, implausible_units

POISSON = "poisson"  # of a model: a fact of the specimen, which is open until it is stated


def resolved_text(pipeline: Pipeline, beside: Path | None = None) -> str:
    """Return the pipeline as a TOML text in SI units, with every default spelled out but a Poisson's ratio.

    Tips, models and surfaces are named where they are used, so that what changes one changes all that is made of it.
    Paths are absolute, so that the text means the same wherever it is kept; those `beside` a folder are as seen from
    it, so that the text and its files can be moved together.
    """
    if beside is not None:
        tables = _as_seen_from(beside.resolve(), tomllib.loads(resolved_text(pipeline)))
        return _origins(pipeline) + tomli_w.dumps(tables)
    registry = pipeline.registry
    tables = {KEY: FORMAT, "run": _run_table(pipeline), "alignment": plain_settings(pipeline.alignment, registry)}
    if pipeline.safety is not None:
        tables["safety"] = plain_settings(pipeline.safety, registry)
    tables |= _tables_of_parts(pipeline)
    # A part that has a table of its own is named wherever another one uses it.
    named = {kind: dict(tables[kind]) for kind in ("indenter", "model", "surface")}
    for kind in ("model", "device", "trajectory", "twin"):
        for name, part in tables[kind].items():
            tables[kind][name] = {key: _by_name(item, named) for key, item in part.items()}
    tables["alignment"] = {key: _by_name(item, named) for key, item in tables["alignment"].items()}
    # Settings of analyses come last, and empty tables are left out.
    tables |= {name: plain_settings(table, registry) for name, table in pipeline.tables.items()}
    return _origins(pipeline) + tomli_w.dumps({name: table for name, table in tables.items() if table})


def _run_table(pipeline: Pipeline) -> dict[str, Any]:
    """Return the table [run], with what only the rig and the installation know: true values, distributions."""
    table: dict[str, Any] = plain_settings(pipeline.run, pipeline.registry)
    if truth := pipeline.truth:  # which a replay of the log has no rig to ask for
        table["truth"] = truth
    if versions := third_party_versions(pipeline):
        table["distributions"] = [f"{name} {version}" for name, version in versions.items()]
    return table


def _tables_of_parts(pipeline: Pipeline) -> dict[str, dict[str, Any]]:
    """Return the table of every part, by kind and name."""
    kinds: dict[str, Mapping[str, Any]] = {
        "device": pipeline.devices,
        "surface": pipeline.surfaces,
        "trajectory": pipeline.trajectories,
        "indenter": pipeline.indenters,
        "model": pipeline.models,
        "estimator": pipeline.estimators,
        "sink": pipeline.sinks,
        "twin": pipeline.twins,
    }
    registry = pipeline.registry
    return {
        kind: {name: plain_settings(part, registry) for name, part in parts.items()} for kind, parts in kinds.items()
    }


def _origins(pipeline: Pipeline) -> str:
    """Return comments with the place of each key that a base of the pipeline states."""
    return "".join(f"# {key}: {Path(place).absolute()}\n" for key, place in sorted(pipeline.inherited.items()))


def _as_seen_from(folder: Path, value: Any) -> Any:
    """Return the same with every absolute path of a file or folder that there is as seen from a folder."""
    if isinstance(value, dict):
        return {key: _as_seen_from(folder, item) for key, item in value.items()}
    if isinstance(value, list):
        return [_as_seen_from(folder, item) for item in value]
    is_name = isinstance(value, str) and value.startswith(os.sep) and value.strip(os.sep)  # "//" begins a comment
    is_there = is_name and Path(value).exists()
    return os.path.relpath(Path(value).resolve(), folder) if is_there else value


def _by_name(value: Any, named: Mapping[str, Mapping[str, Any]]) -> Any:
    """Return the same with the name of each part that stands in a table of its own in place of its settings."""
    if isinstance(value, dict):
        inner = {key: _by_name(item, named) for key, item in value.items()}
        same = (name for parts in named.values() for name, part in parts.items() if part in (value, inner))
        return next(same, inner)
    return [_by_name(item, named) for item in value] if isinstance(value, list) else value


def plain_settings(value: Any, registry: Registry) -> Any:
    """Return settings and parts as TOML can hold them, each part with its type."""
    if isinstance(value, Settings):
        return _plain_table(value, registry)
    if isinstance(value, dict):
        return {name: plain_settings(item, registry) for name, item in value.items() if item is not None}
    if isinstance(value, tuple | list):
        return [plain_settings(item, registry) for item in value]
    return str(value.absolute()) if isinstance(value, Path) else value


def _plain_table(settings: Settings, registry: Registry) -> dict[str, Any]:
    """Return the table of settings: type of a part, keys that are meant without a unit, fields that are not None."""
    table: dict[str, Any] = {"type": registry.name_of(type(settings))} if isinstance(settings, Part) else {}
    fields = {name: getattr(settings, name) for name in type(settings).model_fields}
    # What is unlikely without a unit was checked when it was read.
    unchecked = sorted(implausible_units(type(settings), fields))
    if unchecked:
        table[UNCHECKED] = unchecked
    # Written out, a Poisson's ratio that nobody stated would be stated.
    if isinstance(settings, ContactModel) and POISSON not in settings.model_fields_set:
        fields.pop(POISSON, None)
    fields |= settings.model_extra or {}
    return table | {name: plain_settings(field, registry) for name, field in fields.items() if field is not None}
