"""Replay: the pipeline that a run or its log carries, with its devices replaced by the log."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w
from palpate import ConfigurationError, LogError, Part, printable
from palpate_engine import Enclosure, Source, registry as registries
from palpate_records.recording import LogAttachments, Recording, Suggestion

from palpate_kit.logs.draft_pipeline import reader_of, recording_of
from palpate_kit.runs.estimates_parquet import WHOLE
from palpate_kit.runs.run_folder import RunFolder, pipeline_among
from palpate_kit.runs.shared_tips import name_tips

_CHOSEN = "chosen"  # the device of channels that were chosen
_SHOWN_DIGITS = 12  # of a hash in a message: a choice


@dataclass(frozen=True)
class RunLog:
    """A log that carries the pipeline of its run."""

    log: Path
    reader: type[Recording]
    attached: LogAttachments
    name: str  # of the attachment that is the pipeline


def read_run_log(path: Path) -> RunLog | None:
    """Return what a log, or a run folder with a log, carries; None where it is another's log. Raises LogError."""
    log = log_in(path)
    reader = recording_of(log)
    attached = reader.attached(log)
    name = pipeline_among(attached.documents)
    return RunLog(log, reader, attached, name) if name is not None else None


def log_in(path: Path) -> Path:
    """Return the log itself, or the one log in a run folder; raises LogError if it has none or several."""
    if not path.is_dir() or not RunFolder(path).began:
        return path
    registry = registries.load()
    logs = [file for file in sorted(path.iterdir()) if file.is_file() and reader_of(file, registry) is not None]
    logs = [file for file in logs if file.suffix not in (".csv", WHOLE)]  # its tables of estimates are not logs
    if len(logs) != 1:
        names = ", ".join(file.name for file in logs) or "none"
        raise LogError(f"{path}: expected one log in a run folder ({names}); add a [sink.*] to the pipeline")
    return logs[0]


def replay_source(
    carried: RunLog, tracks: Sequence[str] = (), estimators: Iterable[str] = (), models: Iterable[str] = ()
) -> Source:
    """Return the pipeline of a recorded run that reads the log in place of its devices, as a source to be built.

    `carried` is the log with the documents in it; `tracks` choose tracks, `estimators` and `models` add parts by name.

    Nothing that a log carries is executed: plugin files are those of this machine, only where their hash is that of the
    recording, and, when the source is built, only with consent. Relative paths are those next to the log. Raises
    ConfigurationError where a plugin file is missing or another one, LogError for what is not a pipeline.
    """
    where = carried.log.with_name(f"{carried.log.name}:{carried.name}")
    enclosure = Enclosure(carried.log, frozenset(carried.attached.facts.values()))
    source = Source(carried.attached.documents[carried.name], where, enclosure=enclosure)
    tables = source.tables
    run = tables.setdefault("run", {})
    if not isinstance(run, dict) or not isinstance(tables.get("device"), dict):
        raise LogError(f"{where}: is not a pipeline: [run] and [device.*] must be tables")
    # Devices become the log; sinks and twins have no part in a replay.
    _refuse_other_plugins(run, carried)
    name_tips(source)
    tables["device"] = {name: carried.reader.playback(carried.log.absolute(), name) for name in tables["device"]}
    for name in ("sink", "twin"):
        tables.pop(name, None)
    _drop_foreign_calibration(run, carried.log, enclosure)
    # Parts that the caller adds, and the tracks that are made of them.
    for family, types in (("model", models), ("estimator", estimators)):
        for name in types:
            tables.setdefault(family, {}).setdefault(name, added_table(family, name, tables))
    if tracks:
        run["tracks"] = list(tracks)
    elif "tracks" in run:
        run["tracks"] = [*run["tracks"], *(f"*/{name}" for name in estimators), *(f"{name}/*" for name in models)]
    return source


def _drop_foreign_calibration(run: dict[str, Any], log: Path, enclosure: Enclosure) -> None:
    """Take a calibration out of [run] that is missing, or is not the recording's: the settings have its values."""
    calibration = run.get("calibration")
    if not isinstance(calibration, str):
        return
    file = _beside(log, calibration)
    if not file.exists() or (file.is_file() and not enclosure.admits(file)):
        run.pop("calibration")


def with_other_channels(carried: RunLog, suggestion: Suggestion, choices: Iterable[str]) -> Source:
    """Return the pipeline of a recorded run whose roles in `choices` are read where a suggestion reads them.

    `choices` are roles such as "force". The delays of the run's own channels do not hold for the other ones, whose
    delays are noted in ``[run] assumed``.
    """
    source = replay_source(carried)
    tables = source.tables
    names = (_CHOSEN, *(f"{_CHOSEN}_{k}" for k in range(2, len(tables["device"]) + 2)))
    name = next(name for name in names if name not in tables["device"])
    # Which part of the record is measured its run has said: the window that a suggestion guesses is for other logs.
    reader = {key: value for key, value in suggestion.device.items() if key not in ("begin", "end")}
    tables["device"][name] = {**reader, "file": str(carried.log.absolute())}
    run, changed = tables.setdefault("run", {}), [role for role in choices if role in suggestion.alignment]
    for role in changed:
        signal = dict(suggestion.alignment[role])
        signal["channel"] = f"{name}.{signal['channel'].partition('.')[2]}"
        tables["alignment"][role] = signal
    run["assumed"] = [*run.get("assumed", ()), *(f"alignment.{role}.delay" for role in changed)]
    return source


def run_log_text(source: Source, log: Path) -> str:
    """Return the pipeline of a log that begins from what the log carries, as TOML."""
    head = f"# A pipeline for {printable(log.name)}: that of its run, as the log carries it.\n"
    return head + tomli_w.dumps(source.tables)


def _beside(log: Path, text: str) -> Path:
    """Return the path that a text of a log names, next to the log."""
    return log.parent / os.path.expanduser(text)  # which, other than that of pathlib, never raises


def _refuse_other_plugins(run: dict[str, Any], carried: RunLog) -> None:
    """Raise ConfigurationError where a plugin file of a recorded run is missing here, or is another version.

    `run` is the table [run] of the recorded pipeline, `carried` the log with its facts.
    """
    plugins = run.get("plugins")
    for text in plugins if isinstance(plugins, list) else ():
        if not isinstance(text, str):
            continue  # which the builder reports
        path = _beside(carried.log, text)
        recorded_hash = carried.attached.facts.get(f"plugin.{Path(text).name}.sha256")
        if not path.is_file():
            raise ConfigurationError(
                f"{carried.log}: was recorded with the plugin file {text}, which is not on this machine; a log has "
                "no code: get the file from where it was recorded"
            )
        if recorded_hash is not None and hashlib.sha256(path.read_bytes()).hexdigest() != recorded_hash:
            raise ConfigurationError(
                f"{carried.log}: was recorded with another version of the plugin file {text} "
                f"(SHA-256 {recorded_hash[:_SHOWN_DIGITS]}...)"
            )


def added_table(family: str, name: str, tables: dict[str, Any]) -> dict[str, Any]:
    """Return the table of one more model or estimator (`family`) for a pipeline, by the name of its type.

    It is on the pipeline's tip if it needs one; a model has the settings that the pipeline's models share. Other
    numbers of a model are defaults, which are added to ``[run] assumed``. Raises ConfigurationError for a part that
    needs a tip where the pipeline has none.
    """
    part = registries.load().find(family, name)
    table: dict[str, Any] = {"type": name}
    if family == "model":
        table |= _shared_settings(part, tables)
        # A Poisson's ratio that is left out is open by that alone.
        defaults = [key for key in _unstated(part, table) if key != "poisson"]
        run = tables.setdefault("run", {})
        run["assumed"] = [*run.get("assumed", ()), *(f"{family}.{name}.{key}" for key in defaults)]
    field = part.model_fields.get("indenter")
    if field is not None and field.is_required():
        tips = [model["indenter"] for model in tables.get("model", {}).values() if "indenter" in model]
        tip = next(iter(tips), None) or next(iter(tables.get("indenter", {})), None)
        if tip is None:
            raise ConfigurationError(f"{family} {name!r} needs a tip, and the recorded pipeline has none")
        table["indenter"] = tip
    return table


def _shared_settings(model: type[Part], tables: dict[str, Any]) -> dict[str, Any]:
    """Return the settings of a model that all models of a pipeline which have them set alike."""
    models = [table for table in tables.get("model", {}).values() if isinstance(table, dict)]
    shared = {}
    for key in _unstated(model, {}):
        settings = [table[key] for table in models if key in table]
        if settings and all(setting == settings[0] for setting in settings):
            shared[key] = settings[0]
    return shared


def replace_model(source: Source, model_name: str) -> None:
    """Put another model, by name or initials, on the tip of the first in place of all; raises ConfigurationError."""
    tables: dict[str, Any] = source.tables
    name = registries.load().named("model", model_name)
    tables["model"] = {name: added_table("model", name, tables)}
    run = tables.setdefault("run", {})
    run.pop("tracks", None)
    # What is assumed of models that have gone is assumed no more.
    assumed = run.get("assumed", ())
    run["assumed"] = [key for key in assumed if not key.startswith("model.") or key.split(".")[1] == name]


def _unstated(part: type[Part], table: Mapping[str, Any]) -> list[str]:
    """Return the numbers of a part that its table leaves to their defaults."""
    return [name for name, field in part.model_fields.items() if field.annotation is float and name not in table]
