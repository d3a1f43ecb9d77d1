"""Tips in words, such as "sphere 3 mm", as a command line and Python take them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from palpate.contact import Indenter
from palpate.errors import ConfigurationError, suggest
from palpate.registry import Registry
from palpate.units import to_si

_COMMA = re.compile(r",(?=\s|$)")  # between two keys; one within a number stays


def tip_table(text: str, known: Registry, said: str = "tip") -> dict[str, Any]:
    """Return the table of a tip such as "sphere 3 mm", "sphere diameter 6 mm" or "blunt-cone 30 deg, tip_radius 1 mm".

    A sphere in words is the tip that states this word of itself, a ball. A value without a key is that of the first key
    that the tip needs, the radius of a sphere; messages call the whole `said`. Raises ConfigurationError.
    """
    table = tip_values(text, known, said)
    name, values = table["type"], {key: value for key, value in table.items() if key != "type"}
    try:
        known.find("indenter", name)(**values)
    except ConfigurationError as error:
        raise ConfigurationError(f"{said} {text!r}: {error}") from error
    return table


def tip_values(text: str, known: Registry, said: str = "tip") -> dict[str, Any]:
    """Return the table of a tip as `tip_table` reads it, its values not yet checked; raises ConfigurationError."""
    name, *words = _COMMA.sub(" ", text).split() or [""]
    tips = known.parts["indenter"]
    kind = kind_in_words(name, known)
    if kind not in tips:
        hint = '; write it as in "sphere 3 mm"' if not name[:1].isalpha() else suggest(name, list(tips))
        raise ConfigurationError(f"{said} {text!r}: no tip {name!r}{hint}")
    fields = known.find("indenter", kind).model_fields
    keys = [*fields, "diameter"] if "radius" in fields else list(fields)
    needed = [key for key, about in fields.items() if about.is_required()]
    table: dict[str, list[str]] = {}
    if words and words[0] not in keys:
        if words[0][:1].isalpha() or not needed:
            wrong = f"has no {words[0]!r}{suggest(words[0], keys)}" if words[0][:1].isalpha() else "needs a key each"
            raise ConfigurationError(f"{said} {text!r}: {name} {wrong} (keys: {', '.join(keys)})")
        words = [needed[0], *words]
    for word in words:
        if word in table:
            raise ConfigurationError(f"{said} {text!r}: {word} is stated twice")
        if word in keys:
            table[word] = []
        else:
            table[list(table)[-1]].append(word)
    values: dict[str, Any] = {key: " ".join(value) for key, value in table.items()}
    if {"radius", "diameter"} <= values.keys():
        raise ConfigurationError(f"{said} {text!r}: both radius and diameter are stated")
    if "diameter" in values:
        try:
            values["radius"] = 0.5 * to_si(values.pop("diameter"), "m")
        except ValueError as error:
            raise ConfigurationError(f"{said} {text!r}: diameter: {error}") from error
    if missing := [key for key in needed if not values.get(key)]:
        example = ", ".join([f"{name} VALUE", *(f"{key} VALUE" for key in needed[1:])])
        raise ConfigurationError(f'{said} {text!r}: {name} needs its {missing[0]}, as in "{example}"')
    return {"type": kind, **values}


def kind_in_words(word: str, known: Registry) -> str:
    """Return the type of a tip by the word that it states of itself, else the word as the name of its type."""
    tips = known.parts["indenter"].items()
    return next(
        (kind for kind, entry in tips if entry.problem is None and getattr(entry.part, "word", "") == word), word
    )


def with_stated_law(text: str, stated: Mapping[str, Any], known: Registry, said: str = "tip") -> dict[str, Any]:
    """Return the table of a tip in words; a sphere has the law of a ball that a `stated` table of a tip has chosen.

    Raises ConfigurationError.
    """
    table = tip_table(text, known, said)
    name = text.split()[0]
    if kind_in_words(name, known) == name or not is_ball(stated, known):
        return table
    return {**stated, "radius": table["radius"]}


def is_same_tip(one: Mapping[str, Any], other: Mapping[str, Any], known: Registry) -> bool:
    """Return True if two tables, in SI, are of one tip; balls of one radius are, by whatever law."""
    sizes = [{key: value for key, value in table.items() if key != "type"} for table in (one, other)]
    return one == other or (sizes[0] == sizes[1] and is_ball(one, known) and is_ball(other, known))


def is_ball(table: Mapping[str, Any], known: Registry) -> bool:
    """Return True if the table of a tip names one of the laws of a sphere, its paraboloid included."""
    entry = known.parts["indenter"].get(str(table.get("type")))
    if entry is None or entry.problem is not None or "radius" not in entry.part.model_fields:
        return False
    return getattr(entry.part, "sphere_radius", None) is not Indenter.sphere_radius
