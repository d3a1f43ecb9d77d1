"""Flags: failed assumptions, each as a short code and a sentence; what a code means is registered once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal, get_args

Severity = Literal["note", "doubtful", "invalid"]
Verdict = Literal["good", "note", "doubtful", "invalid"]

SEVERITIES: dict[Severity, str] = {
    "invalid": "the track's numbers must not be used",
    "doubtful": "its uncertainty may not hold",
    "note": "for information",
}
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)  # from the best to the worst
ADVICE: dict[Verdict, str] = {  # what a person is to do with a track of that verdict
    "good": "trust it",
    "note": "trust it",
    "doubtful": "look at it",
    "invalid": "do not use it",
}


@dataclass(frozen=True)
class Flag:
    """A failed assumption: a code for programs and a sentence for readers."""

    code: str  # of lower-case words with hyphens; registered by `palpate_flags`
    message: str
    severity: Severity | None = field(default=None, compare=False)  # from the registry, once a result is made

    def __str__(self) -> str:
        return f"{self.code}: {self.message}"

    def table(self) -> dict[str, str | None]:
        """As in ``result.json``."""
        return {"code": self.code, "message": self.message, "severity": self.severity}


@dataclass(frozen=True)
class FlagMeaning:
    """What a flag's code means, the same wherever it is raised; `SEVERITIES` says what each severity is."""

    severity: Severity
    meaning: str  # one sentence
    remedy: str  # what to do, one sentence


def verdict(flags: Iterable[Flag]) -> Verdict:
    """The worst severity among judged flags; ``good`` without any, ``doubtful`` for an unregistered one."""
    return VERDICTS[max((VERDICTS.index(flag.severity or "doubtful") for flag in flags), default=0)]
