"""Logs among the sources of a study: estimated by the pipeline that each carries."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import typer
from palpate import ConfigurationError, LogError
from palpate_engine import build_pipeline, make_folder, run_pipeline, values_on_trust
from palpate_kit.logs.draft_pipeline import recording_of
from palpate_kit.runs.replay_source import read_run_log, replay_source
from palpate_kit.terminal.progress import progress, report_progress


class LogRuns:
    """Run folders of logs, all in one new folder, which is made for the first of them."""

    def __init__(self) -> None:
        self._folder: Path | None = None
        self._count = 0

    def run_of(self, source: Path) -> Path:
        """Return the source itself if it is a result; of a log, the run folder by the pipeline that it carries.

        Raises ConfigurationError for a log that carries no pipeline: nothing is guessed.
        """
        if source.is_dir() or source.suffix == ".json" or not source.exists():
            return source
        try:
            recording_of(source)
        except LogError:
            return source  # whoever reads it reports that it is not a result
        run_log = read_run_log(source)
        if run_log is None:
            raise ConfigurationError(
                f"{source}: carries no pipeline, so tip and model are not known: `palpate info {source} --suggest` "
                "writes a pipeline, `palpate run` makes its run folder"
            )
        pipeline = build_pipeline(replay_source(run_log))
        if self._folder is None:
            self._folder = make_folder("repeat", None, datetime.now(UTC).astimezone())
        self._count += 1
        folder = self._folder / f"{self._count:03d}-{source.name.split('.')[0]}"
        assumed = ", ".join(f"{key} = {text}" for key, text in values_on_trust(pipeline).items())
        typer.echo(f"{source}: estimated by the pipeline of its run, into {folder}; assumed exact: {assumed}", err=True)
        with progress(str(source), "s"):
            run_pipeline(pipeline, folder, report_progress)
        return folder
