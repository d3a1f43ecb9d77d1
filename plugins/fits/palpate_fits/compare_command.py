"""``palpate fit compare``, ``palpate fit cycles``: fits of logs evaluated on one another, and fits of each cycle."""

from __future__ import annotations

from typing import Annotated

import typer
from palpate import ConfigurationError
from palpate_kit.jobs.engines import SchedulerOption, StageOption
from palpate_kit.terminal.options import DetailsOption, FormatOption, Overrides

from palpate_fits.evaluation import each_cycle, evaluate
from palpate_fits.fit_request import (
    FitRequest,
    JsonOption,
    OutOption,
    PicturesOption,
    PipelineOption,
    SourcesArgument,
)
from palpate_fits.whole_logs import fit_logs


def compare(
    sources: SourcesArgument,
    pipeline: PipelineOption = None,
    out: OutOption = None,
    overrides: Overrides = None,
    carry: Annotated[bool, typer.Option("--carry", help="Keep the surface of the first log, too.")] = False,
    pictures: PicturesOption = True,
    as_json: JsonOption = False,
    details: DetailsOption = False,
    layout: FormatOption = "table",  # set for all tables by the option's callback
    scheduler: SchedulerOption = None,
    stage: StageOption = None,
) -> None:
    """Fit every offline track to every log, and show the force that its material leaves of every other log.

    Surface and bias are fitted again there, or with --carry kept.
    """
    if len(sources) < 2:
        raise ConfigurationError("palpate fit compare: give two logs or more; palpate fit is for one")
    request = FitRequest(
        tuple(sources), pipeline, tuple(overrides or ()), out=out, scheduler=scheduler, stage=stage, pictures=pictures,
        as_json=as_json, details=details,
    )  # fmt: skip
    fit_logs(request, evaluated=lambda logs: evaluate(logs, carry) if len(logs) > 1 else [])


def cycles(
    sources: SourcesArgument,
    pipeline: PipelineOption = None,
    out: OutOption = None,
    overrides: Overrides = None,
    pictures: PicturesOption = True,
    as_json: JsonOption = False,
    details: DetailsOption = False,
    layout: FormatOption = "table",  # set for all tables by the option's callback
    scheduler: SchedulerOption = None,
    stage: StageOption = None,
) -> None:
    """Fit every offline track to every log, and to every cycle of it by itself."""
    request = FitRequest(
        tuple(sources), pipeline, tuple(overrides or ()), out=out, scheduler=scheduler, stage=stage, pictures=pictures,
        as_json=as_json, details=details,
    )  # fmt: skip
    fit_logs(request, cycles=lambda logs: [row for log in logs for row in each_cycle(log)])
