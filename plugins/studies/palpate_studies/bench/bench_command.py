"""``palpate bench``: filters and models on many records, side by side in one table."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import closing, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from palpate import OutputError, PalpateError
from palpate_engine import StoppedError, bounded_text, make_folder, registry, write_new, write_whole
from palpate_kit.comparison.record_rows import Row
from palpate_kit.comparison.standard_set import SLOW_SCENES, scene_files
from palpate_kit.jobs.engines import SchedulerOption, StageOption, engine_of
from palpate_kit.jobs.job import Engine
from palpate_kit.terminal.json_output import json_text, print_json
from palpate_kit.terminal.layout import layout
from palpate_kit.terminal.options import DetailsOption, FormatOption, JsonOption, Overrides
from palpate_kit.terminal.progress import progress, report_progress
from palpate_kit.terminal.table import console

from palpate_studies.bench.bench_table import csv_text, lines_below, scene_matrix, scene_table, summaries
from palpate_studies.bench.records import BenchRecord, portions, records_of

_ROWS_FILE, _SETTINGS_FILE = "rows.jsonl", "bench.json"
_INTERRUPTED = 130  # exit code of a command that was stopped from the keyboard: 128 and the number of the signal


def bench(
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Pipeline files; their [sweep] lists records: seeds, logs, folders. [default: standard set]"
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="Folder; one that holds a part of this bench is continued. [default: runs/...]"
        ),
    ] = None,
    overrides: Overrides = None,
    records: Annotated[
        int | None, typer.Option(help="Records of a scene whose seeds are listed. [default: as listed]", min=1)
    ] = None,
    jobs: Annotated[int | None, typer.Option(help="Processes at a time. [default: one per core]", min=1)] = None,
    scheduler: SchedulerOption = None,
    stage: StageOption = None,
    picture: Annotated[
        bool,
        typer.Option("--picture", help="Draw error against cost, and the estimates over time of a record of each."),
    ] = False,
    details: DetailsOption = False,
    as_json: JsonOption = False,
    form: FormatOption = "table",
) -> None:
    """Compare filters and models on many records: the standard set of simulated scenes, or those of pipelines.

    Those of a plugin file take part: palpate bench --plugin mine.py.

    Each record is made once, and every track runs on its samples. Errors where a truth is known, and for all the error
    of the force that the estimate of the sample before predicts, NIS, time to settle and cost.
    """
    bench_records = _records(files or [], overrides or [], records)
    folder = _bench_folder(bench_records, out)
    # What an earlier attempt has measured is not measured again.
    rows = _kept_rows(folder)
    measured_keys = {_key(row) for row in rows}
    missing = [record for record in bench_records if record.key not in measured_keys]
    rows += _measure(missing, folder, engine_of(scheduler, jobs, folder, stage), len(bench_records))
    order = {record.key: index for index, record in enumerate(bench_records)}
    rows.sort(key=lambda row: order[_key(row)])
    summary_rows = summaries(rows)
    write_whole(folder / "records.csv", csv_text(rows))
    write_whole(folder / "bench.csv", csv_text(summary_rows))
    write_whole(folder / "summary.json", json_text(summary_rows))
    if as_json:
        print_json({"folder": folder, "records": len(bench_records), "rows": summary_rows})
    else:
        _print_summary(summary_rows, details)
    if picture:
        _draw(bench_records, summary_rows, folder, as_json)
    failed = sum(row["failed"] for row in summary_rows)
    kept_count = len(bench_records) - len(missing)
    counts = f"{len(bench_records)} records, {failed} estimates failed, {kept_count} found in the folder"
    typer.echo(f"{counts}: {folder}", err=as_json or layout() != "table")
    if len({_key(row) for row in rows}) < len(bench_records):
        typer.echo(f"stopped; go on with --out {folder}", err=True)
        raise typer.Exit(_INTERRUPTED)


def _records(files: Sequence[Path], overrides: list[str], count: int | None) -> list[BenchRecord]:
    """Return the records of pipelines, `count` of each whose seeds are listed; of none, those of the standard set.

    Parts of plugin files do not take part in the slow scenes.
    """
    settings = [*_with_plugin_files(), *overrides]
    records = [record for file in files or scene_files() for record in records_of(file, settings, count)]
    if not files:
        records += [record for file in scene_files(SLOW_SCENES) for record in records_of(file, overrides, None)]
    return records


def _key(row: Row) -> tuple[str, str, int]:
    """Return the key of the record that a row is of, as `BenchRecord.key`."""
    return row["file"], row["scene"], row["record"]


def _draw(records: Sequence[BenchRecord], rows: Sequence[Row], folder: Path, as_json: bool) -> None:
    """Draw error against cost, and the estimates of the first record of each pipeline that can be run."""
    from palpate_studies.bench.bench_figures import draw_errors, draw_estimates

    paths = draw_errors(rows, folder)
    for record in records:
        if record.number == 1 and record.plan.path.stem not in SLOW_SCENES:
            try:
                paths += draw_estimates(record.plan.pipeline(), folder)
            except PalpateError as error:
                typer.echo(f"{record.scene}: no picture: {error}", err=True)
    typer.echo(f"{len(paths)} pictures, PDF and SVG, 85 and 170 mm wide: {folder}", err=as_json or layout() != "table")


def _with_plugin_files() -> list[str]:
    """Return settings by which all estimators and models of plugin files take part, each under its own name."""
    plugins = registry.load()
    settings = []
    for part_kind in ("estimator", "model"):
        for name, entry in plugins.parts[part_kind].items():
            if entry.plugin.name.endswith(".py"):
                settings.append(f"{part_kind}.{name}.type={json.dumps(name)}")
                if "indenter" in entry.part.model_fields:
                    settings.append(f'{part_kind}.{name}.indenter="tip"')
    return settings


def _measure(records: Sequence[BenchRecord], folder: Path, engine: Engine, total: int) -> list[Row]:
    """Measure records and return their rows; those of each portion are written to the folder as soon as it is done.

    `total` is the number of all records of the bench, for the progress. A stop by a person ends it early.
    """
    rows: list[Row] = []
    with (
        progress("bench", "records", total),
        closing(engine(portions(records, folder / "work"))) as running,
        suppress(KeyboardInterrupt),
    ):
        report_progress(total - len(records))
        for _, outcome in running:
            if isinstance(outcome, StoppedError):
                break
            if isinstance(outcome, PalpateError):
                raise outcome
            with (folder / _ROWS_FILE).open("a", encoding="utf-8") as file:
                file.write("".join(json.dumps(row) + "\n" for row in outcome.more))
            rows += outcome.more
            report_progress(total - len(records) + len({_key(row) for row in rows}))
    return rows


def _kept_rows(folder: Path) -> list[Row]:
    """Return the rows that an earlier attempt has written whole; a row that was cut is left out."""
    path = folder / _ROWS_FILE
    if not path.is_file():
        return []
    rows: list[Row] = []
    for line in path.read_text(encoding="utf-8").splitlines():
        with suppress(json.JSONDecodeError):
            rows.append(json.loads(line))
    return rows


def _bench_folder(records: Sequence[BenchRecord], out: Path | None) -> Path:
    """Return the folder of a bench: a new one, or one that holds a part of this very bench; raises OutputError."""
    settings = [[record.scene, record.number, record.plan.text, list(record.plan.overrides)] for record in records]
    text = json_text(settings)
    if out is None or not (out / _SETTINGS_FILE).is_file():
        folder = make_folder("bench", out, datetime.now(UTC).astimezone())
        write_new(folder / _SETTINGS_FILE, text)
        return folder
    if bounded_text(out / _SETTINGS_FILE) != text:
        raise OutputError(f"{out}: holds a bench of other records or settings; give --out another folder")
    return out


def _print_summary(rows: Sequence[Row], details: bool) -> None:
    """Print a column for each of several scenes, or all measures of one; with `details`, or as CSV, those of each."""
    screen = console()
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    is_csv = layout() != "table"
    if len(scenes) > 1 and not is_csv:
        screen.print(scene_matrix(rows).view())
    if details or is_csv or len(scenes) == 1:
        for scene in scenes:
            if len(scenes) > 1:
                screen.print(f"\n{scene}", highlight=False)
            scene_rows = [row for row in rows if row["scene"] == scene]
            screen.print(scene_table(scene_rows, is_whole=is_csv).view())
    if not is_csv:
        for line in lines_below(rows):
            screen.print(line, highlight=False)
