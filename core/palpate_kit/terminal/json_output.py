"""Findings as JSON: one document on standard output, and everything else on standard error."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import typer
from palpate_engine import finite_tree

from palpate_kit.terminal.layout import layout


def print_json(findings: Any) -> None:
    """Print findings as JSON: numbers in SI, null for what is not finite; dataclasses as tables, paths as texts."""
    typer.echo(json_text(findings), nl=False)


def json_text(findings: Any) -> str:
    """Return findings as the text of a JSON file: numbers in SI, null for what is not finite."""
    return json.dumps(finite_tree(plain_data(findings)), indent=2, allow_nan=False) + "\n"


def plain_data(value: Any) -> Any:
    """Return findings as tables, lists, texts and numbers."""
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain_data(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain_data(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain_data(inner) for inner in value]
    return str(value) if isinstance(value, Path) else value


@contextlib.contextmanager
def print_aside(as_json: bool) -> Iterator[None]:
    """Send what is printed within it to standard error, where standard output is for JSON, CSV or LaTeX alone."""
    elsewhere = as_json or layout() != "table"
    with contextlib.redirect_stdout(sys.stderr) if elsewhere else contextlib.nullcontext():
        yield
