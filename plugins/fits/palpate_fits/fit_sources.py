"""Files as pipelines of offline fits: pipeline files, logs that carry one, and logs that another one reads."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import typer
from palpate import ConfigurationError, PalpateError, UserError
from palpate_engine import ConsentError, Pipeline, Source, build_pipeline, load_pipeline, parsed_assignment
from palpate_kit.curves.curve_fits import offline
from palpate_kit.curves.curve_list import RECORD
from palpate_kit.curves.curve_pipelines import curve_assignments
from palpate_kit.curves.file_facts import facts_beside
from palpate_kit.curves.fit_folder import FitFolder, is_fit_folder
from palpate_kit.curves.folder_settings import SETTINGS
from palpate_kit.curves.stated_facts import StatedFacts
from palpate_kit.runs.replay_source import RunLog, read_run_log, replay_source

from palpate_fits.fact_report import report_listed, report_rig


def leave_out(name: str, error: PalpateError, failures: dict[str, PalpateError]) -> None:
    """Note and report that one of many logs is left out, and why."""
    failures[name] = error
    typer.echo(f"{name} is left out: {error}", err=True)


def named_pipelines(
    sources: Sequence[Path], reader: Path | None, overrides: list[str], failures: dict[str, PalpateError]
) -> list[tuple[str, Pipeline]]:
    """Return every source as a pipeline, with a name of its own; of many, one that cannot be read is a failure of
    its own."""
    found: list[tuple[str, Pipeline]] = []
    taken: set[str] = set()
    stated: list[StatedFacts] = []
    for source in sources:
        try:
            loaded = offline(_pipeline(source, reader, overrides, stated))
        except UserError as error:
            if len(sources) == 1 or isinstance(error, ConsentError):
                raise
            leave_out(str(source), error, failures)
            continue
        stem = source.name.split(".")[0] or "log"
        name = next(n for k in range(len(sources) + 1) if (n := stem if k == 0 else f"{stem}-{k + 1}") not in taken)
        taken.add(name)
        found.append((name, loaded))
    report_rig(facts.path for facts in stated if facts.is_read and not facts.is_named)
    report_listed([facts.of_curve_list for facts in stated], len(stated))
    return found


def _pipeline(source: Path, reader: Path | None, overrides: list[str], stated: list[StatedFacts]) -> Pipeline:
    """Return the pipeline of a source; `stated` takes the facts of a file that are stated next to it."""
    if not source.exists():
        raise ConfigurationError(f"{source}: no such file")
    if source.suffix == ".toml":
        return load_pipeline(source, overrides)
    if reader is None:
        return _carried(source, overrides)
    record = next((str(value) for keys, value in map(parsed_assignment, overrides) if keys[-1] == RECORD), None)
    if (assignments := _of_fit_folder(source, reader, record)) is None:
        device = log_device(load_pipeline(reader, overrides), reader)
        facts = facts_beside(source, record, overrides)
        stated.append(facts)
        rig = [f"run.rig={json.dumps(str(facts.path.absolute()))}"] if facts.is_read and not facts.is_named else []
        assignments = (f"device.{device}.file={json.dumps(str(source.resolve()))}", *rig, *facts.listed_assignments)
    return load_pipeline(reader, [*assignments, *overrides])


def _of_fit_folder(source: Path, reader: Path, record: str | None) -> tuple[str, ...] | None:
    """Return what makes the pipeline of a folder of fits that of one of its curves; None for any other file."""
    if reader.name != SETTINGS or not is_fit_folder(reader.parent):
        return None
    folder = FitFolder(reader.parent)
    names = folder.names_of(source, record)
    if len(names) > 1:
        listed = ", ".join(names)
        raise ConfigurationError(f"{source}: is {len(names)} curves ({listed}): choose one by device.log.{RECORD}")
    return curve_assignments(folder, names[0]) if names else None


def _carried(log: Path, overrides: list[str]) -> Pipeline:
    """Return the pipeline that a log carries, with an offline fit where it has none; raises ConfigurationError."""
    carried = read_run_log(log)
    if carried is None:
        asked = f"say its tip, as in palpate fit {log} --tip 'sphere 3 mm', or say with --pipeline FILE what reads it"
        raise ConfigurationError(f"{log}: is a log; {asked}")
    source = replay_source(carried)
    for assignment in overrides:
        source.override(assignment)
    pipeline = build_pipeline(source)
    if not any(not track.estimator.online for track in pipeline.tracks):
        pipeline = build_pipeline(_with_fit(carried, overrides))
    return pipeline


def _with_fit(carried: RunLog, overrides: list[str]) -> Source:
    source = replay_source(carried, ["*/casadi-fit"], ["casadi-fit"])
    for assignment in overrides:
        source.override(assignment)
    return source


def log_device(pipeline: Pipeline, path: Path) -> str:
    """Return the one device that has a file; raises ConfigurationError if it has none or several."""
    logs = [name for name, device in pipeline.devices.items() if "file" in type(device).model_fields]
    if len(logs) != 1:
        raise ConfigurationError(f"{path}: --pipeline needs one device with a file, and this has {len(logs)}")
    return logs[0]
