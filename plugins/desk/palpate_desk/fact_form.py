"""The form of the open facts of a rig: its fields, and the mistakes in answers."""

from __future__ import annotations

import contextlib
from collections.abc import Awaitable, Callable, Iterable, Mapping
from typing import Any

from palpate import ConfigurationError, UserError
from palpate_engine import RIG, facts_of, option_of, question_of
from palpate_kit.curves.curve_list import LIST, stated_in
from palpate_kit.curves.open_facts import WITHOUT_A_FIT

from palpate_desk.action import where_curve
from palpate_desk.command_gate import FACT_KEYS
from palpate_desk.curve_answers import CurveAnswer
from palpate_desk.desk import Desk

_MAX_TRIALS = 3  # curves that are fitted for the size of the effects: a choice, each takes time


async def open_facts_of(desk: Desk, fitted: Callable[[str], Awaitable[CurveAnswer]]) -> list[tuple[str, str]]:
    """Return the keys of the open facts of a curve, each with its effect, the largest first; `fitted` fits a curve.

    The curve is the first of a few, usable ones first, that can be fitted; without one, facts and effects are general.
    """
    rows = sorted(desk.folder.rows, key=lambda row: not row.usable)
    names = list(dict.fromkeys(row.curve for row in rows))
    for name in names[:_MAX_TRIALS]:
        with contextlib.suppress(UserError):
            answer = await fitted(name)
            open_facts = answer.facts.get("open")
            if open_facts is not None:
                return [(key, effect) for key, effect in open_facts]
    return [(fact.key, fact.effect) for fact in WITHOUT_A_FIT]


def facts_message(desk: Desk, open_facts: Iterable[tuple[str, str]], curve: str = "") -> dict[str, Any]:
    """Return the message of the form: the open facts (key and effect), and those that ``curves.csv`` states of a curve.

    A field has its key, a question, an example of an answer, and the effect; a stated fact its value, and the filter
    words of the curve.
    """
    fields = [{"key": key, "effect": effect, **_question(key)} for key, effect in open_facts]
    stated = []
    for key, cell in stated_in(desk.folder.entries.get(curve, {})).items():
        stated.append({"key": key, "value": cell, "curve": where_curve(curve), **_question(key)})
    file = desk.path / RIG
    files = [str(file), LIST] if file.is_file() else [LIST]
    settled = f"Every fact is stated in {', '.join(files)} or the pipeline."
    return {"kind": "facts", "file": str(file), "fields": fields, "settled": settled, "curve": curve, "stated": stated}


def _question(key: str) -> dict[str, str]:
    """Return the question for a fact, and an example of an answer."""
    question, example = question_of(key)
    return {"question": question, "example": example}


def fact_mistakes(answers: Mapping[str, str]) -> dict[str, str]:
    """Return a message on each answer that does not state its fact, by its key."""
    mistakes = {}
    for key, text in answers.items():
        try:
            facts_of({key: text})
        except ConfigurationError as error:
            message = str(error)
            mistakes[key] = message.removeprefix(f"{option_of(key)}: ") if key in FACT_KEYS else message
    return mistakes
