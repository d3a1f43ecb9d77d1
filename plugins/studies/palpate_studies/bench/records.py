"""The records of a bench: those that pipelines list in ``[sweep]``, in portions for processes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

from palpate import ConfigurationError, PalpateError
from palpate_engine import Pipeline, Result, Source, registry
from palpate_kit.comparison.record_rows import VALUES, Row, record_rows
from palpate_kit.curves.file_facts import facts_beside
from palpate_kit.jobs.job import Job, PortablePipeline, RunAnswer
from palpate_kit.logs.draft_pipeline import reader_of

from palpate_studies.sweep.combinations import assignments_of, combinations_of

_PORTION_RECORDS = 4  # of a job, a choice: what a stop loses, against starts of processes
_SEED = "run.seed"  # the setting of a record's seed
_FILE_SUFFIX = ".file"  # of the setting that names a log or a folder of logs


@dataclass(frozen=True)
class BenchRecord:
    """One record of a scene: its number from 1, and the pipeline with its settings."""

    scene: str
    number: int
    plan: PortablePipeline

    @property
    def key(self) -> tuple[str, str, int]:
        """The pipeline file, the scene and the number, which are unique in a bench."""
        return self.plan.path.name, self.scene, self.number


@dataclass(frozen=True)
class Portion(Job):
    """Some records of one pipeline, which are measured by one process."""

    records: tuple[BenchRecord, ...] = ()

    def pipelines(self) -> list[Pipeline]:
        """See `Job.pipelines`."""
        return [record.plan.pipeline() for record in self.records]

    def placed(self) -> Job:
        """See `Job.placed`."""
        records = tuple(
            replace(record, plan=replace(record.plan, path=record.plan.path.resolve())) for record in self.records
        )
        return replace(self, plan=records[0].plan, folder=self.folder.resolve(), records=records)


def records_of(file: Path, overrides: Sequence[str], count: int | None) -> list[BenchRecord]:
    """Return the records of a pipeline file; raises ConfigurationError.

    They are the combinations of its [sweep], each log of a folder by itself, else one. A `count` replaces listed seeds
    by 1, 2, ..., count.
    """
    source = Source.read(file)
    for assignment in overrides:
        source.override(assignment)
    run = source.tables.get("run", {})
    name = str(run.get("name", file.stem)) if isinstance(run, dict) else file.stem
    combinations = [dict(values) for values in combinations_of(source)] if "sweep" in source.tables else [{}]
    if count is not None and combinations and list(combinations[0]) == [_SEED]:
        combinations = [{_SEED: seed} for seed in range(1, count + 1)]
    record_settings = [settings for values in combinations for settings in _settings_of_logs(values, file)]
    records: list[BenchRecord] = []
    for number, settings in enumerate(record_settings, start=1):
        plan = PortablePipeline(source.text, source.path, _with_facts(settings, overrides), True)
        records.append(BenchRecord(name, number, plan))
    return records


def _settings_of_logs(values: Mapping[str, Any], file: Path) -> Iterator[dict[str, Any]]:
    """Yield settings, of those that name a folder once for each log in the folder.

    The folder is relative to the pipeline file. Raises ConfigurationError for a folder without a log.
    """
    key = _file_setting(values)
    folder = file.parent / str(values[key]) if key is not None else Path()
    if key is None or not folder.is_dir():
        yield dict(values)
        return
    plugins = registry.load()
    logs = [log for log in sorted(folder.iterdir()) if log.is_file() and reader_of(log, plugins) is not None]
    logs = [log for log in logs if log.name != "curves.csv"]  # the facts of the logs
    if not logs:
        raise ConfigurationError(f"{file}: [sweep] {key}: {folder} holds no log")
    yield from ({**values, key: str(log.absolute())} for log in logs)


def _file_setting(values: Mapping[str, Any]) -> str | None:
    """Return the first setting that names a file; None without one."""
    return next((key for key, value in values.items() if key.endswith(_FILE_SUFFIX) and isinstance(value, str)), None)


def _with_facts(values: Mapping[str, Any], overrides: Sequence[str]) -> tuple[str, ...]:
    """Return the overrides of a record: of the command, its own values, and the facts next to its log."""
    settings = (*overrides, *assignments_of(values))
    key = _file_setting(values)
    log = None if key is None else Path(values[key])
    return settings if log is None or not log.is_file() else tuple(facts_beside(log, overrides=settings).overrides)


def portions(records: Iterable[BenchRecord], folder: Path) -> list[Portion]:
    """Return jobs of a few records each, which are of one pipeline file."""
    records_by_file: dict[Path, list[BenchRecord]] = {}
    for record in records:
        records_by_file.setdefault(record.plan.path, []).append(record)
    jobs: list[Portion] = []
    for path, file_records in records_by_file.items():
        remaining = iter(file_records)
        while part := tuple(islice(remaining, _PORTION_RECORDS)):
            first = part[0]
            jobs.append(Portion(f"{first.scene} {path.stem} {first.number}", first.plan, folder, measure, part))
    return jobs


def measure(job: Job) -> RunAnswer:
    """Return the rows of every record of a portion; a record that cannot be read has one row with the reason."""
    assert isinstance(job, Portion)
    rows = [row for record in job.records for row in _measured_rows(record)]
    return RunAnswer(Result(job.folder, {}, {}, {}, (), {}, None), rows)


def _measured_rows(record: BenchRecord) -> list[Row]:
    """Return a row for each track of a record; for a record that cannot be read one row with the reason."""
    file, scene, number = record.key
    try:
        pipeline = record.plan.pipeline()
        settings = pipeline.tables.get("bench")
        rows = record_rows(pipeline, number, getattr(settings, "measure", VALUES))
    except PalpateError as error:
        rows = [{"scene": scene, "record": number, "track": "", "reason": str(error)}]
    return [{"file": file, **row} for row in rows]
