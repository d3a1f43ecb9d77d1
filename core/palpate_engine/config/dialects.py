"""``[dialect.NAME]``: the tables by which a pipeline reads files that are written in another way."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from palpate.errors import ConfigurationError, suggest

from palpate_engine.config.pipeline_source import Source

DIALECT = "dialect"


def dialect_tables(tables: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the tables of a pipeline with those of a dialect in place of its own; of no name its own.

    Raises ConfigurationError for an unknown dialect.
    """
    own_tables = {key: table for key, table in tables.items() if key != DIALECT}
    if not name:
        return own_tables
    dialects = tables.get(DIALECT, {})
    if not isinstance(dialects, dict) or not isinstance(dialects.get(name), dict):
        raise ConfigurationError(f"no [{DIALECT}.{name}]{suggest(name, dialects)}")
    return {**own_tables, **dialects[name]}


def with_dialect(tables: Mapping[str, Any], name: str, others: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables with a dialect of what other tables of a pipeline have otherwise."""
    differing = {key: table for key, table in others.items() if tables.get(key) != table}
    return {**tables, DIALECT: {**tables.get(DIALECT, {}), name: differing}}


def choose_dialect(source: Source) -> None:
    """Take the dialects out of a source, and the tables of the one that ``run.dialect`` names in; settings stay.

    Raises ConfigurationError for an unknown dialect.
    """
    run = source.tables.get("run")
    name = run.pop(DIALECT, "") if isinstance(run, dict) else ""
    if name or DIALECT in source.tables:
        try:
            source.exchange(dialect_tables(source.tables, str(name)))
        except ConfigurationError as error:
            raise ConfigurationError(f"{source.where(('run', DIALECT))}: {error}") from error
