"""Settings of a pipeline from the facts of a rig: the one place where the first become the second."""

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
UNIT_ROUNDING = 1e-9  # relative; a conversion of units rounds by some 1e-16, nobody states ten digits: a choice
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
    """Set what the facts in a file, and those of the command line, state of a source; return True if there are any.

    `known` is the registry, which has the kinds of tips and models. Both facts are taken out of the source. What the
    command line states goes before the file of facts, which goes before what a pipeline leaves open; the uncertainty of
    another value does not stay. Raises ConfigurationError where the pipeline states another value than the file of
    facts.
    """
    if path is None and TABLE not in source.tables:
        return False
    stated = source.tables.pop(TABLE, {})
    if not isinstance(stated, dict):
        raise ConfigurationError(f"{source.where((TABLE,))}: is not a table of facts")
    # The command line first: nothing that follows replaces what it states.
    options = facts_of({key: value for key, value in stated.items() if source.is_stated((TABLE, key))})
    _apply_options(source, options, known)
    # Then the table [rig] of the pipeline and the file of facts, which may not contradict it.
    table_facts = facts_of({key: value for key, value in stated.items() if not source.is_stated((TABLE, key))})
    facts_by_file = [(table_facts, str(source.path))]
    if path is not None:
        source.tables["run"].pop("rig")
        file_facts = read_rig(path)
        facts_by_file.append((file_facts, str(path)))
        if file_facts.measured and "calibration" not in source.tables["run"]:
            source.state(("run", "calibration"), str(path.absolute()), str(path))
    for facts, file_name in facts_by_file:
        for key, location, value in _settings(facts, source.tables, known):
            if not source.is_stated(location):
                _demand_agreement(source, location, value, f"{file_name}: {key}")
                source.state(location, value, f"{file_name}: {key}")
    return True


def _apply_options(source: Source, options: RigFacts, registry: Registry) -> None:
    """Set what facts of the command line state, without the uncertainties of the values that they replace."""
    for key, location in _UNCERTAINTIES.items():
        if getattr(options, key) is not None and not source.is_stated(location):
            source.drop(location)
    for key, location, value in _settings(options, source.tables, registry):
        if not source.is_stated(location):
            source.state(location, value, f"{TABLE}.{key}")


def plain_facts(facts: RigFacts) -> dict[str, Any]:
    """Return the facts that are settings of a pipeline, as its table `rig`."""
    return facts.model_dump(exclude_defaults=True, exclude={*NO_SETTINGS})


def rig_assignments(facts: RigFacts, path: Path) -> list[str]:
    """Return the facts that are settings of a pipeline, and what a file of facts has measured, as
    ``table.key=value``."""
    assignments = [f"{TABLE}.{key}={json.dumps(value)}" for key, value in plain_facts(facts).items()]
    return assignments + ([f"run.calibration={json.dumps(str(path.absolute()))}"] if facts.measured else [])


def facts_set(
    facts: RigFacts, assignments: Iterable[str], tables: Mapping[str, Any], known: Registry
) -> frozenset[str]:
    """Return the keys of those facts of which ``table.key=value`` states the value, whatever its uncertainty."""
    places = [parsed_assignment(text)[0] for text in assignments]
    return frozenset(
        key
        for key, location, _ in _settings(facts, tables, known)
        if location not in _NO_VALUES and any(_contains(place, location) for place in places)
    )


def _contains(place: Location, other: Location) -> bool:
    """Return True if one of two places in a pipeline is the other, or a table around it."""
    length = min(len(place), len(other))
    return place[:length] == other[:length]


def facts_left_open(tables: Mapping[str, Any], facts: RigFacts, registry: Registry) -> list[str]:
    """Return those facts of a rig that a written pipeline lacks or only assumes, as ``rig.key=value``.

    `tables` are those of the pipeline, `registry` that of the parts it names. Raises ConfigurationError.
    """
    assumed = [str(pattern) for pattern in _tables(tables, "run").get("assumed", ())]
    # A fact may set several keys; it is open while one of them is. A beam also states what the position is of.
    locations_of_fact: dict[str, list[Location]] = {}
    for key, location, _ in _settings(facts, tables, registry):
        fact = "beam" if facts.beam is not None and key == "position" else key
        locations_of_fact.setdefault(fact, []).append(location)
    # A fact counts if a verdict may depend on it: those that state the fact of a condition.
    statable_facts = {*facts_stated().values()}
    assignments = []
    for fact, locations in locations_of_fact.items():
        if fact in statable_facts and any(_is_open(tables, location, assumed) for location in locations):
            assignments.append(f"{TABLE}.{fact}={json.dumps(getattr(facts, fact))}")
    return assignments


def _is_open(tables: Mapping[str, Any], location: Location, assumed: list[str]) -> bool:
    """Return True if a pipeline has no value at a location, switches it off, or only assumes it."""
    value: Any = tables
    for key in location:
        value = value.get(key) if isinstance(value, Mapping) else None
    return value is None or value is False or any(fnmatchcase(".".join(location), pattern) for pattern in assumed)


def _demand_agreement(source: Source, location: Location, value: Any, statement: str) -> None:
    """Raise ConfigurationError where a source states another value than a `statement`, which is named by file and key.

    A value that the source assumes is not a statement.
    """
    table: Any = source.tables
    assumed = _tables(source.tables, "run").get("assumed", ())
    if any(fnmatchcase(".".join(location), str(pattern)) for pattern in assumed):
        return
    for key in location:
        if not isinstance(table, dict) or key not in table:
            return
        table = table[key]
    if not _are_same(value, table):
        key, stated_text, text = ".".join(location), _setting_text(table), _setting_text(value)
        raise ConfigurationError(
            f"{statement} contradicts {source.where(location)}: {key} is {stated_text} there, {text} here; correct one "
            "of them"
        )


def _are_same(first: Any, second: Any) -> bool:
    """Return True if two settings are the same in other units; of tables, as far as both have a key."""
    if isinstance(first, dict) and isinstance(second, dict):
        return all(_are_same(first[key], second[key]) for key in first.keys() & second.keys())
    sizes = [_quantity(value) for value in (first, second)]
    if sizes[0] is None or sizes[1] is None:
        return bool(first == second)
    return math.isclose(*sizes, rel_tol=UNIT_ROUNDING)  # type: ignore[arg-type]


def _quantity(value: Any) -> float | None:
    """Return a quantity in SI, whatever its unit; None where a value is not one."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    match = _NUMBER.fullmatch(value) if isinstance(value, str) else None
    try:
        return None if match is None else float(match[1]) * (read_unit(match[2]).factor if match[2] else 1.0)
    except (ValueError, UnknownUnitError):
        return None


def _setting_text(value: Any) -> str:
    """Return a setting as a message shows it; of a table its type, then each key with its value."""
    if isinstance(value, dict):
        return " ".join(
            _setting_text(item) if key == "type" else f"{key} {_setting_text(item)}" for key, item in value.items()
        )
    return str(value)


def _settings(facts: RigFacts, tables: Mapping[str, Any], registry: Registry) -> Iterator[tuple[str, Location, Any]]:
    """Yield the settings that facts state, each as key of the facts, key of the pipeline and value."""
    models = {name: table for name, table in _tables(tables, "model").items() if isinstance(table, dict)}
    if facts.tip is not None:
        for location in _tips(models, registry):
            yield "tip", location, with_stated_law(facts.tip, _table_at(tables, location), registry)
    if facts.tip_uncertainty is not None:
        for key in _radius_keys(facts, models, tables, registry):
            yield "tip_uncertainty", ("run", "uncertainties", key), facts.tip_uncertainty
    yield from _layer(facts, models, registry)
    yield from _specimen(facts, models, registry)
    if facts.truth is not None:
        for name, value in truth_in_words(facts.truth).items():
            yield "truth", ("run", "truth", name), value
    yield from _alignment(facts, tables)


def _specimen(
    facts: RigFacts, models: Mapping[str, Mapping[str, Any]], registry: Registry
) -> Iterator[tuple[str, Location, Any]]:
    """Yield Poisson's ratio and the inclination of the skin, of every model that has such a key."""
    if facts.poisson is not None:
        value, std = value_and_std(facts.poisson, "1")
        for name in _with_key(models, "poisson", registry):
            yield "poisson", ("model", name, "poisson"), value
            yield "poisson", ("run", "uncertainties", "poisson"), std if std is not None else POISSON_STD
    if facts.inclination is not None:
        value, std = value_and_std(facts.inclination, "rad")
        for name in _with_key(models, "skin", registry):
            yield "inclination", ("model", name, "skin", "inclination"), value
        if std is not None:
            yield "inclination", ("run", "uncertainties", "inclination"), std


def _layer(
    facts: RigFacts, models: Mapping[str, Mapping[str, Any]], registry: Registry
) -> Iterator[tuple[str, Location, Any]]:
    """Yield height and base of the specimen, of every model that has a layer or may get one; one that it has keeps its
    law.

    Raises ConfigurationError for a base without a stated thickness.
    """
    value, std = facts.thickness, None  # as they are written, with their units
    if value not in (None, HALF_SPACE):
        value, std = value_and_std(value, "m")
    # The laws are read before the first setting is made, for that changes the tables; None of a model without a layer.
    layers = {name: models[name].get("thickness") for name in _with_key(models, "thickness", registry)}
    laws = {name: layer.get("law") if isinstance(layer, dict) else None for name, layer in layers.items()}
    with_layer = {name for name, layer in layers.items() if isinstance(layer, dict)}
    for name, law in laws.items():
        has_layer = name in with_layer
        if facts.base is not None and (value == HALF_SPACE or (value is None and not has_layer)):
            raise ConfigurationError('base: only a specimen of a stated thickness has one (thickness = "22 mm")')
        if value is not None:
            yield _height(facts, name, value, has_layer)
        if facts.base is not None and has_layer:
            yield "base", ("model", name, "thickness", "bonded"), facts.base != SLIDING
            if facts.base == SLIDING and law == LAW:
                yield "base", ("model", name, "thickness", "law"), SLIDING_LAW
    if std is not None:
        yield "thickness", ("run", "uncertainties", "height"), std


def _height(facts: RigFacts, model: str, height: Any, has_layer: bool) -> tuple[str, Location, Any]:
    """Return the setting of a specimen's height in a model: of its layer, of a new one, or of a half-space."""
    location = ("model", model, "thickness")
    if height == HALF_SPACE:
        return "thickness", location, height
    if has_layer:
        return "thickness", (*location, "height"), height
    base = {} if facts.base is None else {"bonded": facts.base != SLIDING}
    law = SLIDING_LAW if facts.base == SLIDING else LAW
    return "thickness", location, {"law": law, "height": height, **base}


def _alignment(facts: RigFacts, tables: Mapping[str, Any]) -> Iterator[tuple[str, Location, Any]]:
    """Yield delay, tare, mass, stiffness of the mount and beam; raises ConfigurationError for a beam that cannot be."""
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
    yield from _beam(facts, tables)


def _beam(facts: RigFacts, tables: Mapping[str, Any]) -> Iterator[tuple[str, Location, Any]]:
    """Yield the beam between stage and tip, and whether the position is measured at one of them.

    Raises ConfigurationError for a beam behind a position that is of the tip, and for a stage without one.
    """
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
    """Return the tables of a kind by name; none where the file has something else in their place."""
    tables_of_kind = tables.get(kind, {})
    return tables_of_kind if isinstance(tables_of_kind, dict) else {}


def _tips(models: Mapping[str, Mapping[str, Any]], registry: Registry) -> Iterator[Location]:
    """Yield the location of the tip of each model, each location once."""
    locations: dict[Location, None] = {}
    for name in _with_key(models, "indenter", registry):
        tip = models[name].get("indenter")
        locations[("indenter", tip) if isinstance(tip, str) else ("model", name, "indenter")] = None
    yield from locations


def _radius_keys(
    facts: RigFacts, models: Mapping[str, Mapping[str, Any]], tables: Mapping[str, Any], registry: Registry
) -> list[str]:
    """Return the keys that the tips have for their radius, each once; `radius` where no tip has one."""
    types = [str(_table_at(tables, location).get("type")) for location in _tips(models, registry)]
    if facts.tip is not None:
        types = [tip_table(facts.tip, registry, "tip")["type"]]
    entries = [entry for name in types if (entry := registry.parts["indenter"].get(name)) is not None]
    keys = [key for entry in entries for key in _RADII if entry.problem is None and key in entry.part.model_fields]
    return list(dict.fromkeys(keys)) or [_RADII[0]]


def _table_at(tables: Mapping[str, Any], location: Location) -> Mapping[str, Any]:
    """Return the table at a place; an empty one where none is."""
    table: Any = tables
    for key in location:
        table = table.get(key) if isinstance(table, Mapping) else None
    return table if isinstance(table, Mapping) else {}


def _with_key(models: Mapping[str, Mapping[str, Any]], key: str, registry: Registry) -> list[str]:
    """Return the models that have a key."""
    entries = {name: registry.parts["model"].get(str(table.get("type"))) for name, table in models.items()}
    return [
        name
        for name, entry in entries.items()
        if entry is not None and entry.problem is None and key in entry.part.model_fields
    ]
