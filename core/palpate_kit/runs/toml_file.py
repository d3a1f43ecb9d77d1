"""Small files in TOML that people and commands share: calibrations, control charts, references, registrations."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, TypeVar

from palpate import ConfigurationError, Settings
from palpate_engine import bounded_text, toml_tables
from pydantic import ValidationError

File = TypeVar("File", bound=Settings)


def read_tables(path: Path, noun: str) -> dict[str, Any]:
    """Return the tables of a file; raises ConfigurationError if it cannot be read or is not TOML."""
    try:
        tables: dict[str, Any] = toml_tables(bounded_text(path))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigurationError(f"{path}: cannot read the {noun}: {reason}") from error
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(f"{path}: is a damaged {noun}, not TOML: {error}") from error
    return tables


def read_settings(path: Path, settings_class: type[File], noun: str) -> File:
    """Return the tables of a file as settings of a class; raises ConfigurationError for a file that is not valid."""
    return settings_of(read_tables(path, noun), path, settings_class, noun)


def settings_of(tables: dict[str, Any], path: Path, settings_class: type[File], noun: str) -> File:
    """Return tables as settings of a class; raises ConfigurationError if they are invalid."""
    try:
        return settings_class.model_validate(tables)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise ConfigurationError(f"{path}: is not a {noun}: {_place(first['loc'])}: {first['msg']}") from error


def _place(steps: tuple[int | str, ...]) -> str:
    """Return a place in the file as people count: ``check 3, value``."""
    parts = [f" {step + 1}" if isinstance(step, int) else f", {step}" for step in steps]
    return "".join(parts).removeprefix(", ")
