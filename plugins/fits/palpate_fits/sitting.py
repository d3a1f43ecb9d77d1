"""All questions about files and their rig in one go, and the answers in the file of facts."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import typer
from palpate import ConfigurationError, OutputError, PalpateError, printable
from palpate_engine import TrackResult, approved_plugins, facts_stated, question_of
from palpate_kit.curves.curve_fits import CurveReader, curve_outcome, record_tracks
from palpate_kit.curves.file_facts import FileFacts
from palpate_kit.curves.open_facts import WITHOUT_A_FIT, OpenFact, open_facts
from palpate_kit.curves.stated_facts import StatedFacts
from palpate_kit.runs.rig_file import write_rig

from palpate_fits.file_pipelines import DEVICE, FileGroup
from palpate_fits.file_questions import FileQuestion

# Choices.
_MAX_QUESTIONS = 6  # about the rig
_TRIALS = 3  # curves that are fitted for the size of the effects
_ATTEMPTS = 3  # answers to one question
Ask = Callable[[str], str]


def is_asking() -> bool:
    """Return True if a person can answer."""
    return sys.stdin.isatty() and sys.stderr.isatty()


def prompt(text: str) -> str:
    """Return the answer to a question on the terminal; raises ConfigurationError without an answer."""
    try:
        answer = typer.prompt(printable(text), default="", show_default=False, prompt_suffix=" ", err=True)
    except (EOFError, typer.Abort) as error:
        raise ConfigurationError("the questions were not answered, and nothing was fitted") from error
    return str(answer).strip()


def ask_fact(stated: StatedFacts, key: str, effect: str, ask: Ask) -> StatedFacts:
    """Return a fact asked until the answer is one; an empty one leaves it open."""
    question, example = question_of(key)
    return _asked(stated, f'{question} As in "{example}" [Enter: {effect}]', lambda answer: {key: answer}, ask)


def _asked(
    stated: StatedFacts, text: str, facts_of: Callable[[str], dict[str, Any]], ask: Ask, guess: str = ""
) -> StatedFacts:
    """Return the stated facts with those of an answer, asked until it is one; an empty one is the guess, or none."""
    for _ in range(_ATTEMPTS):
        if not (answer := ask(text) or guess):
            break
        try:
            return stated.answered(**facts_of(answer))
        except ConfigurationError as error:
            typer.echo(str(error), err=True)
    return stated


def ask_of_files(stated: StatedFacts, questions: Mapping[str, FileQuestion], ask: Ask) -> StatedFacts:
    """Return the facts with the answers of a person to questions on files, each put once for all files that have it.

    Questions that a file cannot be read without come first, then those of the most files.
    """
    file_names: dict[FileQuestion, list[str]] = {}
    for file, question in questions.items():
        file_names.setdefault(question, []).append(Path(file).name)
    answered: set[tuple[str, str]] = set()
    for question, names in sorted(file_names.items(), key=lambda item: (not item[0].needed, -len(item[1]))):
        # Two dialects may ask of one column with different guesses; the facts have one answer for both.
        if (question.key, question.name) in answered:
            continue
        answered.add((question.key, question.name))
        more_files = f" and {len(names) - 1} more" if len(names) > 1 else ""
        without_answer = "not known"
        if question.needed:
            without_answer = "they are not read" if more_files else "it is not read"
        default = question.guess or without_answer
        text = f"{names[0]}{more_files}: {question.text}. Which is it? [Enter: {default}]"
        stated = _asked(stated, text, partial(_answered, stated, question), ask, question.guess)
    return stated


def _answered(stated: StatedFacts, question: FileQuestion, answer: str) -> dict[str, Any]:
    """Return the facts of an answer; raises ConfigurationError where it is not one of the choices."""
    if question.choices and answer not in question.choices:
        raise ConfigurationError(f"{answer}: is not one of {', '.join(question.choices)}")
    if question.key == "columns":
        columns = dict(stated.facts.columns or {})
        return {"columns": {**columns, question.name: (*columns.get(question.name, ()), answer)}}
    if question.key == "units":
        return {"units": {**(stated.facts.units or {}), question.name: answer}}
    return {question.key: answer}


def ask_of_rig(facts: FileFacts, groups: Sequence[FileGroup], ask: Ask) -> StatedFacts:
    """Return the facts with the answers of a person to at most six open ones, the most effective first.

    A fact that was asked and not answered counts as not known. One that ``curves.csv`` states of every curve is not
    open.
    """
    stated = facts.stated
    # Keys that are open for one curve at least.
    curve_facts = [facts.of(curve.name) for group in groups for curve in group.curves]
    open_keys = [key for key in facts_stated().values() if any(_is_open(item, key) for item in curve_facts)]
    if not open_keys:
        return stated
    questions = [fact for fact in _open_facts(facts, groups) if fact.key in open_keys][:_MAX_QUESTIONS]
    for fact in questions:
        stated = ask_fact(stated, fact.key, f"not known; {fact.effect}", ask)
    unanswered = [fact.key for fact in questions if getattr(stated.facts, fact.key) is None]
    return stated.answered(not_known=(*stated.facts.not_known, *unanswered)) if unanswered else stated


def _is_open(stated: StatedFacts, key: str) -> bool:
    """Return True if nobody has stated a fact, or that it is not known."""
    return getattr(stated.facts, key) is None and key not in stated.facts.not_known


def _open_facts(facts: FileFacts, groups: Sequence[FileGroup]) -> Iterable[OpenFact]:
    """Return the open facts of the first curves that can be fitted; without any, those that a contact needs.

    Three curves of the groups of files that are read alike are fitted for it.
    """
    tracks: list[TrackResult] = []
    curves = [(group, curve) for group in groups for curve in group.curves[:_TRIALS]][:_TRIALS]
    for group, curve in curves:
        reader = CurveReader(
            text=group.text,
            path=str(group.path),
            overrides=facts.stated.overrides,
            device=DEVICE,
            approved=approved_plugins(),
        )
        try:
            assignments = tuple(facts.of(curve.name).listed_assignments)
            outcome = curve_outcome(record_tracks(reader, assignments), DEVICE, curve)
        except PalpateError:
            continue
        track = next(iter(outcome.result.tracks.values()))
        tracks += [track] if track.usable else []
    return open_facts(tracks) if tracks else WITHOUT_A_FIT


def keep_answers(stated: StatedFacts) -> None:
    """Write the answers into the file of facts, a new one with the facts of the command line; and report it."""
    keys = stated.answers | (frozenset() if stated.is_read else stated.of_options)
    if not stated.answers:
        return
    facts = stated.facts.model_dump(include={*keys}, exclude_defaults=True)
    try:
        write_rig(stated.path, {key: _plain(value) for key, value in facts.items()})
        typer.echo(f"the answers are kept in {stated.path}", err=True)
    except (OutputError, ConfigurationError) as error:
        typer.echo(f"the answers are not kept: {error}", err=True)


def _plain(value: Any) -> Any:
    """Return a value as TOML holds it; a list of one is the one, within a table."""
    if isinstance(value, dict):
        return {
            key: item[0] if isinstance(item, tuple) and len(item) == 1 else _plain(item) for key, item in value.items()
        }
    return list(value) if isinstance(value, tuple) else value
