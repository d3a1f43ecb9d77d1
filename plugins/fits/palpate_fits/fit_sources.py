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
from palpate_kit.runs.replay_source import read_run_log, replay_source

from palpate_fits.fact_report import report_listed, report_rig


def leave_out(name: str, error: PalpateError, failures: dict[str, PalpateError]) -> None:
    """Note and report that one of many logs is left out, and why."""
    failures[name] = error
    typer.echo(f"{name} is left out: {error}", err=True)


def named_pipelines(
    sources: Sequence[Path], reader: Path | None, overrides: list[str], failures: dict[str, PalpateError]
) -> list[tuple[str, Pipeline]]:
    """Return the pipeline of each source, with only its offline fits, by a unique name.

    A source is a pipeline file, a log that carries its pipeline, or a log that the pipeline file `reader` reads. One of
    several that cannot be read is reported and added to `failures`; raises UserError for a single one, and ConsentError
    for any.
    """
    pipelines: list[tuple[str, Pipeline]] = []
    stated: list[StatedFacts] = []
    for source in sources:
        try:
            pipeline = offline(_pipeline(source, reader, overrides, stated))
        except UserError as error:
            if len(sources) == 1 or isinstance(error, ConsentError):
                raise
            leave_out(str(source), error, failures)
            continue
        pipelines.append((_unique_name(source, {name for name, _ in pipelines}), pipeline))
    report_rig(facts.path for facts in stated if facts.is_read and not facts.is_named)
    report_listed([facts.of_curve_list for facts in stated], len(stated))
    return pipelines


def _unique_name(source: Path, names: set[str]) -> str:
    """Return the name of a file up to its first dot, with a number from 2 on where `names` has it already."""
    stem = source.name.split(".")[0] or "log"
    name, number = stem, 1
    while name in names:
        number += 1
        name = f"{stem}-{number}"
    return name


def _pipeline(source: Path, reader: Path | None, overrides: list[str], stated: list[StatedFacts]) -> Pipeline:
    """Return the pipeline of a source; appends to `stated` the facts that are stated next to a log.

    Raises ConfigurationError where the source does not exist or does not say how it is read.
    """
    if not source.exists():
        raise ConfigurationError(f"{source}: no such file")
    if source.suffix == ".toml":
        return load_pipeline(source, overrides)
    if reader is None:
        return _carried_pipeline(source, overrides)
    record = next((str(value) for keys, value in map(parsed_assignment, overrides) if keys[-1] == RECORD), None)
    assignments = _curve_assignments(source, reader, record)
    if assignments is not None:
        return load_pipeline(reader, [*assignments, *overrides])
    # Any other log: it replaces the file of the reader's one log, with the facts next to it.
    device = log_device(load_pipeline(reader, overrides), reader)
    facts = facts_beside(source, record, overrides)
    stated.append(facts)
    file_assignments = [f"device.{device}.file={json.dumps(str(source.resolve()))}"]
    if facts.is_read and not facts.is_named:
        file_assignments.append(f"run.rig={json.dumps(str(facts.path.absolute()))}")
    return load_pipeline(reader, [*file_assignments, *facts.listed_assignments, *overrides])


def _curve_assignments(source: Path, reader: Path, record: str | None) -> tuple[str, ...] | None:
    """Return the assignments by which the pipeline of a folder of fits reads one of its curves.

    None where the source is not one of them; raises ConfigurationError where it holds several and `record` none of
    them.
    """
    if reader.name != SETTINGS or not is_fit_folder(reader.parent):
        return None
    folder = FitFolder(reader.parent)
    names = folder.names_of(source, record)
    if len(names) > 1:
        listed = ", ".join(names)
        raise ConfigurationError(f"{source}: is {len(names)} curves ({listed}): choose one by device.log.{RECORD}")
    return curve_assignments(folder, names[0]) if names else None


def _carried_pipeline(log: Path, overrides: list[str]) -> Pipeline:
    """Return the pipeline that a log carries, with an offline fit where it has none; raises ConfigurationError."""
    run_log = read_run_log(log)
    if run_log is None:
        remedy = f"say its tip, as in palpate fit {log} --tip 'sphere 3 mm', or say with --pipeline FILE what reads it"
        raise ConfigurationError(f"{log}: is a log; {remedy}")
    pipeline = build_pipeline(_overridden(replay_source(run_log), overrides))
    if all(track.estimator.online for track in pipeline.tracks):
        with_fit = replay_source(run_log, ["*/casadi-fit"], ["casadi-fit"])
        pipeline = build_pipeline(_overridden(with_fit, overrides))
    return pipeline


def _overridden(source: Source, overrides: list[str]) -> Source:
    """Return a source after its overrides."""
    for assignment in overrides:
        source.override(assignment)
    return source


def log_device(pipeline: Pipeline, path: Path) -> str:
    """Return the one device that has a file; raises ConfigurationError if it has none or several."""
    logs = [name for name, device in pipeline.devices.items() if "file" in type(device).model_fields]
    if len(logs) != 1:
        raise ConfigurationError(f"{path}: --pipeline needs one device with a file, and this has {len(logs)}")
    return logs[0]
