"""The records of a bench: those that pipelines ask for in ``[sweep]``, each as a job or a part of one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import tomli_w
from palpate import ConfigurationError, PalpateError
from palpate_engine import Pipeline, Result, Source, registry
from palpate_kit.comparison.record_rows import VALUES, Row, record_rows
from palpate_kit.curves.file_facts import facts_beside
from palpate_kit.jobs.job import Job, PortablePipeline, RunAnswer
from palpate_kit.logs.draft_pipeline import reader_of

from palpate_studies.sweep.combinations import combinations_of

_PORTION = 4  # records of a job, a choice: what is lost by a stop, and how often a process begins again
_SEED = "run.seed"
_FILE = ".file"


@dataclass(frozen=True)
class BenchRecord:
    """One record of a scene: its number, and the pipeline that has it."""

    scene: str
    number: int
    plan: PortablePipeline

    @property
    def key(self) -> tuple[str, str, int]:
        """Its pipeline file, scene and number, which no other record of a bench has."""
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
    """Return the records of a pipeline file, `count` of one whose seeds are listed; raises ConfigurationError."""
    source = Source.read(file)
    for assignment in overrides:
        source.override(assignment)
    run = source.tables.get("run", {})
    name = str(run.get("name", file.stem)) if isinstance(run, dict) else file.stem
    combinations = [dict(values) for values in combinations_of(source)] if "sweep" in source.tables else [{}]
    if count is not None and combinations and list(combinations[0]) == [_SEED]:
        combinations = [{_SEED: seed} for seed in range(1, count + 1)]
    settings = [of_log for values in combinations for of_log in _of_folders(values, file)]
    return [
        BenchRecord(name, number, PortablePipeline(source.text, source.path, _with_facts(values, overrides), True))
        for number, values in enumerate(settings, start=1)
    ]


def _of_folders(values: Mapping[str, Any], file: Path) -> Iterator[dict[str, Any]]:
    """Return the same with each log of a folder in place of the folder."""
    key = next((key for key, value in values.items() if key.endswith(_FILE) and isinstance(value, str)), None)
    place = file.parent / str(values[key]) if key is not None else Path()
    if key is None or not place.is_dir():
        yield dict(values)
        return
    registered = registry.load()
    logs = [log for log in sorted(place.iterdir()) if log.is_file() and reader_of(log, registered) is not None]
    logs = [log for log in logs if log.name != "curves.csv"]
    if not logs:
        raise ConfigurationError(f"{file}: [sweep] {key}: {place} holds no log")
    yield from ({**values, key: str(log.absolute())} for log in logs)


def _with_facts(values: Mapping[str, Any], overrides: Sequence[str]) -> tuple[str, ...]:
    """Return overrides of a record: of the command, its own values, and the facts next to its log."""
    record_settings = [
        f"{key}={tomli_w.dumps({'v': value}).strip().removeprefix('v = ')}" for key, value in values.items()
    ]
    logs = [Path(value) for key, value in values.items() if key.endswith(_FILE) and isinstance(value, str)]
    settings = (*overrides, *record_settings)
    return tuple(facts_beside(logs[0], overrides=settings).overrides) if logs and logs[0].is_file() else settings


def portions(records: Iterable[BenchRecord], folder: Path) -> list[Portion]:
    """Return jobs of a few records each, of one pipeline file."""
    by_file: dict[Path, list[BenchRecord]] = {}
    for record in records:
        by_file.setdefault(record.plan.path, []).append(record)
    return [
        Portion(f"{part[0].scene} {part[0].plan.path.stem} {part[0].number}", part[0].plan, folder, measure, part)
        for of_file in by_file.values()
        for part in _parts(of_file)
    ]


def _parts(records: Sequence[BenchRecord]) -> Iterator[tuple[BenchRecord, ...]]:
    remaining = iter(records)
    while part := tuple(islice(remaining, _PORTION)):
        yield part


def measure(job: Job) -> RunAnswer:
    """Return the rows of every record of a portion; one that cannot be read has one row with the reason."""
    assert isinstance(job, Portion)
    rows = [row for record in job.records for row in _rows(record)]
    return RunAnswer(Result(job.folder, {}, {}, {}, (), {}, None), rows)


def _rows(record: BenchRecord) -> list[Row]:
    file, scene, number = record.key
    try:
        pipeline = record.plan.pipeline()
        settings = pipeline.tables.get("bench")
        rows = record_rows(pipeline, number, getattr(settings, "measure", VALUES))
    except PalpateError as error:
        rows = [{"scene": scene, "record": number, "track": "", "reason": str(error)}]
    return [{"file": file, **row} for row in rows]
