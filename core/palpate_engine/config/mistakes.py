"""Mistakes in a pipeline file, all shown at once, in words."""

from __future__ import annotations

from collections.abc import Iterable

from palpate.errors import ConfigurationError
from palpate.hooks import KINDS
from palpate.key_mistakes import Location, Mistake

from palpate_engine.config.pipeline_source import Source


def raise_mistakes(mistakes: Iterable[Mistake], source: Source) -> None:
    """Raise ConfigurationError with every mistake, in the order of the file; do nothing without any."""
    ordered = sorted(dict.fromkeys(mistakes), key=lambda mistake: source.line(mistake.location))
    if not ordered:
        return
    lines = [f"{source.where(m.location)}: {_named(m.location)}{m.problem}" for m in ordered]
    if len(lines) > 1:
        lines = [f"{source.path}: {len(lines)} mistakes", *(f"  {line}" for line in lines)]
    error = ConfigurationError("\n".join(lines))
    error.by_table = {m.location[:2]: f"{_named(m.location)}{m.problem}" for m in reversed(ordered)}
    raise error


def _named(location: Location) -> str:
    """Return ``[model.dr] poisson: ``, or nothing for the file as a whole."""
    if not location:
        return ""
    depth = 2 if location[0] in KINDS else 1  # all others hold settings
    table, key = ".".join(location[:depth]), ".".join(location[depth:])
    return f"[{table}] {key}: " if key else f"[{table}]: "
