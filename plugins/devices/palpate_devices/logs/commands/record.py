"""``palpate record``: a pipeline's streams into a log, and no estimates."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer
from palpate import ConfigurationError
from palpate.host import (
    FolderOption,
    JsonOption,
    Overrides,
    Result,
    console,
    load_pipeline,
    print_json,
    progress,
    progressed,
    run_pipeline,
)

from palpate_devices.mcap_sink import McapSink


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
    logs = {name: sink for name, sink in pipeline.sinks.items() if isinstance(sink, McapSink)}
    if not logs:
        if "log" in pipeline.sinks:
            raise ConfigurationError(f"{file}: [sink.log] is no mcap, the format of a recording: rename it")
        logs = {"log": McapSink()}
    with progress(str(file), "s"):
        result = run_pipeline(replace(pipeline, tracks=(), sinks={**pipeline.sinks, **logs}), out, progressed)
    if as_json:
        print_json({"folder": result.folder, "streams": result.streams, "flags": [f.table() for f in result.flags]})
    else:
        _show(result, [result.folder / sink.file for sink in logs.values()])
    result.demand_whole()


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
