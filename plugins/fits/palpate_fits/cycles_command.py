"""``palpate fit cycles``: every cycle of a log, fitted by itself."""

from __future__ import annotations

from palpate_kit.jobs.engines import SchedulerOption, StageOption
from palpate_kit.terminal.options import DetailsOption, FormatOption, Overrides

from palpate_fits.evaluation import each_cycle
from palpate_fits.whole_logs import (
    JsonOption,
    OutOption,
    PicturesOption,
    PipelineOption,
    SourcesArgument,
    WholeLogs,
    fit_logs,
)


def cycles(
    sources: SourcesArgument,
    pipeline: PipelineOption = None,
    out: OutOption = None,
    overrides: Overrides = None,
    pictures: PicturesOption = True,
    as_json: JsonOption = False,
    details: DetailsOption = False,
    layout: FormatOption = "table",
    scheduler: SchedulerOption = None,
    stage: StageOption = None,
) -> None:
    """Fit every offline track to every log, and to every cycle of it by itself."""
    asked = WholeLogs(sources, pipeline, overrides, out, scheduler, stage, pictures, details, as_json)
    fit_logs(asked, cycles=lambda logs: [row for log in logs for row in each_cycle(log)])
