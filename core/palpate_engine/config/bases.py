"""``[run] base``: tables of a rig that several pipeline files share."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from palpate.errors import ConfigurationError
from palpate.input_file import check_input
from palpate.key_mistakes import Location
from palpate.parts import TextOfFile
from pydantic import ValidationError

from palpate_engine.config.file_version import KEY, demand_version
from palpate_engine.config.pipeline_source import Source
from palpate_engine.safety import SafetySettings

BASE = ("run", "base")
BASE_TABLES = ("device", "alignment", "safety", "indenter", "rig")
BASE_RUN_KEYS = ("base", "rig")
# Limits of [safety] that are looser where they are smaller; all others are looser where they are larger.
LOOSER_BELOW = ("low", "stiffness", "latency", "sensor_delay", "standstill")


def apply_bases(source: Source) -> None:
    """Put the tables of the files that ``[run] base`` names below those of a source, which keep their own keys.

    Later files win key by key; lists are replaced whole, and so is a table of another `type`. The source is changed in
    place. Raises ConfigurationError for a file that cannot be read, is its own base, or holds more than a rig.
    """
    run = source.tables.get("run")
    if not isinstance(run, dict) or "base" not in run:
        return
    # The tables of the bases, and ``file:line`` of each of their keys.
    tables, origins = _tables_of_bases(source, (source.path.resolve(),))
    run.pop("base")
    # What the bases state of safety is kept: a source may narrow it, and not widen it.
    source.base_safety = dict(tables.get("safety", {}))
    _merge(tables, over=source.tables, head=(), origins=origins)
    source.tables.clear()
    source.tables.update(tables)
    source.inherited = origins


def _tables_of_bases(source: Source, chain: tuple[Path, ...]) -> tuple[dict[str, Any], dict[Location, str]]:
    """Return the tables of all bases of a source, merged, and ``file:line`` of each of their keys.

    `chain` has the files that lead to the source, by which a file that is its own base is seen. Raises
    ConfigurationError.
    """
    file_names, key_place = source.tables.get("run", {}).get("base", []), source.where(BASE)
    if not isinstance(file_names, list) or not all(isinstance(file_name, str) for file_name in file_names):
        raise ConfigurationError(f'{key_place}: [run] base: must be a list of files, such as ["lab.toml"]')
    tables: dict[str, Any] = {}
    origins: dict[Location, str] = {}
    for file_name in file_names:
        path = source.path.parent / os.path.expanduser(file_name)
        if path.resolve() in chain:
            chain_text = " -> ".join(file.name for file in (*chain, path))
            raise ConfigurationError(f"{key_place}: [run] base: a file is its own base: {chain_text}")
        try:
            check_input(path, source.enclosure)
            base = Source.read(path, named=False)  # a file names it, and no person
        except (ConfigurationError, ValueError) as error:
            raise ConfigurationError(f"{key_place}: [run] base: {error}") from error
        # A base may have bases of its own, below it; a later base stands above an earlier one.
        base_tables, base_origins = _tables_above_bases(base, (*chain, path.resolve()))
        _merge(tables, over=base_tables, head=(), origins=origins)
        origins |= base_origins
    return tables, origins


def _tables_above_bases(base: Source, chain: tuple[Path, ...]) -> tuple[dict[str, Any], dict[Location, str]]:
    """Return the tables of a base over those of its own bases, and ``file:line`` of each key.

    Raises ConfigurationError where it holds more than a rig, or is of a newer palpate.
    """
    _demand_rig(base)
    demand_version(base)
    tables, origins = _tables_of_bases(base, chain)
    own_tables = {key: table for key, table in base.tables.items() if key != KEY}
    if "run" in own_tables:
        own_tables["run"] = {key: value for key, value in own_tables["run"].items() if key != "base"}
    _merge(tables, over=_with_folder(own_tables, base.path.parent), head=(), origins=origins)
    _note_origins(own_tables, base, (), origins)
    return tables, origins


def _demand_rig(base: Source) -> None:
    """Raise ConfigurationError where a base holds anything but the tables of a rig."""
    for key, table in base.tables.items():
        if key == "run" and isinstance(table, dict):
            foreign_keys = [(key, name) for name in table if name not in BASE_RUN_KEYS]
        else:
            first = next(iter(table), "") if isinstance(table, dict) else ""
            foreign_keys = [] if key in (*BASE_TABLES, KEY) else [(key, first)]
        if foreign_keys:
            key_text = f"[{key}] {foreign_keys[0][1]}" if key == "run" else ".".join(filter(None, foreign_keys[0]))
            allowed = "[device.*], [alignment], [safety], [indenter.*], [rig] and [run] rig"
            raise ConfigurationError(f"{base.where(foreign_keys[0])}: {key_text}: a base holds only {allowed}")


def _with_folder(value: Any, folder: Path) -> Any:
    """Return a value in which every text knows the folder of its file, to which a path in it is relative."""
    if isinstance(value, dict):
        return {key: _with_folder(item, folder) for key, item in value.items()}
    if isinstance(value, list):
        return [_with_folder(item, folder) for item in value]
    return TextOfFile(value, folder) if isinstance(value, str) else value


def _merge(tables: dict[str, Any], over: Mapping[str, Any], head: Location, origins: dict[Location, str]) -> None:
    """Put the tables `over` those at a location, key by key; the origins of replaced keys are taken out.

    `origins` has ``file:line`` of each key that a base states, by its location in the pipeline; `head` is the location
    of the tables, () of the file.
    """
    for key, value in over.items():
        # A signal in its short form is a table with its channel.
        below, location = tables.get(key), (*head, key)
        if location[0] == "alignment" and isinstance(value, dict) and isinstance(below, str):
            below = tables[key] = {"channel": below}  # a signal in its short form
            if location in origins:
                origins[*location, "channel"] = origins.pop(location)
        # Tables are merged key by key; another part, a list or a number replaces what is below.
        is_other_part = isinstance(below, dict) and isinstance(value, dict) and _types_differ(below, value)
        if isinstance(below, dict) and isinstance(value, dict) and not is_other_part:
            _merge(below, value, location, origins)
            continue
        for replaced_key in [key_below for key_below in origins if key_below[: len(location)] == location]:
            del origins[replaced_key]
        tables[key] = value


def _types_differ(below: Mapping[str, Any], over: Mapping[str, Any]) -> bool:
    """Return True if two tables are of parts of different types, whose keys do not mix."""
    return "type" in below and "type" in over and below["type"] != over["type"]


def _note_origins(table: Mapping[str, Any], base: Source, head: Location, origins: dict[Location, str]) -> None:
    """Note ``file:line`` of every key in the tables of a base."""
    for key, value in table.items():
        if isinstance(value, dict):
            _note_origins(value, base, (*head, key), origins)
        else:
            origins[*head, key] = base.where((*head, key))


def looser_limits(source: Source, safety: SafetySettings | None) -> tuple[str, ...]:
    """Return a sentence for each limit of [safety] that is looser than that of the base."""
    stated = source.tables.get("safety", {})
    changed = [key for key, value in source.base_safety.items() if stated.get(key) != value]
    if safety is None or not changed:
        return ()
    try:
        base = SafetySettings.model_validate({**stated, **source.base_safety}, context={"base": source.path.parent})
    except ValidationError:  # a wrong value of a base that nothing uses
        return ()
    return tuple(
        f"[safety] {key}: {stated[key]!r} is looser than {source.base_safety[key]!r} of the base"
        for key in changed
        if key in stated and _is_looser(key, getattr(safety, key, None), getattr(base, key, None))
    )


def _is_looser(key: str, value: Any, base: Any) -> bool:
    """Return True where a limit admits more than that of the base does; any of its components decides."""
    if base is None or value is None:
        return base is not None
    values, bases = (item if isinstance(item, tuple) else (item,) for item in (value, base))
    if not all(isinstance(item, int | float) for item in (*values, *bases)):
        return bool(value != base)
    # Three coordinates of a corner are limits by themselves: the loosest decides.
    pairs = list(zip(values, bases, strict=True))
    return any(a < b for a, b in pairs) if key in LOOSER_BELOW else any(a > b for a, b in pairs)
