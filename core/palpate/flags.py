"""Flags: failed assumptions, each as a short code and a sentence; what a code means is registered once."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

Severity = Literal["note", "doubtful", "invalid"]
Verdict = Literal["good", "note", "doubtful", "invalid"]
NOT_DETERMINED, NEEDS = "not determined", "needs "  # further words of a value; "needs delay"

SEVERITIES: dict[Severity, str] = {
    "invalid": "the track's numbers must not be used",
    "doubtful": "its uncertainty may not hold",
    "note": "for information",
}
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)  # from the best to the worst
ADVICE: dict[str, str] = {  # a verdict in words, and what a person is to do with a track of that verdict
    "good": "good: trust it",
    "note": "good: trust it",
    "doubtful": "doubtful: look at it",
    "invalid": "invalid: do not use it",
}


def is_open(verdict: str) -> bool:
    """Return True for a value that is not determined, or needs a fact: its word is shown next to its number."""
    return verdict == NOT_DETERMINED or needs_fact(verdict)


def needs_fact(verdict: str) -> bool:
    """Return True for a value that depends on a fact which nobody has stated, so that it enters no mean.

    A value that is not determined enters: it is within its uncertainty of none, and a mean without it is biased.
    """
    return verdict.startswith(NEEDS)


def verdict_rank(verdict: str) -> int:
    """The order of verdicts from good to invalid; a word that gives no number comes just before the last."""
    return {"good": 0, "note": 0, "doubtful": 1, "invalid": 3}.get(verdict, 2)


def advice_on(verdict: str) -> str:
    """A verdict in words: of what gives a number with what to do, else why it has none."""
    return ADVICE.get(verdict, verdict)


def verdict_word(verdict: str) -> str:
    """The word of a verdict for a reader: a note moves no value beyond its uncertainty, so that the track is good."""
    return "good" if verdict == "note" else verdict


@dataclass(frozen=True)
class Flag:
    """A failed assumption: a code for programs and a sentence for readers.

    `effects` is by how much what the flag names can move each value [SI], by name of the value; a name that is missing
    is not moved, infinity stands for no bound, and None for an effect that is not known.
    """

    code: str  # of lower-case words with hyphens; registered by `palpate_flags`
    message: str
    severity: Severity | None = field(default=None, compare=False)  # from the registry, once a result is made
    effects: Mapping[str, float] | None = field(default=None, compare=False)
    # Rows of the budget that hold the effects; None: that of the diagnosis, (): none of them.
    causes: tuple[str, ...] | None = field(default=None, compare=False)
    evidence: tuple[Flag, ...] = field(default=(), compare=False)  # other signs of the same cause
    remedy: str = field(default="", compare=False)  # from the registry

    def __str__(self) -> str:
        return f"{self.code}: {self.message}"

    def table(self) -> dict[str, Any]:
        """As in ``result.json``."""
        table: dict[str, Any] = {"code": self.code, "message": self.message, "severity": self.severity}
        if self.remedy:
            table["remedy"] = self.remedy
        if self.effects is not None:
            table["effects"] = {name: size if math.isfinite(size) else None for name, size in self.effects.items()}
        if self.evidence:
            table["evidence"] = [{"code": sign.code, "message": sign.message} for sign in self.evidence]
        return table

    @classmethod
    def of_table(cls, table: Mapping[str, Any]) -> Flag:
        """The flag of a table as `table` makes it."""
        effects = table.get("effects")
        if effects is not None:
            effects = {name: math.inf if size is None else size for name, size in effects.items()}
        evidence = tuple(cls(sign["code"], sign["message"]) for sign in table.get("evidence", ()))
        remedy = table.get("remedy", "")
        return cls(table["code"], table["message"], table["severity"], effects, (), evidence, remedy)


@dataclass(frozen=True)
class FlagMeaning:
    """What a flag's code means, the same wherever it is raised; `SEVERITIES` says what each severity is.

    A code that is `evidence_of` another is not a flag of its own, but a sign of what the other one names.
    """

    severity: Severity
    meaning: str  # one sentence
    remedy: str  # what to do, one sentence
    voids: bool = False  # a value that it can move by any amount (infinity) is void
    evidence_of: str = ""

    @classmethod
    def sign(cls, of: str, meaning: str) -> FlagMeaning:
        """The meaning of a sign `of` a flag, whose severity and remedy apply."""
        return cls("note", meaning, "", evidence_of=of)


UNREGISTERED = FlagMeaning("doubtful", "A flag that no plugin has registered.", "Ask the authors of the plugin.")


def judged_flags(flags: Iterable[Flag], meanings: Mapping[str, FlagMeaning]) -> tuple[Flag, ...]:
    """Flags with severity and remedy, one for each cause: those that are evidence of another stand under that one.

    Where the other one was not raised itself, its evidence raises it. Its effects are the largest of all that are
    known, and not known where none is.
    """
    causes: dict[tuple[str, int | None], list[Flag]] = {}
    for place, flag in enumerate(flags):
        meaning = meanings.get(flag.code, UNREGISTERED)
        is_note = meaning.severity == "note" and not meaning.evidence_of  # which is not a doubt, and stands by itself
        head = meaning.evidence_of if meaning.evidence_of in meanings else flag.code
        causes.setdefault((head, place if is_note else None), []).append(flag)
    return tuple(_one(code, signs, meanings) for (code, _), signs in causes.items())


def _one(code: str, signs: list[Flag], meanings: Mapping[str, FlagMeaning]) -> Flag:
    """The flag of one cause, with its evidence."""
    meaning = meanings.get(code, UNREGISTERED)
    own = [sign for sign in signs if sign.code == code]
    known = [sign.effects for sign in signs if sign.effects is not None]
    names = dict.fromkeys(name for effects in known for name in effects)
    effects = {name: max(e.get(name, 0.0) for e in known) for name in names} if known else None
    message = "; ".join(dict.fromkeys(sign.message for sign in own or signs))
    evidence = (*(sign for sign in signs if sign.code != code), *(e for sign in own for e in sign.evidence))
    causes = tuple(dict.fromkeys(cause for sign in signs for cause in sign.causes or ()))
    return replace(
        signs[0], code=code, message=message, severity=meaning.severity, effects=effects, causes=causes,
        evidence=evidence, remedy=meaning.remedy,
    )  # fmt: skip


def verdict(flags: Iterable[Flag]) -> Verdict:
    """The worst severity among judged flags; ``good`` without any, ``doubtful`` for an unregistered one."""
    return VERDICTS[max((VERDICTS.index(flag.severity or "doubtful") for flag in flags), default=0)]
