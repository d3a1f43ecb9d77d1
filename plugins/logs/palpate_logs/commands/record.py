"""``palpate record``: a pipeline's streams into a log, and no estimates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, cast

import typer
from palpate import ConfigurationError, Sink
from palpate_engine import Result, load_pipeline, registry, run_pipeline
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import FolderOption, JsonOption, Overrides
from palpate_kit.terminal.progress import progress, report_progress
from palpate_kit.terminal.table import console


def record(
    file: Annotated[Path, typer.Argument(help="The pipeline file; its estimators are not used.")],
    out: FolderOption = None,
    overrides: Overrides = None,
    as_json: JsonOption = False,
) -> None:
    """Write all that the devices of a pipeline send into an MCAP log, until they end or Ctrl-C; estimate nothing.

    A robot that the pipeline moves is moved, under all limits. `palpate replay` estimates from the log later on.
    """
    pipeline = load_pipeline(file, overrides or [])
    recorder = _recorder()
    logs: dict[str, Any] = {name: sink for name, sink in pipeline.sinks.items() if isinstance(sink, recorder)}
    if not logs:
        if "log" in pipeline.sinks:
            raise ConfigurationError(f"{file}: [sink.log] is no mcap, the format of a recording: rename it")
        logs = {"log": recorder()}
    with progress(str(file), "s"):
        result = run_pipeline(replace(pipeline, tracks=(), sinks={**pipeline.sinks, **logs}), out, report_progress)
    if as_json:
        print_json({"folder": result.folder, "streams": result.streams, "flags": [f.table() for f in result.flags]})
    else:
        _show(result, [result.folder / sink.file for sink in logs.values()])
    result.demand_whole()


def _recorder() -> type[Sink]:
    """The sink that records; raises ConfigurationError where no plugin offers it."""
    sinks = registry.load().parts["sink"]
    if "mcap" not in sinks:
        raise ConfigurationError("no plugin offers the sink 'mcap', the format of a recording")
    return cast(type[Sink], sinks["mcap"].part)


def _show(result: Result, files: list[Path]) -> None:
    from rich.table import Table

    table = Table()
    table.add_column("stream")
    for heading in ("readings", "rate\nHz", "gaps"):
        table.add_column(heading, justify="right")
    for name, stream in result.streams.items():
        rate = stream.get("rate")
        table.add_row(name, str(stream["samples"]), "" if rate is None else f"{rate:.1f}", str(stream["gaps"]))
    console().print(table)
    for flag in result.flags:
        typer.echo(f"{flag.code}: {flag.message}")
    for path in files:
        typer.echo(f"recorded in {path}")
