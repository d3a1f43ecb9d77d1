"""``palpate replay``: estimate a recorded run again, from its log, with the pipeline in it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from palpate import ConfigurationError
from palpate_engine import build_pipeline
from palpate_kit.runs.replay_source import read_run_log, replay_source
from palpate_kit.terminal.fact_options import with_facts
from palpate_kit.terminal.options import DetailsOption, FolderOption, FormatOption, JsonOption, Overrides
from palpate_kit.terminal.progress import progress

from palpate_commands.run import execute


@with_facts
def replay(
    source: Annotated[Path, typer.Argument(metavar="LOG_OR_RUN", help="A log that palpate wrote, or a run folder.")],
    overrides: Overrides = None,
    tracks: Annotated[
        list[str] | None, typer.Option("--tracks", help='Only these tracks, as patterns: "dr/*"; can be repeated.')
    ] = None,
    estimators: Annotated[
        list[str] | None, typer.Option("--add-estimator", metavar="TYPE", help="One more estimator, with its defaults.")
    ] = None,
    models: Annotated[
        list[str] | None, typer.Option("--add-model", metavar="TYPE", help="One more contact model, on the same tip.")
    ] = None,
    out: FolderOption = None,
    as_json: JsonOption = False,
    details: DetailsOption = False,
    layout: FormatOption = "table",
) -> None:
    """Estimate again from the log of a run, by the pipeline in the log: the same numbers to the bit.

    Devices are replaced by the log; sinks are left out. Nothing that a log carries is executed, and a plugin file that
    it names only if its content was approved here (`palpate trust`).
    """
    with progress(f"look at {source}"):
        carried = read_run_log(source)
    if carried is None:
        raise ConfigurationError(
            f"{source}: carries no pipeline, so not a log of palpate's: `palpate info {source} --suggest` writes one"
        )
    text = replay_source(carried, tracks or (), estimators or (), models or ())
    for assignment in overrides or ():
        text.override(assignment)
    with progress(f"look at {source}"):
        pipeline = build_pipeline(text)
    execute(pipeline, out, as_json, details)
