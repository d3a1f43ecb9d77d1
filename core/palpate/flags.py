"""Flags: failed assumptions, each as a short code and a sentence; the meaning of a code is registered once."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

Severity = Literal["note", "doubtful", "invalid"]
Verdict = Literal["good", "note", "doubtful", "invalid"]
EFFECTS = "; can move "  # in a message, before the sizes of its effects
NOT_DETERMINED = "not determined"  # a further word of a value
NEEDS = "needs "  # before the fact that a value needs, as in "needs delay"

SEVERITIES: dict[Severity, str] = {
    "invalid": "the track's numbers must not be used",
    "doubtful": "its uncertainty may not hold",
    "note": "for information",
}
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)  # from the best to the worst


def is_open(verdict: str) -> bool:
    """Return True for a value that is not determined, or needs a fact: its word is shown next to its number."""
    return verdict == NOT_DETERMINED or needs_fact(verdict)


def needs_fact(verdict: str) -> bool:
    """Return True for a value that depends on a fact which nobody has stated, so that it enters no mean.

    A value that is not determined enters: it is within its uncertainty of none, and a mean without it is biased.
    """
    return verdict.startswith(NEEDS)


def verdict_rank(verdict: str) -> int:
    """Return the order of verdicts from good to invalid; a word without a number comes just before the last."""
    return {"good": 0, "note": 0, "doubtful": 1, "invalid": 3}.get(verdict, 2)


def verdict_word(verdict: str) -> str:
    """Return the word of a verdict for a reader: a note moves no value beyond its uncertainty, so the track is good."""
    return "good" if verdict == "note" else verdict


@dataclass(frozen=True)
class Flag:
    """A failed assumption: a code for programs and a sentence for readers.

    `effects` holds the possible shift of each value [SI], by name of the value; a missing name does not move, infinity
    stands for no bound, and None for unknown effects.
    """

    code: str  # of lower-case words with hyphens; registered by `palpate_flags`
    message: str
    severity: Severity | None = field(default=None, compare=False)  # from the registry, once a result is made
    effects: Mapping[str, float] | None = field(default=None, compare=False)
    # Rows of the budget that hold the effects; None: that of the diagnosis, (): none of them.
    causes: tuple[str, ...] | None = field(default=None, compare=False)
    evidence: tuple[Flag, ...] = field(default=(), compare=False)  # other signs of the same cause
    remedy: str = field(default="", compare=False)  # its own, else that of the registry
    suspects: tuple[str, ...] = field(default=(), compare=False)  # likely causes by name, the likeliest first
    moves: tuple[str, ...] = field(default=(), compare=False)  # values that it puts in doubt, once a result is judged

    @property
    def sentence(self) -> str:
        """The message without the sizes of the effects."""
        return self.message.partition(EFFECTS)[0]

    def __str__(self) -> str:
        return f"{self.code}: {self.message}"

    def table(self) -> dict[str, Any]:
        """Return the flag as in ``result.json``."""
        table: dict[str, Any] = {"code": self.code, "message": self.message, "severity": self.severity}
        if self.remedy:
            table["remedy"] = self.remedy
        if self.effects is not None:
            effects = dict[str, float | None]()
            for name, size in self.effects.items():
                effects[name] = size if math.isfinite(size) else None  # null in JSON
            table["effects"] = effects
        if self.suspects:
            table["suspects"] = [*self.suspects]
        if self.moves:
            table["moves"] = [*self.moves]
        if self.evidence:
            table["evidence"] = [{"code": sign.code, "message": sign.message} for sign in self.evidence]
        return table

    @classmethod
    def of_table(cls, table: Mapping[str, Any]) -> Flag:
        """Return the flag of a table made by `table`."""
        effects = None
        if table.get("effects") is not None:
            effects = dict[str, float]()
            for name, size in table["effects"].items():
                effects[name] = math.inf if size is None else size  # null stands for infinity
        evidence = tuple(cls(sign["code"], sign["message"]) for sign in table.get("evidence", ()))
        remedy = table.get("remedy", "")
        suspects, moves = tuple(table.get("suspects", ())), tuple(table.get("moves", ()))
        return cls(
            code=table["code"],
            message=table["message"],
            severity=table["severity"],
            effects=effects,
            causes=(),
            evidence=evidence,
            remedy=remedy,
            suspects=suspects,
            moves=moves,
        )


@dataclass(frozen=True)
class FlagMeaning:
    """The meaning of a flag's code, the same wherever it is raised; `SEVERITIES` explains each severity.

    A code that is `evidence_of` another is not a flag of its own, but a sign of the other one.
    """

    severity: Severity
    meaning: str  # one sentence
    remedy: str  # what to do, one sentence
    voids: bool = False  # a value that it can move by any amount (infinity) is void
    evidence_of: str = ""

    @classmethod
    def sign(cls, of: str, meaning: str) -> FlagMeaning:
        """Return the meaning of a sign `of` a flag, whose severity and remedy apply."""
        return cls("note", meaning, "", evidence_of=of)


UNREGISTERED = FlagMeaning("doubtful", "A flag that no plugin has registered.", "Ask the authors of the plugin.")


def judged_flags(flags: Iterable[Flag], meanings: Mapping[str, FlagMeaning]) -> tuple[Flag, ...]:
    """Return flags with severity and remedy, one for each cause: evidence of another flag stands under that one.

    Where the other one was not raised itself, its evidence raises it. Its effects are the largest of all that are
    known, and not known where none is.
    """
    causes: dict[tuple[str, int | None], list[Flag]] = {}
    # Signs by the flag that they are evidence of; a note is not a doubt, and stands by itself.
    for number, flag in enumerate(flags):
        meaning = meanings.get(flag.code, UNREGISTERED)
        is_note = meaning.severity == "note" and not meaning.evidence_of
        head = meaning.evidence_of if meaning.evidence_of in meanings else flag.code
        causes.setdefault((head, number if is_note else None), []).append(flag)
    return tuple(_flag_of_cause(code, signs, meanings) for (code, _), signs in causes.items())


def _flag_of_cause(code: str, signs: list[Flag], meanings: Mapping[str, FlagMeaning]) -> Flag:
    """Return the flag of one cause, with its evidence; `signs` are the flags that show the cause, at least one."""
    # Signs that raise the flag itself, and those of another code, which are evidence of it.
    meaning = meanings.get(code, UNREGISTERED)
    raised = [sign for sign in signs if sign.code == code]
    evidence = [sign for sign in signs if sign.code != code]
    for flag in raised:
        evidence += flag.evidence
    # In the words of the flag itself, where it was raised.
    message = "; ".join(dict.fromkeys(sign.message for sign in raised or signs))
    causes = tuple(dict.fromkeys(cause for sign in signs for cause in sign.causes or ()))
    remedy = next((sign.remedy for sign in raised or signs if sign.remedy), meaning.remedy)
    return replace(
        signs[0], code=code, message=message, severity=meaning.severity, effects=_largest_effects(signs), causes=causes,
        evidence=tuple(evidence), remedy=remedy,
        suspects=tuple(dict.fromkeys(name for sign in raised for name in sign.suspects)),
    )  # fmt: skip


def _largest_effects(signs: Iterable[Flag]) -> dict[str, float] | None:
    """Return the largest effect of any sign on each value; None where no sign has known effects."""
    stated = [sign.effects for sign in signs if sign.effects is not None]
    if not stated:
        return None
    names = dict.fromkeys(name for effects in stated for name in effects)
    return {name: max(effects.get(name, 0.0) for effects in stated) for name in names}


def verdict(flags: Iterable[Flag]) -> Verdict:
    """Return the worst severity among judged flags; ``good`` without any, ``doubtful`` for an unregistered one."""
    return VERDICTS[max((VERDICTS.index(flag.severity or "doubtful") for flag in flags), default=0)]
