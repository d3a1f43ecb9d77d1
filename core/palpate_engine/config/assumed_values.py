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
    found: dict[str, str] = {}
    for name, tip in pipeline.indenters.items():
        found[f"indenter.{name}.type"] = pipeline.registry.name_of(type(tip))
        found |= _numbers(tip, f"indenter.{name}")
    for name, model in pipeline.models.items():
        found |= _numbers(model, f"model.{name}", inner=False)
    kept = ("delay", "uncertainty", "tip_mass", "tare", "series_stiffness")
    listed = _numbers(pipeline.alignment, "alignment")
    found |= {key: text for key, text in listed.items() if key.rpartition(".")[2].startswith(kept)}
    if isinstance(pipeline.alignment.tare, str):
        found["alignment.tare"] = pipeline.alignment.tare
    return found


def _numbers(settings: Settings, head: str, inner: bool = True) -> dict[str, str]:
    units = {path: (value, unit) for path, value, unit in numbers_of(settings) if inner or len(path) == 1}
    return {".".join((head, *path)): _shown(value, unit) for path, (value, unit) in units.items()}


def _shown(value: float, unit: str) -> str:
    word, factor = display_unit(unit)
    return f"{value * factor:.6g}" + ("" if unit == "1" else f" {word}")


def assumed_keys(patterns: Iterable[str], pipeline: Pipeline, stated: Iterable[str]) -> tuple[str, ...]:
    """Return the keys that patterns name, less those that the command line has stated; what names nothing stays as
    it is."""
    known, said = values_on_trust(pipeline), set(stated)
    keys: dict[str, None] = {}
    for pattern in patterns:
        matching = [key for key in known if fnmatchcase(key, pattern)]
        keys |= dict.fromkeys(matching or ([] if "*" in pattern else [pattern]))
    return tuple(key for key in keys if not any(key == one or key.startswith(f"{one}.") for one in said))
