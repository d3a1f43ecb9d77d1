"""The facts of files that bring no pipeline: those of the command line on top of the file of facts next to them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from palpate import ConfigurationError
from palpate_engine import (
    RIG,
    RigFacts,
    bounded_text,
    facts_of,
    parsed_assignment,
    read_rig,
    rig_assignments,
    toml_tables,
    write_whole,
)

_RIG = ("run", "rig")


@dataclass(frozen=True)
class StatedFacts:
    """What is stated of files, and where."""

    facts: RigFacts
    path: Path  # of the file of facts, that there is or that answers are written to
    settings: tuple[str, ...] = ()  # ``--set`` that are not facts
    is_read: bool = False  # there is such a file
    is_named: bool = False  # by --rig, and not found next to the files
    answers: frozenset[str] = frozenset()  # keys of the facts that were asked
    of_options: frozenset[str] = frozenset()  # keys of the facts that the command line states

    @property
    def overrides(self) -> tuple[str, ...]:
        """The facts as ``--set`` of a pipeline that lacks them, then the other settings, which take precedence."""
        return (*rig_assignments(self.facts, self.path), *self.settings)

    def answered(self, **more: Any) -> StatedFacts:
        """With answers, which are to be kept; raises ConfigurationError."""
        return replace(self.with_facts(**more), answers=self.answers.union(more))

    def with_facts(self, **more: Any) -> StatedFacts:
        """With more facts; raises ConfigurationError."""
        table = self.facts.model_dump(exclude_defaults=True) | more
        return replace(self, facts=facts_of(table))


def stated_facts(sources: Sequence[Path], overrides: Iterable[str], **given: str | None) -> StatedFacts:
    """The facts next to files, with those among overrides and those `given` on top; raises ConfigurationError."""
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


def rig_beside(sources: Sequence[Path]) -> Path | None:
    """The file of facts next to files, where there is one; raises ConfigurationError for several."""
    there = [path for path in _places(sources) if path.is_file() and not _is_pipeline(path)]
    if len(there) > 1:
        raise ConfigurationError(f"{there[0]} and {there[1]}: which holds the facts? Name it with --rig FILE")
    return next(iter(there), None)


def keep_facts(folder: Path, path: Path) -> None:
    """Copy the file of facts, where there is one, into the folder of the fits that were made with it."""
    if path.is_file():
        write_whole(folder / RIG, bounded_text(path))


def _places(sources: Sequence[Path]) -> list[Path]:
    """Where files of facts of files would be."""
    return [folder / RIG for folder in dict.fromkeys(s if s.is_dir() else s.parent for s in sources)]


def _is_pipeline(path: Path) -> bool:
    """Whether a file that is called like one of facts is a pipeline; one with mistakes does not count yet."""
    with suppress(OSError, ValueError):
        return "device" in toml_tables(bounded_text(path))
    return False
