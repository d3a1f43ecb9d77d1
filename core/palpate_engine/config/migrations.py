"""Pipelines of older versions: what was renamed since is read by its old name, with a flag; newer ones are refused."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Any

from palpate.errors import ConfigurationError
from palpate.flags import Flag
from palpate.key_mistakes import Location
from palpate.table_migration import Migration

from palpate_engine.config.pipeline_source import Source

FORMAT = "0.2"  # version of palpate in whose names pipelines are written today
KEY = "palpate"  # of a pipeline, at the top: the version for which it was written

# Renamed in the core's own tables; what plugins renamed comes by the hook `palpate_migrations`.
MIGRATIONS: tuple[Migration, ...] = (
    Migration(
        "0.2",
        "safety",
        keys={
            "rest": "standstill",
            "rest_force": "standstill_force",
            "rest_noise": "standstill_noise",
            "rest_speed": "standstill_speed",
            "rest_excess": "standstill_excess",
            "stale": "sensor_timeout",
        },
    ),
)


def migrate(source: Source, migrations: Iterable[Migration]) -> tuple[Flag, ...]:
    """Bring a source's tables to the names of today, as some migrations say; a flag for each that was renamed.

    A file that states no version may be of any. Raises ConfigurationError for one of a newer palpate.
    """
    stated = _stated(source)
    flags: list[Flag] = []
    for migration in migrations:
        if stated is None or stated < _version(migration.since):
            for location in _tables(source, migration):
                flags += _renamed(source, migration, location)
    return tuple(flags)


def _stated(source: Source) -> tuple[int, int] | None:
    given = source.tables.get(KEY)
    if given is None:
        return None
    where = source.where((KEY,))
    if not isinstance(given, str) or not re.fullmatch(r"\d+\.\d+(\.\d+)?", given):
        raise ConfigurationError(f'{where}: {KEY} is {given!r}; write a version, such as {KEY} = "{FORMAT}"')
    if _version(given) > _version(FORMAT):
        problem = f'written for palpate {given}, but this palpate reads up to "{FORMAT}": update it'
        raise ConfigurationError(f"{where}: {problem}")
    return _version(given)


def _version(text: str) -> tuple[int, int]:
    major, minor, *_ = text.split(".")
    return int(major), int(minor)


def _tables(source: Source, migration: Migration) -> Iterator[Location]:
    """Where the tables stand that a migration concerns: a plain one, or all of a type below a key of their kind."""
    if migration.type:
        yield from _of_type(source.tables, migration, ())
    elif isinstance(source.tables.get(migration.table), dict):
        yield (migration.table,)


def _of_type(table: dict[str, Any], migration: Migration, location: Location) -> Iterator[Location]:
    if migration.table in location and table.get("type") == migration.type:
        yield location
    for key, inner in table.items():
        if isinstance(inner, dict):
            yield from _of_type(inner, migration, (*location, key))


def _renamed(source: Source, migration: Migration, location: Location) -> Iterator[Flag]:
    table = source.table(location)
    said = f"since palpate {migration.since}"
    for old, new in migration.keys.items():
        *way, last = old.split(".")
        inner: Any = table
        for key in way:
            inner = inner.get(key) if isinstance(inner, dict) else None
        if not isinstance(inner, dict) or last not in inner:
            continue
        here = (*location, *way, last)
        where = source.where(here)
        if old in migration.converted:
            inner[last] = migration.converted[old](inner[last])
        if source.move(here, (*location, *new.split("."))):
            yield Flag("renamed", f"{where}: [{'.'.join(location)}] {old} is called {new} {said}")
    if migration.becomes:
        table["type"] = migration.becomes
        added = {key: value for key, value in migration.implied.items() if key not in table}
        table.update(added)
        with_these = f" with {', '.join(f'{key} = {value}' for key, value in added.items())}" if added else ""
        what = f"type {migration.type} is {migration.becomes}{with_these} {said}"
        yield Flag("renamed", f"{source.where(location)}: [{'.'.join(location)}] {what}")
