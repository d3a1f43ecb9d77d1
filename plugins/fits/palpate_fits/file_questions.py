"""Questions on the reading of a file that only a person can answer: a column, a unit, a rate."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from palpate_kit.logs.suggestion import POSITION_OF
from palpate_records.recording import Suggestion

RATE = "rate"
MIN_ROWS = 50  # a choice: a shorter table without a time is one of results
_READER = "device.log."
_OPTIONS = ("force", "position", "time")
_SCALE = re.compile(r"columns\.(\w+)\.scale")
_UNIT = re.compile(r"columns\.(\w+)\.unit")


@dataclass(frozen=True)
class FileQuestion:
    """One thing that makes a file readable, or a guess of it certain."""

    key: str  # of the facts: "columns", "units" or "rate"
    name: str  # within it: a role, or a column
    text: str = field(compare=False)  # what is not known, of the first file
    advice: str = field(compare=False)  # with the option that states it
    needed: bool  # without an answer the file is not read
    choices: tuple[str, ...] = ()
    guess: str = ""  # what is taken without an answer


def question_of_file(suggestion: Suggestion, stated: Mapping[str, str]) -> FileQuestion | None:
    """Return the first question on a file that only a person can answer; None if nothing is missing.

    `suggestion` says how the file would be read. What is missing comes first, then columns of which each may be a role,
    then units that were guessed. Keys in `stated` are not asked for.
    """
    for text in suggestion.blanks:
        key, _, _ = text.partition(": ")
        if f"{_READER}{key}" not in stated:
            return _question_of_blank(suggestion, text)
    for role, columns in suggestion.rivals.items():
        text = suggestion.rival_words(role)
        advice = f"{text}; say which with --{role}"
        return FileQuestion(key="columns", name=role, text=text, advice=advice, needed=True, choices=columns)
    for key, text in suggestion.guesses.items():
        unit = _UNIT.fullmatch(key)
        if unit is not None and f"{_READER}{key}" not in stated:
            guess = str(suggestion.device["columns"][unit[1]]["unit"])
            column = _column(suggestion, unit[1])
            return FileQuestion(key="units", name=column, text=text, advice=text, needed=False, guess=guess)
    return None


def _question_of_blank(suggestion: Suggestion, text: str) -> FileQuestion:
    """Return the question on a key of the reader that a file leaves blank, by a text "key: problem".

    `suggestion` says how the file would be read, with the columns as they were recorded (`views`).
    """
    key, _, problem = text.partition(": ")
    if key == POSITION_OF:
        advice = f"{text}; say it with --{key}"
        choices = ("tip", "stage")
        return FileQuestion(key="position", name="", text=problem, advice=advice, needed=True, choices=choices)
    if key == RATE:  # not needed of a long table: E of an elastic press does not depend on it
        rows = max((len(times) for times, *_ in suggestion.views.values()), default=MIN_ROWS)
        advice = f"{text}; say it with --rate"
        return FileQuestion(key=RATE, name="", text=problem, advice=advice, needed=rows < MIN_ROWS)
    option = f"--{key}" if key in _OPTIONS else f"--set {_READER}{key}=NUMBER"
    advice = f"{text}; say it with {option}"
    if (scale := _SCALE.fullmatch(key)) is not None:
        column = _column(suggestion, scale[1])
        return FileQuestion(key="units", name=column, text=problem, advice=advice, needed=True)
    return FileQuestion(key=key, name="", text=problem, advice=advice, needed=True)


def _column(suggestion: Suggestion, role: str) -> str:
    """Return the column that a role is read from."""
    return str(suggestion.device["columns"][role]["column"])
