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

_RIG_KEYS = ("run", "rig")  # of ``--set``: the path of the file of facts
_STAGE_FACTS = {"position", "beam"}  # stated together: a beam is between a stage and the tip


@dataclass(frozen=True)
class StatedFacts:
    """The facts that are stated of files, or of one curve, with the places that state them."""

    facts: RigFacts
    path: Path  # of the file of facts, which may not exist yet: answers are written to it
    settings: tuple[str, ...] = ()  # ``--set`` that are not facts
    is_read: bool = False  # True if the file of facts exists
    is_named: bool = False  # True if --rig names it, False if it lies next to the files
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
        unlisted_keys = RigFacts.model_fields.keys() - self.of_curve_list
        return rig_assignments(self.without(unlisted_keys).facts, self.path)

    @property
    def origins(self) -> list[str]:
        """The files that state facts of a curve, as in "rig.toml states tip"."""
        other_keys = self.facts.model_fields_set - self.of_curve_list
        rig_keys = [key for key in other_keys if getattr(self.facts, key) is not None]
        keys_by_file = {str(self.path): sorted(rig_keys), LIST: sorted(self.of_curve_list)}
        return [f"{file} states {', '.join(keys)}" for file, keys in keys_by_file.items() if keys]

    def of_curve(self, cells: Mapping[str, str]) -> StatedFacts:
        """Return the facts of one curve: its cells of ``curves.csv`` override ``rig.toml``, options override both.

        Raises LogError for a cell that does not state its fact.
        """
        listed = stated_in(self.without_options(cells))
        if not listed:
            return self
        try:
            return replace(self.with_facts(**listed), of_curve_list=frozenset(listed))
        except ConfigurationError as error:
            message = str(error)
            for name, key in FACTS.items():  # the cell is a column, and not an option
                message = message.replace(f"{option_of(key)}:", f"{name}:")
            raise LogError(f"{LIST}: {message}") from error

    def without_options(self, cells: Mapping[str, str], tables: Mapping[str, Any] | None = None) -> dict[str, str]:
        """Return the cells of a curve without the facts that options state.

        With `tables` of a pipeline, also without those that ``--set`` of one of their keys states.
        """
        option_keys = set(self.of_options)
        if tables is not None and self.settings and (listed := stated_in(cells)):
            option_keys |= facts_set(facts_of(listed), self.settings, tables, registry.load())
        if option_keys & _STAGE_FACTS:
            option_keys |= _STAGE_FACTS
        return {name: cell for name, cell in cells.items() if FACTS.get(name) not in option_keys}

    def without(self, keys: Iterable[str]) -> StatedFacts:
        """Return the statements without some facts."""
        table = self.facts.model_dump(exclude_defaults=True, exclude={*keys})
        return replace(self, facts=facts_of(table), of_curve_list=self.of_curve_list.difference(keys))

    def answered(self, **more: Any) -> StatedFacts:
        """Return the statements with answers, which will be written to the file of facts; raises ConfigurationError."""
        return replace(self.with_facts(**more), answers=self.answers.union(more))

    def with_facts(self, **more: Any) -> StatedFacts:
        """Return the statements with more facts; raises ConfigurationError."""
        table = self.facts.model_dump(exclude_defaults=True) | more
        return replace(self, facts=facts_of(table))


def stated_facts(sources: Sequence[Path], overrides: Iterable[str], **given: str | None) -> StatedFacts:
    """Return the facts of the file next to the sources, overridden by ``--set`` and by the `given` options.

    Facts are those of the rig, such as tip, rate and units. `overrides` are assignments of ``--set``; those that are
    not facts are kept as settings. Raises ConfigurationError.
    """
    # Assignments are the path of the file of facts, single facts, or other settings.
    option_facts: dict[str, Any] = {key: text for key, text in given.items() if text is not None}
    settings: list[str] = []
    named_path: Path | None = None
    for text in overrides:
        keys, value = parsed_assignment(text)
        if keys == _RIG_KEYS:
            named_path = Path(str(value))
        elif keys[0] == "rig":
            option_facts[".".join(keys[1:])] = value
        else:
            settings.append(text)
    options = facts_of(option_facts)  # a mistake in an option is reported before one in the file
    path = named_path or rig_beside(sources)
    stated = StatedFacts(
        facts=RigFacts() if path is None else read_rig(path),
        path=_rig_paths(sources)[0] if path is None else path,
        settings=tuple(settings),
        is_read=path is not None,
        is_named=named_path is not None,
        of_options=frozenset(option_facts),
    )
    return stated.with_facts(**options.model_dump(exclude_defaults=True)) if option_facts else stated


def suggestion_by_facts(file: Path, facts: RigFacts, choices: Mapping[str, str], registry: Registry) -> Suggestion:
    """Return how a file is read by the facts of its curve and by `choices`, which override them.

    Facts and choices are texts by key, such as "rate" or the role "force". Where the roles of columns are not certain,
    the facts name columns for them; of several names the first that the file has. Raises LogError, ConfigurationError.
    """
    # Facts as choices of the reader; columns are tried below.
    rig_choices = {TIP: facts.tip, "rate": facts.rate, POSITION_OF: facts.position_of}
    stated = {key: str(value) for key, value in rig_choices.items() if value is not None}
    stated |= {f"{UNITS}{name}": unit for name, unit in (facts.units or {}).items()}
    all_choices = {**stated, **choices}
    column_names = {role: names for role, names in (facts.columns or {}).items() if role not in choices}
    suggestion: Suggestion | None = None
    try:
        suggestion = suggestion_of(file, all_choices, registry)
    except LogError:
        if not column_names:
            raise
    else:
        column_names = {role: names for role, names in column_names.items() if role in suggestion.rivals}
    if suggestion is not None and not column_names:
        return suggestion
    # Of each role the first column that the file has.
    for role, names in column_names.items():
        for name in map(str, names):
            with suppress(LogError):
                suggestion_of(file, {**all_choices, role: name}, registry)
                all_choices[role] = name
                break
    return suggestion_of(file, all_choices, registry)


def rig_beside(sources: Sequence[Path]) -> Path | None:
    """Return the file of facts next to the sources; None without one. Raises ConfigurationError for several."""
    paths = [path for path in _rig_paths(sources) if path.is_file() and not _is_pipeline(path)]
    if len(paths) > 1:
        raise ConfigurationError(f"{paths[0]} and {paths[1]}: which holds the facts? Name it with --rig FILE")
    return next(iter(paths), None)


def keep_facts(folder: Path, stated: StatedFacts) -> None:
    """Copy the file of facts into the folder of the fits, without those that options state otherwise."""
    if not stated.path.is_file():
        return
    write_whole(folder / RIG, bounded_text(stated.path))
    file_facts = read_rig(stated.path)
    contradicted_facts = {
        key: None
        for key in stated.of_options & {*facts_stated().values()}
        if getattr(file_facts, key) not in (None, getattr(stated.facts, key))
    }
    if contradicted_facts:
        write_rig(folder / RIG, contradicted_facts)


def _rig_paths(sources: Sequence[Path]) -> list[Path]:
    """Return the paths that files of facts next to the sources would have."""
    folders = dict.fromkeys(source if source.is_dir() else source.parent for source in sources)
    return [folder / RIG for folder in folders]


def _is_pipeline(path: Path) -> bool:
    """Return True if a file that is called like one of facts is a pipeline: it has devices, and no mistakes."""
    with suppress(OSError, ValueError):
        return "device" in toml_tables(bounded_text(path))
    return False
