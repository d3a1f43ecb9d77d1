"""Tips in words, such as "sphere 3 mm", as a command line and Python take them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
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
    """Return the table of a tip as `tip_table` reads it, its values not yet checked.

    `known` is the registry of the kinds of tips, `said` the word for the text in a message. Raises ConfigurationError.
    """
    label = f"{said} {text!r}"
    name, *tokens = _COMMA.sub(" ", text).split() or [""]
    try:
        tip_type = known.named("indenter", kind_in_words(name, known))
    except ConfigurationError as error:
        hint = "" if name[:1].isalpha() else '; write it as in "sphere 3 mm"'
        raise ConfigurationError(f"{label}: {error}{hint}") from error
    fields = known.find("indenter", tip_type).model_fields
    keys = [*fields, "diameter"] if "radius" in fields else list(fields)
    required_keys = [key for key, field in fields.items() if field.is_required()]
    if tokens and tokens[0] not in keys:
        tokens = [_key_left_out(tokens[0], keys, required_keys, f"{label}: {name}"), *tokens]
    # A diameter has become a radius by now; what is missing still has no value.
    values = _values_by_key(tokens, keys, label)
    missing = [key for key in required_keys if not values.get(key)]
    if missing:
        example = ", ".join([f"{name} VALUE", *(f"{key} VALUE" for key in required_keys[1:])])
        raise ConfigurationError(f'{label}: {name} needs its {missing[0]}, as in "{example}"')
    return {"type": tip_type, **values}


def _key_left_out(value: str, keys: Sequence[str], required_keys: Sequence[str], label: str) -> str:
    """Return the key of a first value without one: the first key that the tip needs.

    Raises ConfigurationError for a word that is not a key, and for a tip that needs none.
    """
    if value[:1].isalpha():
        raise ConfigurationError(f"{label} has no {value!r}{suggest(value, keys)} (keys: {', '.join(keys)})")
    if not required_keys:
        raise ConfigurationError(f"{label} needs a key each (keys: {', '.join(keys)})")
    return required_keys[0]


def _values_by_key(tokens: Sequence[str], keys: Sequence[str], label: str) -> dict[str, Any]:
    """Return the values of words, of which the first is a key: each key with the words up to the next one.

    A diameter becomes a radius [m]. Raises ConfigurationError, which names the tip by its `label`.
    """
    words_of_key: dict[str, list[str]] = {}
    for token in tokens:
        if token in words_of_key:
            raise ConfigurationError(f"{label}: {token} is stated twice")
        if token in keys:
            words_of_key[token] = []
        else:
            words_of_key[list(words_of_key)[-1]].append(token)
    values: dict[str, Any] = {key: " ".join(of_key) for key, of_key in words_of_key.items()}
    if {"radius", "diameter"} <= values.keys():
        raise ConfigurationError(f"{label}: both radius and diameter are stated")
    if "diameter" in values:
        try:
            values["radius"] = 0.5 * to_si(values.pop("diameter"), "m")
        except ValueError as error:
            raise ConfigurationError(f"{label}: diameter: {error}") from error
    return values


def kind_in_words(word: str, registry: Registry) -> str:
    """Return the type of a tip by the word that it states of itself, else the word as the name of its type.

    The word of a third party's tip counts where no other tip has it as its word or its name.
    """
    tips = registry.parts["indenter"]
    kinds = [
        kind for kind, entry in tips.items() if entry.problem is None and getattr(entry.part, "word", "") == word != ""
    ]
    shipped = [kind for kind in kinds if tips[kind].plugin.own]
    if shipped:
        return shipped[0]
    return kinds[0] if len(kinds) == 1 and word not in tips else word


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
