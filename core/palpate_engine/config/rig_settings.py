"""The one place where the facts of a rig become settings of a pipeline."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from palpate.errors import ConfigurationError
from palpate.key_mistakes import Location
from palpate.registry import Registry
from palpate.unit_symbols import UnknownUnitError, read_unit

from palpate_engine.config.declared_uncertainties import POISSON_STD
from palpate_engine.config.pipeline_source import Source, parsed_assignment
from palpate_engine.config.rig_facts import (
    FREE_AIR,
    HALF_SPACE,
    NO_BEAM,
    NO_SETTINGS,
    ZEROED,
    RigFacts,
    facts_of,
    facts_stated,
    read_rig,
    value_and_std,
)
from palpate_engine.config.stated_truth import truth_in_words
from palpate_engine.config.tip_words import tip_table, with_stated_law

TABLE = "rig"  # of a source: facts of the command line, as in ``--set rig.thickness="22 mm"``
_NUMBER = re.compile(r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(.*)")
_ALIGNMENT = ("alignment",)
_RADII = ("radius", "curvature_radius")  # keys of a tip for its radius
LAW = "garcia"  # of a layer glued to its base, for spheres, flats and cones
SLIDING, SLIDING_LAW = "sliding", "dimitriadis"  # of one that slides, for spheres
# Where the uncertainty of a fact stands that may be stated without one.
_UNCERTAINTIES = {
    "thickness": ("run", "uncertainties", "height"),
    "inclination": ("run", "uncertainties", "inclination"),
    "tare": (*_ALIGNMENT, "tare_uncertainty"),
    "tip_mass": (*_ALIGNMENT, "tip_mass_uncertainty"),
    "beam": (*_ALIGNMENT, "beam_uncertainty"),
}
_NO_VALUES = (
    *_UNCERTAINTIES.values(), ("run", "uncertainties", "poisson"), (*_ALIGNMENT, "force", "uncertainty"),
    (*_ALIGNMENT, "tare_duration"),
)  # fmt: skip


def apply_rig(source: Source, path: Path | None, known: Registry) -> bool:
    """Set what the facts in a file, and those of the command line, state of a source, and take both out of it.

    Whether there were any.

    What the command line states goes before the file of facts, which goes before what a pipeline leaves open; the
    uncertainty of another value does not stay. Raises ConfigurationError where the pipeline states another value than
    the file of facts.
    """
    if path is None and TABLE not in source.tables:
        return False
    stated = source.tables.pop(TABLE, {})
    if not isinstance(stated, dict):
        raise ConfigurationError(f"{source.where((TABLE,))}: is not a table of facts")
    options = facts_of({key: value for key, value in stated.items() if source.is_stated((TABLE, key))})
    own = facts_of({key: value for key, value in stated.items() if not source.is_stated((TABLE, key))})
    for key, at in _UNCERTAINTIES.items():
        if getattr(options, key) is not None and not source.is_stated(at):
            source.drop(at)
    for key, at, value in _settings(options, source.tables, known):
        if not source.is_stated(at):
            source.state(at, value, f"{TABLE}.{key}")
    of_files = [(own, str(source.path))]
    if path is not None:
        source.tables["run"].pop("rig")
        of_files.append((facts := read_rig(path), str(path)))
        if facts.measured and "calibration" not in source.tables["run"]:
            source.state(("run", "calibration"), str(path.absolute()), str(path))
    for facts, name in of_files:
        for key, at, value in _settings(facts, source.tables, known):
            if not source.is_stated(at):
                _agree(source, at, value, f"{name}: {key}")
                source.state(at, value, f"{name}: {key}")
    return True


def plain_facts(facts: RigFacts) -> dict[str, Any]:
    """Return the facts that are settings of a pipeline, as its table `rig`."""
    return facts.model_dump(exclude_defaults=True, exclude={*NO_SETTINGS})


def rig_assignments(facts: RigFacts, path: Path) -> list[str]:
    """Return the facts that are settings of a pipeline, and what a file of facts has measured, as
    ``table.key=value``."""
    found = [f"{TABLE}.{key}={json.dumps(value)}" for key, value in plain_facts(facts).items()]
    return found + ([f"run.calibration={json.dumps(str(path.absolute()))}"] if facts.measured else [])


def facts_set(
    facts: RigFacts, assignments: Iterable[str], tables: Mapping[str, Any], known: Registry
) -> frozenset[str]:
    """Return the keys of those facts of which ``table.key=value`` states the value, whatever its uncertainty."""
    places = [parsed_assignment(text)[0] for text in assignments]
    return frozenset(
        key
        for key, at, _ in _settings(facts, tables, known)
        if at not in _NO_VALUES and any(place[: len(at)] == at or at[: len(place)] == place for place in places)
    )


def facts_left_open(tables: Mapping[str, Any], facts: RigFacts, known: Registry) -> list[str]:
    """Those of the facts that a written pipeline leaves open, as ``table.key=value``; raises ConfigurationError.

    It leaves open what it has no value for, or one that it assumes.
    """
    assumed = [str(pattern) for pattern in _tables(tables, "run").get("assumed", ())]
    places: dict[str, list[Location]] = {}
    for key, at, _ in _settings(facts, tables, known):
        places.setdefault("beam" if facts.beam is not None and key == "position" else key, []).append(at)
    asked = {*facts_stated().values()}
    keys = [key for key, ats in places.items() if key in asked and any(_is_open(tables, at, assumed) for at in ats)]
    return [f"{TABLE}.{key}={json.dumps(getattr(facts, key))}" for key in keys]


def _is_open(tables: Mapping[str, Any], at: Location, assumed: list[str]) -> bool:
    value: Any = tables
    for key in at:
        value = value.get(key) if isinstance(value, Mapping) else None
    return value is None or value is False or any(fnmatchcase(".".join(at), pattern) for pattern in assumed)


def _agree(source: Source, at: Location, value: Any, by: str) -> None:
    """Raise ConfigurationError where a source states another value; one that it assumes is not a statement."""
    table: Any = source.tables
    assumed = _tables(source.tables, "run").get("assumed", ())
    if any(fnmatchcase(".".join(at), str(pattern)) for pattern in assumed):
        return
    for key in at:
        if not isinstance(table, dict) or key not in table:
            return
        table = table[key]
    if not _same(value, table):
        there, here = _word(table), _word(value)
        raise ConfigurationError(
            f"{by} contradicts {source.where(at)}: {'.'.join(at)} is {there} there, {here} here; correct one of them"
        )


def _same(one: Any, other: Any) -> bool:
    """Return True if two settings are the same in other units; of tables, as far as both have a key."""
    if isinstance(one, dict) and isinstance(other, dict):
        return all(_same(one[key], other[key]) for key in one.keys() & other.keys())
    sizes = [_size(value) for value in (one, other)]
    if sizes[0] is None or sizes[1] is None:
        return bool(one == other)
    return math.isclose(*sizes, rel_tol=1e-9)  # type: ignore[arg-type]


def _size(value: Any) -> float | None:
    """Return a quantity in SI, whatever its unit; None where a value is not one."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    match = _NUMBER.fullmatch(value) if isinstance(value, str) else None
    try:
        return None if match is None else float(match[1]) * (read_unit(match[2]).factor if match[2] else 1.0)
    except (ValueError, UnknownUnitError):
        return None


def _word(value: Any) -> str:
    if isinstance(value, dict):
        return " ".join(_word(item) if key == "type" else f"{key} {_word(item)}" for key, item in value.items())
    return str(value)


def _settings(facts: RigFacts, tables: Mapping[str, Any], known: Registry) -> Iterator[tuple[str, Location, Any]]:
    """Key of the facts, key of the pipeline, value."""
    models = {name: table for name, table in _tables(tables, "model").items() if isinstance(table, dict)}
    if facts.tip is not None:
        for at in _tips(models, known):
            yield "tip", at, with_stated_law(facts.tip, _at(tables, at), known)
    if facts.tip_uncertainty is not None:
        for key in _radius_keys(facts, models, tables, known):
            yield "tip_uncertainty", ("run", "uncertainties", key), facts.tip_uncertainty
    yield from _layer(facts, models, known)
    if facts.poisson is not None:
        value, std = value_and_std(facts.poisson, "1")
        for name in _with_key(models, "poisson", known):
            yield "poisson", ("model", name, "poisson"), value
            yield "poisson", ("run", "uncertainties", "poisson"), std if std is not None else POISSON_STD
    if facts.inclination is not None:
        value, std = value_and_std(facts.inclination, "rad")
        for name in _with_key(models, "skin", known):
            yield "inclination", ("model", name, "skin", "inclination"), value
        if std is not None:
            yield "inclination", ("run", "uncertainties", "inclination"), std
    for name, value in truth_in_words(facts.truth).items() if facts.truth is not None else ():
        yield "truth", ("run", "truth", name), value
    yield from _alignment(facts, tables)


def _layer(
    facts: RigFacts, models: Mapping[str, Mapping[str, Any]], known: Registry
) -> Iterator[tuple[str, Location, Any]]:
    """Height and base of the specimen; a model that has a layer keeps its law."""
    value, std = facts.thickness, None
    if value not in (None, HALF_SPACE):
        value, std = value_and_std(value, "m")
    # Before the first setting is made: it changes the tables.
    layers = {name: isinstance(models[name].get("thickness"), dict) for name in _with_key(models, "thickness", known)}
    laws = {name: models[name]["thickness"].get("law") for name, has_layer in layers.items() if has_layer}
    base = {} if facts.base is None else {"bonded": facts.base != SLIDING}
    for name, has_layer in layers.items():
        at = ("model", name, "thickness")
        if base and (value == HALF_SPACE or (value is None and not has_layer)):
            raise ConfigurationError('base: only a specimen of a stated thickness has one (thickness = "22 mm")')
        if value == HALF_SPACE:
            yield "thickness", at, value
        elif value is not None and not has_layer:
            law = SLIDING_LAW if facts.base == SLIDING else LAW
            yield "thickness", at, {"law": law, "height": value, **base}
        elif value is not None:
            yield "thickness", (*at, "height"), value
        if base and has_layer:
            yield "base", (*at, "bonded"), base["bonded"]
            if facts.base == SLIDING and laws[name] == LAW:
                yield "base", (*at, "law"), SLIDING_LAW
    if std is not None:
        yield "thickness", ("run", "uncertainties", "height"), std


def _alignment(facts: RigFacts, tables: Mapping[str, Any]) -> Iterator[tuple[str, Location, Any]]:
    if facts.delay is not None:
        value, std = value_and_std(facts.delay, "s")
        yield "delay", (*_ALIGNMENT, "force", "delay"), value
        yield "delay", (*_ALIGNMENT, "force", "uncertainty"), std
        for role in ("position", "velocity"):
            if role in _tables(tables, "alignment"):
                yield "delay", (*_ALIGNMENT, role, "delay"), "0 s"
    if facts.tare is not None:
        for name, text in _tare(facts.tare).items():
            yield "tare", (*_ALIGNMENT, name), text
    if facts.tip_mass is not None:
        value, std = value_and_std(facts.tip_mass, "kg")
        yield "tip_mass", (*_ALIGNMENT, "tip_mass"), value
        if std is not None:
            yield "tip_mass", (*_ALIGNMENT, "tip_mass_uncertainty"), std
    if facts.mount is not None:
        yield "mount", (*_ALIGNMENT, "series_stiffness"), value_and_std(facts.mount, "N/m")[0]
    if facts.beam == NO_BEAM:
        yield "beam", (*_ALIGNMENT, "beam"), None
    elif facts.beam is not None:
        if facts.position == "tip":
            raise ConfigurationError('beam: is between a stage and the tip, and position = "tip": correct one of them')
        value, std = value_and_std(facts.beam, "N/m")
        yield "beam", (*_ALIGNMENT, "beam"), value
        if std is not None:
            yield "beam", (*_ALIGNMENT, "beam_uncertainty"), std
    elif facts.position == "stage" and "beam" not in _tables(tables, "alignment"):
        raise ConfigurationError('position = "stage": how stiff is the beam or spring? State beam = "400 N/m" (--beam)')
    if facts.position_of is not None:
        yield "position", (*_ALIGNMENT, "position", "measured"), True


def _tare(text: Any) -> dict[str, Any]:
    """Return the keys of a tare in words."""
    if text == ZEROED:
        return {"tare": "0 N", "tare_uncertainty": "0 N"}
    if text in (FREE_AIR, "none", "calibrated"):
        return {"tare": text}
    if isinstance(text, str) and text.startswith(FREE_AIR):
        return {"tare": FREE_AIR, "tare_duration": text.removeprefix(FREE_AIR).strip()}
    value, std = value_and_std(text, "N")
    return {"tare": value, "tare_uncertainty": std}


def _tables(tables: Mapping[str, Any], kind: str) -> dict[str, Any]:
    found = tables.get(kind, {})
    return found if isinstance(found, dict) else {}


def _tips(models: Mapping[str, Mapping[str, Any]], known: Registry) -> Iterator[Location]:
    """Where the tips of the models stand, each once."""
    found: dict[Location, None] = {}
    for name in _with_key(models, "indenter", known):
        given = models[name].get("indenter")
        found[("indenter", given) if isinstance(given, str) else ("model", name, "indenter")] = None
    yield from found


def _radius_keys(
    facts: RigFacts, models: Mapping[str, Mapping[str, Any]], tables: Mapping[str, Any], known: Registry
) -> list[str]:
    """Return the keys that the tips have for their radius, each once; `radius` where no tip has one."""
    types = [str(_at(tables, at).get("type")) for at in _tips(models, known)]
    if facts.tip is not None:
        types = [tip_table(facts.tip, known, "tip")["type"]]
    entries = [entry for name in types if (entry := known.parts["indenter"].get(name)) is not None]
    keys = [key for entry in entries for key in _RADII if entry.problem is None and key in entry.part.model_fields]
    return list(dict.fromkeys(keys)) or [_RADII[0]]


def _at(tables: Mapping[str, Any], at: Location) -> Mapping[str, Any]:
    """Return the table at a place; an empty one where none is."""
    table: Any = tables
    for key in at:
        table = table.get(key) if isinstance(table, Mapping) else None
    return table if isinstance(table, Mapping) else {}


def _with_key(models: Mapping[str, Mapping[str, Any]], key: str, known: Registry) -> list[str]:
    """Return the models that have a key."""
    entries = {name: known.parts["model"].get(str(table.get("type"))) for name, table in models.items()}
    return [
        name
        for name, entry in entries.items()
        if entry is not None and entry.problem is None and key in entry.part.model_fields
    ]
