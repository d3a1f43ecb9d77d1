"""Pipelines of files without one: each file shows how it is read, and files that are read alike share a pipeline."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import tomli_w
from palpate import ConfigurationError, UserError, to_si
from palpate_engine import Pipeline, Registry, RigFacts, Source, build_pipeline, registry, tip_table
from palpate_kit.curves.alike_logs import AlikeLogs, LogPart, alike_logs
from palpate_kit.curves.curve import Curve
from palpate_kit.curves.file_facts import FileFacts
from palpate_kit.curves.stated_facts import StatedFacts, suggestion_by_facts
from palpate_kit.jobs.portions import KILLED, in_portions
from palpate_kit.jobs.process_pool import core_count
from palpate_kit.logs.draft_pipeline import rate_note
from palpate_kit.terminal.progress import report_progress
from palpate_records.recording import Suggestion

from palpate_fits.file_questions import RATE, FileQuestion, question_of_file

DEVICE = "log"
_READER = f"device.{DEVICE}."
ASSUMED_RATE = "100 Hz"  # of a file without a time: what depends on it is of no use, and E of an elastic press does not
_OF_TIP = re.compile(r"\b(tip|probe|indenter|ball|sphere|kugel)", re.IGNORECASE)
_ACROSS = re.compile(r"diameter|durchmesser", re.IGNORECASE)
_ALIKE = 0.02  # of a radius (choice), by which a tip may differ from the one that a file states
_PER_DIAMETER = 0.5  # radii
_MANY = 500  # files, below which processes take longer to start than they save: a choice
_TIMED = ("force", "position", "velocity")


@dataclass
class FileGroup:
    """Files that are read alike."""

    text: str  # of their pipeline
    path: Path  # what messages call it
    pipeline: Pipeline
    doubts: tuple[str, ...]  # what in it is a guess
    curves: list[Curve] = field(default_factory=list)


@dataclass(frozen=True)
class FileGroups:
    """Files by how they are read, the largest group first, and why others cannot be read."""

    read: Sequence[FileGroup]
    refused: Mapping[str, str]  # why, by the file
    notes: Sequence[str]  # what is ignored
    questions: Mapping[str, FileQuestion]  # what would make a file readable, or a guess of it certain, by the file

    @property
    def count(self) -> int:
        """The number of files that can be read."""
        return sum(len(group.curves) for group in self.read)

    def demand_any(self) -> None:
        """Raise ConfigurationError where no file can be read."""
        if self.read:
            return
        name, error = next(iter(self.refused.items()))
        count = len(self.refused) - 1
        file = name.rpartition(":")[0]
        is_one_file = bool(file) and all(place.startswith(f"{file}:") for place in self.refused)
        sources = "parts of the file" if is_one_file else "files"
        remainder = f" ({count} more {sources} cannot be read either)" if count else ""
        raise ConfigurationError(f"{name}: {error}{remainder}")


@dataclass(frozen=True)
class _FileLook:
    """A file that is to be looked at, with what is stated of it, as plain data for any process."""

    file: LogPart
    facts: RigFacts
    choices: Mapping[str, str]  # of the reader
    stated: Mapping[str, str]  # by ``--set``


@dataclass(frozen=True)
class FileReading:
    """The way in which a file is read, with the question that a person must answer, or why it cannot be read."""

    suggestion: Suggestion | None  # without numbers
    question: FileQuestion | None = None
    error: str = ""

    @property
    def is_certain(self) -> bool:
        """True if no answer would change it."""
        return self.suggestion is not None and self.question is None


@dataclass
class _Suggestions:
    """Suggestions for the reading of each file, with the questions that are open."""

    readings: Mapping[LogPart, FileReading]
    by_file: dict[LogPart, Suggestion] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)
    questions: dict[str, FileQuestion] = field(default_factory=dict)

    def of(self, file: LogPart) -> Suggestion:
        """Return how a file is read; raises ConfigurationError where only a person can say."""
        reading = self.readings[file]
        if reading.suggestion is None:
            raise ConfigurationError(reading.error)
        if reading.question is not None:
            self.questions[str(file)] = reading.question
            if reading.question.needed:
                raise ConfigurationError(reading.question.advice)
        self.by_file[file] = reading.suggestion
        return reading.suggestion


def _readings(
    files: Sequence[LogPart],
    facts: FileFacts,
    choices: Mapping[str, str],
    certain: dict[LogPart, FileReading],
    jobs: int | None,
) -> dict[LogPart, FileReading]:
    """Return how each file is read, by its contents and what is stated of it; many are looked at by several processes.

    `facts` has what is stated of all files and of each, `choices` the columns of roles. What is `certain` already is
    not looked at again, and what turns out to be is added to it.
    """
    settings = facts.stated.settings
    stated, stated_keys = _stated(settings), reader_keys(settings)
    readings, looks = dict(certain), list[_FileLook]()
    for file in files:
        if file in certain:
            continue
        try:
            of_file = facts.of(str(file)).facts
        except UserError as error:  # a cell of the list of curves that does not state its fact
            readings[file] = FileReading(None, error=str(error))
            continue
        looks.append(_FileLook(file, of_file, {**stated_keys, **file.choices, **choices}, stated))
    new_readings = in_portions(_look_at_files, looks, worker_count(len(looks), jobs), _lost_reading)
    for look, reading in zip(looks, new_readings, strict=True):
        readings[look.file] = reading
        if reading.is_certain:
            certain[look.file] = reading
        report_progress(len(readings))
    return readings


def worker_count(files: int, jobs: int | None) -> int:
    """Return how many processes look at so many files: one per core, or as many `jobs` as are asked for."""
    return (jobs or core_count()) if files >= _MANY else 1


def _look_at_files(looks: Sequence[_FileLook]) -> list[FileReading]:
    """Return how each of some files is read."""
    return [_look_at(look) for look in looks]


def _look_at(look: _FileLook) -> FileReading:
    """Return how a file is read."""
    try:
        suggestion = suggestion_by_facts(look.file.path, look.facts, look.choices, registry.load())
    except UserError as error:
        return FileReading(None, error=str(error))
    question = question_of_file(suggestion, look.stated)
    return FileReading(replace(suggestion, views={}), question)


def _lost_reading(look: _FileLook) -> FileReading:
    """Return why a file that has killed its process cannot be read."""
    return FileReading(None, error=KILLED)


def file_groups(
    files: Sequence[LogPart],
    facts: FileFacts,
    choices: Mapping[str, str],
    certain: dict[LogPart, FileReading],
    jobs: int | None = None,
) -> FileGroups:
    """Return files by how they are read.

    `choices` name the columns of roles, as of ``palpate info --suggest``; `certain` takes how files without questions
    are read; `jobs` is the number of processes, by default one per core. Raises ConfigurationError for a tip, a model
    or an override that is invalid.
    """
    part_registry = registry.load()
    stated = facts.stated
    tip = tip_table(stated.facts.tip or "", part_registry, "--tip")
    # Without --model it is "dr", the default of the option.
    parts = _parts(tip, part_registry.named("model", stated.facts.model or "dr"), part_registry)
    suggestions = _Suggestions(_readings(files, facts, choices, certain, jobs))
    alike = alike_logs(files, suggestions.of, suggestions.refused)
    notes = _no_records([log for group in alike for log in group.logs], suggestions.refused)
    if note := rate_note(choices, suggestions.by_file.values()):
        notes.append(note)
    notes += _sweep_notes(suggestions.by_file)
    read = [_file_group(group, parts, stated, suggestions.by_file) for group in alike]
    return FileGroups(read, suggestions.refused, notes, suggestions.questions)


def _file_group(
    alike: AlikeLogs[LogPart], parts: Mapping[str, Any], stated: StatedFacts, by_file: Mapping[LogPart, Suggestion]
) -> FileGroup:
    """Return the pipeline of files that are read alike, with the guesses in it; raises ConfigurationError.

    `parts` are the tables of tip, model and fit; `by_file` has the suggestion how each file is read.
    """
    first, suggestion = alike.logs[0], alike.suggestion
    settings = _stated(stated.settings)
    path = Path(f"pipeline of {first.name}")
    text = tomli_w.dumps(_tables(suggestion, first.path, parts, settings))
    pipeline = _built(text, path, stated.overrides)
    certain = [guess for key, guess in suggestion.guesses.items() if f"{_READER}{key}" in settings]
    more_files = f" and {len(alike.logs) - 1} more" if len(alike.logs) > 1 else ""
    doubts = [f"{file.name}: {doubt}" for file in alike.logs for doubt in _other_tips(by_file[file], pipeline)]
    doubts += [f"{first.name}{more_files}: {doubt}" for doubt in suggestion.doubts if doubt not in certain]
    return FileGroup(
        text=text, path=path, pipeline=pipeline, doubts=tuple(doubts), curves=[file.curve for file in alike.logs]
    )


def _no_records(read: Sequence[LogPart], refused: dict[str, str]) -> list[str]:
    """Return the sheets and tables that are not records, unlike others of the same file: named, and left out."""
    files = {str(log.path) for log in read if log.part is not None}
    beside = [name for name in refused if name not in files and any(name.startswith(f"{file}:") for file in files)]
    return [f"{name} is not a record, and left out: {refused.pop(name)}" for name in beside]


def _sweep_notes(by_file: Mapping[LogPart, Suggestion]) -> list[str]:
    """Return which files are sweeps, of which a fit has one value for all places."""
    names = [str(file) for file, suggestion in by_file.items() if suggestion.sweep_speed is not None]
    if not names:
        return []
    remainder = f" and {len(names) - 1} more" if len(names) > 1 else ""
    return [
        f"{names[0]}{remainder}: the tip moves along the skin, and the fit has one value: `palpate map` has all places"
    ]


def _stated(settings: Sequence[str]) -> dict[str, str]:
    """Return the texts that ``--set`` states, by key."""
    pairs = (text.partition("=") for text in settings)
    return {key.strip(): value.strip().strip("\"'") for key, _, value in pairs}


def reader_keys(settings: Sequence[str]) -> dict[str, str]:
    """Return the keys of the files' device that ``--set`` states; they count as choices."""
    stated = _stated(settings)
    keys = {key.removeprefix(_READER): value for key, value in stated.items() if key.startswith(_READER)}
    keys.pop("time", None)  # a table, which no choice is
    return keys


def _other_tips(suggestion: Suggestion, pipeline: Pipeline) -> list[str]:
    """Return the lines in which a file states another radius of the tip than its pipeline, by more than 2 %.

    `suggestion.facts` has number, name and value of each line of the file's head that states something.
    """
    radius = getattr(next(iter(pipeline.indenters.values())), "radius", None)
    texts = []
    for line, name, value in suggestion.facts:
        is_diameter = _ACROSS.search(name) is not None
        if radius is None or not _OF_TIP.search(name) or not (is_diameter or "radius" in name.lower()):
            continue
        try:
            # A unit in brackets behind the name, as in "tip radius [mm]".
            unit = re.search(r"[\[(]([^\])]+)[\])]", name)
            length = to_si(f"{value} {unit[1]}" if unit else value, "m")
        except ValueError:
            continue
        stated_radius = _PER_DIAMETER * length if is_diameter else length
        if abs(stated_radius / radius - 1.0) > _ALIKE:
            texts.append(f"line {line} states {name}: {value}, and --tip a radius of {1e3 * radius:g} mm")
    return texts


def _parts(tip: dict[str, Any], model: str, part_registry: Registry) -> dict[str, Any]:
    """Return the tables of the tip, a model of a type, and a fit."""
    table: dict[str, Any] = {"type": model}
    if "indenter" in part_registry.find("model", model).model_fields:
        table["indenter"] = "tip"
    return {"indenter": {"tip": tip}, "model": {model: table}, "estimator": {"fit": {"type": "casadi-fit"}}}


def _tables(suggestion: Suggestion, file: Path, parts: Mapping[str, Any], stated: Mapping[str, str]) -> dict[str, Any]:
    """Return the tables of the pipeline that a suggestion makes of a file, with the `parts` it is to be fitted with.

    Units, delays and tare that neither the file nor a person states are assumed, and flagged; `stated` has the settings
    of the person by key.
    """
    roles = [role for role in _TIMED if role in suggestion.alignment]
    timed = any(f"alignment.{role}.{key}" in stated for role in roles for key in ("delay", "uncertainty"))
    assumed = ["alignment.tare"] if "alignment.tare" not in stated else []
    assumed += [f"alignment.{role}.delay" for role in roles] if not timed else []
    assumed += [f"{_READER}{key}" for key in suggestion.guesses if f"{_READER}{key}" not in stated]
    device = {**suggestion.device, "file": str(file.resolve())}
    # A blank that a person has to fill in begins with "?".
    if str(device.get(RATE, "")).startswith("?") and f"{_READER}{RATE}" not in stated:
        device[RATE] = ASSUMED_RATE
        assumed.append(f"{_READER}{RATE}")
    return {
        "run": {"assumed": assumed},
        "device": {DEVICE: device},
        "alignment": dict(suggestion.alignment),
        **parts,
    }


def with_overrides(group: FileGroup, overrides: Sequence[str]) -> FileGroup:
    """Return the group with other overrides of its pipeline; raises ConfigurationError."""
    return replace(group, pipeline=_built(group.text, group.path, overrides))


def _built(text: str, path: Path, overrides: Sequence[str]) -> Pipeline:
    """Return the pipeline of a text with overrides; raises ConfigurationError."""
    source = Source(text, path)
    for assignment in overrides:
        source.override(assignment)
    return build_pipeline(source)
