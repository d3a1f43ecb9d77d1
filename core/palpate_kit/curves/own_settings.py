"""``own.toml``: settings of single curves, which override those of all."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

import tomli_w
from palpate import LogError, suggest
from palpate_engine import bounded_text, toml_tables, write_whole

OWN = "own.toml"
_KEY = "set"
Own = dict[str, tuple[str, ...]]  # ``table.key=value`` by the name of the curve


def read_own(folder: Path, curves: Collection[str] | None = None) -> Own:
    """Return the settings of single curves; none without the file.

    Raises LogError for a file that is not valid, and for a curve that is not among the `curves`.
    """
    path = folder / OWN
    if not path.is_file():
        return {}
    try:
        tables = toml_tables(bounded_text(path))
    except (OSError, ValueError) as error:
        raise LogError(f"{path}: cannot be read: {error}") from error
    return {name: _assignments(path, name, table, curves) for name, table in tables.items()}


def _assignments(path: Path, name: str, table: object, curves: Collection[str] | None) -> tuple[str, ...]:
    """Return the assignments in the table of one curve; raises LogError for an unknown curve and for a bad table."""
    if curves is not None and name not in curves:
        raise LogError(f"{path}: no curve {name!r}{suggest(name, curves)}")
    if not isinstance(table, Mapping):
        raise LogError(f'{path}: {name}: must be a table, as in ["{name}"] with set = ["estimator.fit.segment=load"]')
    if unknown := next((key for key in table if key != _KEY), None):
        raise LogError(f"{path}: [{name}] {unknown}: no such key{suggest(unknown, [_KEY])}")
    values = table.get(_KEY, [])
    if not isinstance(values, list) or not all(isinstance(text, str) and "=" in text for text in values):
        raise LogError(f'{path}: [{name}] set: must be a list of texts such as "estimator.fit.segment=load"')
    return tuple(values)


def write_own(folder: Path, own: Mapping[str, Collection[str]]) -> None:
    """Write the settings of single curves, those without any left out; raises OutputError."""
    tables = {name: {_KEY: list(own[name])} for name in sorted(own) if own[name]}
    if tables or (folder / OWN).exists():
        write_whole(folder / OWN, tomli_w.dumps(tables))


def change_assignments(
    assignments: Collection[str], new: Collection[str], unset: Collection[str] = ()
) -> tuple[str, ...]:
    """Return assignments with new ones in place of those of the same key, and without the keys to `unset`."""
    by_key = {text.partition("=")[0].strip(): text for text in assignments}
    for key in unset:
        by_key.pop(key.strip(), None)
    for text in new:
        by_key[text.partition("=")[0].strip()] = text
    return tuple(by_key.values())
