"""Facts of a rig and its specimens, as ``rig.toml``, the command line and Python state them."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from palpate.errors import ConfigurationError, suggest
from palpate.input_file import bounded_text
from palpate.key_mistakes import Location, mistakes_of
from palpate.parts import Settings
from palpate.units import to_si
from pydantic import BeforeValidator, Field, ValidationError
from pydantic_core import PydanticCustomError

from palpate_engine.config.pipeline_source import Source
from palpate_engine.config.stated_truth import truth_in_words

RIG = "rig.toml"
MEASURED, MEASUREMENT = "measured", "measurement"  # tables that `palpate calibrate` writes
# Keys that are not settings of every pipeline: the first concern the reading and asking of files alone.
NO_SETTINGS = ("instrument", "columns", "units", "rate", "not_known", "model", MEASURED, MEASUREMENT)
_PLUS_MINUS = re.compile(r"\s*(?:\+-|\+/-|±)\s*")
ROLES = ("force", "position", "velocity", "time")


def value_and_std(text: object, unit: str) -> tuple[object, str | None]:
    """Return a quantity and its standard uncertainty as they are written, None without one; a share becomes one [unit].

    Raises ValueError for an unknown fact.

    >>> value_and_std("0 ms +- 0.2 ms", "s")
    ('0 ms', '0.2 ms')
    >>> value_and_std("400 N/m +- 5 %", "N/m")
    ('400 N/m', '20 N/m')
    """
    value: object = text
    stds: list[str] = []
    if isinstance(text, str):
        value, *stds = _PLUS_MINUS.split(text)
    # Both sides of "+-"; a share of the value becomes an uncertainty in its unit.
    if len(stds) > 1:
        raise ValueError(f"{text!r} has more than one uncertainty")
    if isinstance(value, str) and unit == "1":
        value = to_si(value, unit)
    size = to_si(value, unit)
    # Twelve digits, more than anybody states, so that the text has the share to its rounding.
    if stds and unit != "1" and stds[0].endswith("%"):
        stds = [f"{to_si(stds[0], '1') * abs(size):.12g} {unit}"]
    if stds and to_si(stds[0], unit) < 0:
        raise ValueError(f"{text!r}: an uncertainty is not negative")
    return value, stds[0] if stds else None


@dataclass(frozen=True)
class _Quantity:
    """Validator of a quantity in words, with its standard uncertainty, or of one of some words."""

    unit: str
    words: tuple[str, ...] = ()
    needs_std: bool = False
    minimum: float | None = None  # [unit], itself excluded

    def __call__(self, text: object) -> object:
        """Return the text of a fact, checked as a quantity or as one of its words; raises PydanticCustomError."""
        if isinstance(text, str) and " ".join(text.split()[:1]) in {word.split()[0] for word in self.words}:
            return self._of_words(" ".join(text.split()))
        try:
            value, std = value_and_std(text, self.unit)
            if self.needs_std and std is None:
                raise ValueError(f'{text!r}: how certain is that? Write its standard uncertainty, as "{text} +- ..."')
            if self.minimum is not None and not to_si(value, self.unit) > self.minimum:
                raise ValueError(f"{text!r} must be above {self.minimum:g}")
        except ValueError as error:
            allowed = f" (or {', '.join(map(repr, self.words))})" if self.words else ""
            raise PydanticCustomError("quantity", "{reason}", {"reason": f"{error}{allowed}"}) from error
        return text

    def _of_words(self, text: str) -> str:
        """Return a text that is one of the fact's words, or free air with its duration; raises PydanticCustomError."""
        if text in self.words:
            return text
        try:
            if not text.startswith(FREE_AIR) or to_si(text.removeprefix(FREE_AIR).strip(), "s") <= 0:
                raise ValueError(f"{text!r} is not one of {', '.join(map(repr, self.words))}")
        except ValueError as error:
            raise PydanticCustomError("quantity", "{reason}", {"reason": str(error)}) from error
        return text


def _truth_text(text: object) -> object:
    """Return the same where it is a sentence of true values; raises the error of validation."""
    try:
        truth_in_words(text)
    except ValueError as error:
        raise PydanticCustomError("quantity", "{reason}", {"reason": str(error)}) from error
    return text


HALF_SPACE, FREE_AIR, ZEROED, NO_BEAM = "half-space", "free-air", "zeroed before contact", "none"
_TARES = (FREE_AIR, ZEROED, "none", "calibrated")


def _columns(value: object) -> object:
    """Return the columns of each role as a tuple, of which a file has one; raises ValueError for an unknown role."""
    if not isinstance(value, dict):
        return value
    if wrong := next((role for role in value if role not in ROLES), None):
        raise ValueError(f"no role {wrong!r}{suggest(wrong, ROLES)} (there are: {', '.join(ROLES)})")
    return {role: tuple(names) if isinstance(names, list | tuple) else (names,) for role, names in value.items()}


_Length = Annotated[Any, BeforeValidator(_Quantity("m", minimum=0.0))]


def _fact(description: str, fact: str = "", question: str = "", example: str = "", **more: str) -> Any:
    """Return a field: its documentation, the fact that it states, what is asked for it, and an answer as an example."""
    extra = {"fact": fact, "question": question, "example": example, **more}
    return Field(default=None, description=description, json_schema_extra={k: v for k, v in extra.items() if v})


class RigFacts(Settings):
    """Facts of a rig and its specimens that a person states; what is left out is not known."""

    tip: str | None = _fact(
        'the tip: "sphere 3 mm" (a ball, its radius), "sphere diameter 6 mm", "flat 2 mm", "cone 45 deg"',
        question="Which tip, a sphere by its radius?", example="sphere 3 mm",
    )  # fmt: skip
    tip_uncertainty: _Length | None = _fact('standard uncertainty of the tip\'s radius, as in "20 um"')
    model: str | None = _fact("the contact model, by name or initials")
    thickness: Annotated[Any, BeforeValidator(_Quantity("m", (HALF_SPACE,), minimum=0.0))] | None = _fact(
        'height of the specimen on its base, as in "22 mm", or "half-space"',
        "thickness", "How thick is the specimen?", "22 mm",
    )  # fmt: skip
    base: Literal["bonded", "sliding"] | None = _fact(
        '"bonded": a specimen of a stated thickness is glued to its base; "sliding": it may slide (spheres)',
        "base", "Is the specimen glued to its base, or may it slide?", "bonded",
    )  # fmt: skip
    delay: Annotated[Any, BeforeValidator(_Quantity("s", needs_std=True))] | None = _fact(
        'how late the force is behind the position, as in "0 ms +- 1 ms"',
        "delay", "How late is the force behind the position?", "0 ms +- 1 ms",
    )  # fmt: skip
    tare: Annotated[Any, BeforeValidator(_Quantity("N", _TARES, True))] | None = _fact(
        '"free-air": the record begins in air, which is the zero, "free-air 0.25 s": so long; '
        '"zeroed before contact"; "none"; "calibrated"; or the reading without contact, as in "1.8 N +- 10 mN"',
        "tare", "Where is the zero of the force?", ZEROED,
    )  # fmt: skip
    tip_mass: Annotated[Any, BeforeValidator(_Quantity("kg"))] | None = _fact(
        'mass behind the force sensor, as in "140 g +- 2 g", or "0 g"',
        "mass", "What mass hangs behind the force sensor?", "0 g",
    )  # fmt: skip
    poisson: Annotated[Any, BeforeValidator(_Quantity("1"))] | None = _fact(
        'Poisson\'s ratio of the specimen, as in 0.5 or "0.45 +- 0.01"',
        "poisson", "Which Poisson's ratio has the specimen?", "0.5",
    )  # fmt: skip
    inclination: Annotated[Any, BeforeValidator(_Quantity("rad"))] | None = _fact(
        'of the skin under the tip, as in "0 deg"', "level", "How inclined is the skin?", "0 deg"
    )
    mount: Annotated[Any, BeforeValidator(_Quantity("N/m", minimum=0.0))] | None = _fact(
        'stiffness of robot and sensor, which yield before the specimen, as in "200 N/mm"',
        "mount", "How stiff are robot and sensor?", "200 N/mm",
    )  # fmt: skip
    position: Literal["tip", "stage"] | None = _fact(
        '"tip": the position is measured, and that of the tip; "stage": that of what moves a beam with the tip on it',
        "position", "Is the position measured at the tip, or at a stage behind a beam?", "tip", option="position-of",
    )  # fmt: skip
    beam: Annotated[Any, BeforeValidator(_Quantity("N/m", (NO_BEAM,), minimum=0.0))] | None = _fact(
        'stiffness of the beam or spring between stage and tip, as in "400 N/m +- 5 %", or "none"; of a file with a '
        "column of its deflection found there",
        "beam", "How stiff is the beam between stage and tip, and how certain is that?", "400 N/m +- 5 %",
    )  # fmt: skip
    truth: Annotated[str | None, BeforeValidator(_truth_text)] = _fact(
        'true values of the specimen, with which results are compared: "elasticity 112.5 kPa, viscosity 362 Pa*s"; no '
        "estimator reads them"
    )
    instrument: str | None = _fact('what presses and measures, in words of a methods section: "a UR3e with a SensONE"')
    columns: Annotated[dict[str, tuple[str | int, ...]], BeforeValidator(_columns)] | None = _fact(
        "of files without a pipeline, the columns that cannot be recognised: "
        '{ force = "Load", position = ["Ext", "z"], time = "t" }; a file takes the first that it has'
    )
    units: dict[str, str] | None = _fact("of files without a pipeline, units that are not stated, by column")
    rate: str | float | None = _fact('of files without a time, as in "500 Hz"')
    not_known: tuple[str, ...] = Field(default=(), description="keys that were asked and not answered")
    measured: dict[str, Any] = Field(default={}, description="what `palpate calibrate` has measured, by name")
    measurement: dict[str, Any] = Field(default={}, description="when, with which devices and by which record")

    @property
    def position_of(self) -> str | None:
        """Return the body whose position is read; a beam is behind a tip only where it is that of a stage."""
        return position_of(self.position, self.beam)


def position_of(position: str | None, beam: object) -> str | None:
    """Return "tip" or "stage", by what is stated of a position and of a beam; None where neither is stated."""
    return position or (None if beam is None else "tip" if beam == NO_BEAM else "stage")


@cache
def facts_stated() -> Mapping[str, str]:
    """Return the key that states each fact of a condition."""
    fields = RigFacts.model_fields
    return {fact: name for name in fields if (fact := _extra(name).get("fact"))}


def _extra(name: str) -> Mapping[str, str]:
    extra: Any = RigFacts.model_fields[name].json_schema_extra
    return extra if isinstance(extra, dict) else {}


def question_of(name: str) -> tuple[str, str]:
    """Return the question for a key, and an answer as an example."""
    return _extra(name).get("question", ""), _extra(name).get("example", "")


def option_of(name: str) -> str:
    """Return the option of a key."""
    return f"--{_extra(name).get('option', name.replace('_', '-'))}"


def words_that_state(fact: str) -> str:
    """Return the option that states a fact of a condition, or a key of files; its value is the user's."""
    return f"{option_of(facts_stated().get(fact, fact))} VALUE"


UNIT_OF = "unit of the "  # before the role of a column, as a fact
# What settles a fact that no option states.
_SETTLED_BY = {"noise": "record 0.2 s at rest in air first", "frequency": "palpate init chirp"}


def remedy_of(fact: str) -> str:
    """Return what settles a fact of a condition, the same for a run and for a row of fits; empty for any other."""
    if fact in facts_stated() or fact == "rate":
        return words_that_state(fact)
    if fact.startswith(UNIT_OF):
        return f'units = {{ COLUMN = "VALUE" }} in {RIG} next to the files'
    return _SETTLED_BY.get(fact, "")


def read_rig(path: Path) -> RigFacts:
    """Return the facts in a file; raises ConfigurationError with every mistake at once."""
    try:
        source = Source(bounded_text(path), path)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise ConfigurationError(f"{path}: cannot read the facts of the rig: {reason}") from error
    if "device" in source.tables:
        raise ConfigurationError(f"{path}: is a pipeline, and no file of facts of a rig; name that with --rig FILE")
    return _validated(source.tables, source.where)


def facts_of(table: Mapping[str, Any]) -> RigFacts:
    """Return the facts that options or Python state; raises ConfigurationError with every mistake at once."""
    return _validated(table, lambda place: option_of(place[0]) if place[0] in RigFacts.model_fields else "rig")


def _validated(table: Mapping[str, Any], where: Callable[[Location], str]) -> RigFacts:
    """Return the facts of a table; raises ConfigurationError with a line for each mistake and its place."""
    try:
        return RigFacts.model_validate(dict(table))
    except ValidationError as error:
        unknown = [key for key in table if key not in RigFacts.model_fields]
        lines = [f"{where((key,))}: unknown key {key!r}{suggest(key, RigFacts.model_fields)}" for key in unknown]
        for mistake in mistakes_of(error, RigFacts, ()):
            if mistake.location:
                place = where(mistake.location)
                key = "" if place.startswith("--") else f"{'.'.join(mistake.location)}: "
                lines.append(f"{place}: {key}{mistake.problem}")
        raise ConfigurationError("\n".join(dict.fromkeys(lines))) from error
