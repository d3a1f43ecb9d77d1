"""Rules by which a table is read: each looks at one thing, decides one, and states how sure it is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Generic, TypeVar

Evidence = TypeVar("Evidence")
Decision = TypeVar("Decision")


class Sureness(IntEnum):
    """The certainty of a rule's decision; of two rules that decide the same, the surer one counts."""

    GUESS = 1  # numbers look like it, or it stands where such a thing usually does
    WORD = 2  # a word of a name means it
    STATED = 3  # a whole name, a unit or a mark of the file states it
    CHOSEN = 4  # a person states it


@dataclass(frozen=True)
class Rule(Generic[Evidence, Decision]):
    """A rule; `decide` returns None if the rule does not apply."""

    decide: Callable[[Evidence], Decision]
    looks_at: str
    decides: str
    sureness: Sureness

    @property
    def name(self) -> str:
        """The name of its function."""
        return self.decide.__name__

    def __call__(self, evidence: Evidence) -> Decision:
        """Return the decision of the rule."""
        return self.decide(evidence)


def rule(
    looks_at: str, decides: str, sureness: Sureness
) -> Callable[[Callable[[Evidence], Decision]], Rule[Evidence, Decision]]:
    """Return the decorator that makes a function a rule."""

    def make(decide: Callable[[Evidence], Decision]) -> Rule[Evidence, Decision]:
        """Return the rule whose decision a function makes."""
        return Rule(decide, looks_at, decides, sureness)

    return make


def decision(rules: Sequence[Rule[Evidence, Decision | None]], evidence: Evidence) -> Decision | None:
    """Return the decision of the surest rule that applies, of equally sure ones the first; None if none applies."""
    for candidate in sorted(rules, key=lambda candidate: -candidate.sureness):
        if (verdict := candidate(evidence)) is not None:
            return verdict
    return None
