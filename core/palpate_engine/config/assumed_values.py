"""The values of tip, model and alignment that a pipeline takes as known, and which of them are only assumed."""

from __future__ import annotations

from collections.abc import Iterable
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from palpate.parts import numbers_of
from palpate.units import display_unit

if TYPE_CHECKING:
    from palpate.parts import Settings

    from palpate_engine.config.pipeline import Pipeline


def values_on_trust(pipeline: Pipeline) -> dict[str, str]:
    """Return the values taken as known, by key, in display units: the tips, numbers of the models, delays, mass and
    tare."""
    values: dict[str, str] = {}
    # Tips: their type as well as their numbers, for the type is a law of contact.
    for name, tip in pipeline.indenters.items():
        values[f"indenter.{name}.type"] = pipeline.registry.name_of(type(tip))
        values |= _numbers(tip, f"indenter.{name}")
    for name, model in pipeline.models.items():
        values |= _numbers(model, f"model.{name}", inner=False)
    # Of the alignment only what no record shows.
    prefixes = ("delay", "uncertainty", "tip_mass", "tare", "series_stiffness")
    alignment_values = _numbers(pipeline.alignment, "alignment")
    values |= {key: text for key, text in alignment_values.items() if key.rpartition(".")[2].startswith(prefixes)}
    if isinstance(pipeline.alignment.tare, str):
        values["alignment.tare"] = pipeline.alignment.tare
    return values


def _numbers(settings: Settings, head: str, inner: bool = True) -> dict[str, str]:
    """Return the numbers of settings in display units, by key below `head`; without `inner` those of parts in them are
    left out."""
    texts: dict[str, str] = {}
    for path, value, unit in numbers_of(settings):
        if inner or len(path) == 1:
            texts[".".join((head, *path))] = _quantity_text(value, unit)
    return texts


def _quantity_text(value: float, unit: str) -> str:
    """Return a value [unit] in its display unit, to six digits."""
    symbol, factor = display_unit(unit)
    return f"{value * factor:.6g}" + ("" if unit == "1" else f" {symbol}")


def assumed_keys(patterns: Iterable[str], pipeline: Pipeline, stated: Iterable[str]) -> tuple[str, ...]:
    """Return the keys that patterns name, less those that the command line has stated; what names nothing stays as
    it is."""
    values = values_on_trust(pipeline)
    # A dictionary keeps the order of the patterns, and each key once.
    keys: dict[str, None] = {}
    for pattern in patterns:
        matching = [key for key in values if fnmatchcase(key, pattern)]
        if not matching and "*" not in pattern:
            matching = [pattern]
        keys |= dict.fromkeys(matching)
    stated_keys = set(stated)
    return tuple(key for key in keys if not _is_at_or_below(key, stated_keys))


def _is_at_or_below(key: str, heads: Iterable[str]) -> bool:
    """Return True if a key is one of some others, or stands in a table that they name."""
    return any(key == head or key.startswith(f"{head}.") for head in heads)
