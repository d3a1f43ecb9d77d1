"""The form of the facts of a rig that are open: what it asks, and what is wrong with answers."""

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

_TRIALS = 3  # curves that are fitted for the size of the effects


async def open_facts_of(desk: Desk, fitted: Callable[[str], Awaitable[CurveAnswer]]) -> list[tuple[str, str]]:
    """Keys of the open facts of a curve that can be `fitted`, each with its effect, most effective first."""
    rows = sorted(desk.folder.rows, key=lambda row: not row.usable)
    for name in list(dict.fromkeys(row.curve for row in rows))[:_TRIALS]:
        with contextlib.suppress(UserError):
            answer = await fitted(name)
            if (found := answer.facts.get("open")) is not None:
                return [(key, effect) for key, effect in found]
    return [(fact.key, fact.effect) for fact in WITHOUT_A_FIT]


def facts_message(desk: Desk, asked_for: Iterable[tuple[str, str]], curve: str = "") -> dict[str, Any]:
    """The open facts of the rig, each with its question, an answer as an example, and what it does; those of a curve.

    The facts of a curve are those that its row of ``curves.csv`` states, with the filter words for that curve.
    """
    fields = [{"key": key, "effect": effect, **dict(zip(("question", "example"), question_of(key), strict=True))}
              for key, effect in asked_for]  # fmt: skip
    file = desk.path / RIG
    places = [str(file)] if file.is_file() else []
    settled = f"Every fact is stated in {', '.join([*places, LIST])} or the pipeline."
    cells = stated_in(desk.folder.entries.get(curve, {}))
    stated = [
        {"key": key, "value": value, "curve": where_curve(curve),
         **dict(zip(("question", "example"), question_of(key), strict=True))}
        for key, value in cells.items()
    ]  # fmt: skip
    return {"kind": "facts", "file": str(file), "fields": fields, "settled": settled, "curve": curve, "stated": stated}


def fact_mistakes(answers: Mapping[str, str]) -> dict[str, str]:
    """What is wrong with answers, by their keys."""
    found = {}
    for key, text in answers.items():
        try:
            facts_of({key: text})
        except ConfigurationError as error:
            found[key] = str(error).removeprefix(f"{option_of(key)}: ") if key in FACT_KEYS else str(error)
    return found
