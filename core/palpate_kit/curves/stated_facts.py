"""The facts of a curve in a file: of options, else of its row of ``curves.csv``, else of ``rig.toml`` next to it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from palpate import ConfigurationError, LogError
from palpate_engine import (
    RIG,
    Registry,
    RigFacts,
    bounded_text,
    facts_of,
    facts_set,
    facts_stated,
    option_of,
    parsed_assignment,
    read_rig,
    registry,
    rig_assignments,
    toml_tables,
    write_whole,
)
from palpate_records.recording import Suggestion

from palpate_kit.curves.curve_list import FACTS, LIST, stated_in
from palpate_kit.logs.draft_pipeline import suggestion_of
from palpate_kit.logs.suggestion import POSITION_OF, TIP, UNITS
from palpate_kit.runs.rig_file import write_rig

_RIG = ("run", "rig")
_STAGE = {"position", "beam"}  # one statement: a beam is between a stage and the tip


@dataclass(frozen=True)
class StatedFacts:
    """The facts that are stated of files, or of one curve, and where."""

    facts: RigFacts
    path: Path  # of the file of facts, that there is or that answers are written to
    settings: tuple[str, ...] = ()  # ``--set`` that are not facts
    is_read: bool = False  # there is such a file
    is_named: bool = False  # by --rig, and not found next to the files
    answers: frozenset[str] = frozenset()  # keys of the facts that were asked
    of_options: frozenset[str] = frozenset()  # keys of the facts that the command line states
    of_curve_list: frozenset[str] = frozenset()  # keys of the facts that the row of ``curves.csv`` states

    @property
    def overrides(self) -> tuple[str, ...]:
        """The facts as ``--set`` of a pipeline that lacks them, then the other settings, which take precedence."""
        return (*rig_assignments(self.facts, self.path), *self.settings)

    @property
    def listed_assignments(self) -> list[str]:
        """The facts that the row of ``curves.csv`` states, as ``--set``."""
        return rig_assignments(self.without(RigFacts.model_fields.keys() - self.of_curve_list).facts, self.path)

    @property
    def origins(self) -> list[str]:
        """Which file states which facts of a curve."""
        of_rig = [
            key for key in self.facts.model_fields_set - self.of_curve_list if getattr(self.facts, key) is not None
        ]
        by_file = {str(self.path): sorted(of_rig), LIST: sorted(self.of_curve_list)}
        return [f"{file} states {', '.join(keys)}" for file, keys in by_file.items() if keys]

    def of_curve(self, cells: Mapping[str, str]) -> StatedFacts:
        """Return the facts of one curve: its cells of ``curves.csv`` go before ``rig.toml``, options before both.

        Raises LogError for a cell that does not state its fact.
        """
        listed = stated_in(self.without_options(cells))
        if not listed:
            return self
        try:
            return replace(self.with_facts(**listed), of_curve_list=frozenset(listed))
        except ConfigurationError as error:
            words = str(error)
            for name, key in FACTS.items():
                words = words.replace(f"{option_of(key)}:", f"{name}:")
            raise LogError(f"{LIST}: {words}") from error

    def without_options(self, cells: Mapping[str, str], tables: Mapping[str, Any] | None = None) -> dict[str, str]:
        """Return the cells of a curve but for the facts that options state, by ``--set`` of the `tables` as well."""
        stated = set(self.of_options)
        if tables is not None and self.settings and (listed := stated_in(cells)):
            stated |= facts_set(facts_of(listed), self.settings, tables, registry.load())
        if stated & _STAGE:
            stated |= _STAGE
        return {name: cell for name, cell in cells.items() if FACTS.get(name) not in stated}

    def without(self, keys: Iterable[str]) -> StatedFacts:
        """Return what is stated but for some facts."""
        table = self.facts.model_dump(exclude_defaults=True, exclude={*keys})
        return replace(self, facts=facts_of(table), of_curve_list=self.of_curve_list.difference(keys))

    def answered(self, **more: Any) -> StatedFacts:
        """With answers, which are to be kept; raises ConfigurationError."""
        return replace(self.with_facts(**more), answers=self.answers.union(more))

    def with_facts(self, **more: Any) -> StatedFacts:
        """With more facts; raises ConfigurationError."""
        table = self.facts.model_dump(exclude_defaults=True) | more
        return replace(self, facts=facts_of(table))


def stated_facts(sources: Sequence[Path], overrides: Iterable[str], **given: str | None) -> StatedFacts:
    """Return the facts next to files, with those among overrides and those `given` on top; raises
    ConfigurationError."""
    table: dict[str, Any] = {key: text for key, text in given.items() if text is not None}
    settings: list[str] = []
    named: Path | None = None
    for text in overrides:
        keys, value = parsed_assignment(text)
        if keys == _RIG:
            named = Path(str(value))
        elif keys[0] == "rig":
            table[".".join(keys[1:])] = value
        else:
            settings.append(text)
    options = facts_of(table)
    there = named or rig_beside(sources)
    found, path = (read_rig(there), there) if there is not None else (RigFacts(), _places(sources)[0])
    stated = StatedFacts(
        found, path, tuple(settings), there is not None, named is not None, of_options=frozenset(table)
    )
    return stated.with_facts(**options.model_dump(exclude_defaults=True)) if table else stated


def suggestion_by_facts(file: Path, facts: RigFacts, choices: Mapping[str, str], known: Registry) -> Suggestion:
    """Return how a file is read by the facts of its curve and `choices`, which go before them.

    Of columns that cannot be recognised, the first that the file has. Raises LogError, ConfigurationError.
    """
    of_rig = {TIP: facts.tip, "rate": facts.rate, POSITION_OF: facts.position_of}
    stated = {key: str(value) for key, value in of_rig.items() if value is not None}
    stated |= {f"{UNITS}{name}": unit for name, unit in (facts.units or {}).items()}
    chosen = {**stated, **choices}
    named = {role: names for role, names in (facts.columns or {}).items() if role not in choices}
    suggestion: Suggestion | None = None
    try:
        suggestion = suggestion_of(file, chosen, known)
        named = {role: names for role, names in named.items() if role in suggestion.rivals}
    except LogError:
        if not named:
            raise
    for role, names in named.items():
        for name in names:
            with suppress(LogError):
                suggestion_of(file, {**chosen, role: str(name)}, known)
                chosen[role] = str(name)
                break
    return suggestion_of(file, chosen, known) if named or suggestion is None else suggestion


def rig_beside(sources: Sequence[Path]) -> Path | None:
    """Return the file of facts next to files, where there is one; raises ConfigurationError for several."""
    there = [path for path in _places(sources) if path.is_file() and not _is_pipeline(path)]
    if len(there) > 1:
        raise ConfigurationError(f"{there[0]} and {there[1]}: which holds the facts? Name it with --rig FILE")
    return next(iter(there), None)


def keep_facts(folder: Path, stated: StatedFacts) -> None:
    """Copy the file of facts, where there is one, into the folder of the fits, without what options state otherwise."""
    if not stated.path.is_file():
        return
    write_whole(folder / RIG, bounded_text(stated.path))
    kept = read_rig(stated.path)
    changed = {
        key: None
        for key in stated.of_options & {*facts_stated().values()}
        if getattr(kept, key) not in (None, getattr(stated.facts, key))
    }
    if changed:
        write_rig(folder / RIG, changed)


def _places(sources: Sequence[Path]) -> list[Path]:
    """Where files of facts of files would be."""
    return [folder / RIG for folder in dict.fromkeys(s if s.is_dir() else s.parent for s in sources)]


def _is_pipeline(path: Path) -> bool:
    """Return True if a file that is called like one of facts is a pipeline; one with mistakes does not count yet."""
    with suppress(OSError, ValueError):
        return "device" in toml_tables(bounded_text(path))
    return False
