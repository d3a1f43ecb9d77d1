"""A fit that is prepared once, for any number of records."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tomli_w
from palpate import ConfigurationError, ContactModel, Device, Estimator, Indenter, PalpateError, Part, Stream
from palpate_engine import (
    Pipeline,
    RecordTracks,
    Registry,
    RigFacts,
    build_pipeline,
    facts_of,
    facts_set,
    option_of,
    plain_facts,
    read_rig,
    registry,
    resolved_text,
    tip_table,
)

from palpate_notebook.fit_object import Fit
from palpate_notebook.part_tables import part_tables, source_of, table_of
from palpate_notebook.record_object import Record
from palpate_notebook.run_data import finished_run
from palpate_notebook.run_functions import quietly
from palpate_notebook.run_object import FinishedRun

Rig = str | Path | Mapping[str, Any] | None
Tip = Indenter | str | Mapping[str, Any] | None  # a part, words, or a table of a pipeline
_NAMES = ("file", "sha256")  # keys of a device that name a record; all others say how it is read


def facts_in(rig: Rig) -> RigFacts:
    """Return the facts in a file, or of its keys; none of None. Raises ConfigurationError."""
    if rig is None:
        return RigFacts()
    if not isinstance(rig, Mapping):
        return read_rig(Path(rig))
    try:
        return facts_of(rig)
    except ConfigurationError as error:  # which names options of the command line
        words = str(error)
        for key in RigFacts.model_fields:
            words = words.replace(f"{option_of(key)}:", f'rig["{key}"]:')
        raise ConfigurationError(words) from error


class RecordEstimator:
    """Models and estimators for any number of records; those that are read alike share one pipeline."""

    def __init__(
        self,
        models: Sequence[str | ContactModel],
        estimators: Sequence[str | Estimator],
        tip: Tip,
        uncertainties: Mapping[str, str | float] | None,
        rig: Rig = None,
    ) -> None:
        for part, kind in ((models, "models"), (estimators, "estimators")):
            if isinstance(part, str) or not part:
                raise ConfigurationError(f'{kind}: must be a list of parts or of their names, such as ["dr"]')
        self._models, self._rig, self._tip = tuple(models), rig, tip
        self._facts = facts_in(rig)
        if tip is None:
            self._tip = self._facts.tip
        else:  # it goes before that of the file
            self._facts = self._facts.model_copy(update={"tip": None})
        self._uncertainties = dict(uncertainties or {})
        known = registry.load()
        # Without a tip here, that of the record is expected.
        self._model_tables = part_tables(models, "model", known, True)
        self._estimator_tables = part_tables(estimators, "estimator", known, False)
        self._latest: _KindOfRecord | None = None

    def pipeline(self, record: Record, name: str | None = None) -> Pipeline:
        """Return the pipeline of a record; raises ConfigurationError with every mistake at once."""
        source = source_of(record.name, record.path, self._tables(record, name))
        for assignment in self._assignments(record):
            source.override(assignment)
        return build_pipeline(source)

    def estimate(self, record: Record, name: str | None = None) -> FinishedRun:
        """What is estimated of a record; raises ConfigurationError, and LogError where it cannot be read."""
        if not isinstance(record, Record):
            made = "palpate.read(path) makes one of a file, palpate.record(...) of arrays"
            raise ConfigurationError(f"a {type(record).__name__} is not a record: {made}")
        tracks = self._tracks(record, name)
        pipeline = tracks.pipeline
        devices = {key: _named_as(pipeline.devices[key], table) for key, table in record.devices.items()}
        text = self._text(pipeline, devices, record, name)
        for notice in pipeline.notices:
            warnings.warn(notice, stacklevel=4)
        with quietly():
            outcome = tracks.estimate(devices, name=name or record.name, text=text)
        return finished_run(FinishedRun, outcome, record)

    def _text(self, pipeline: Pipeline, devices: Mapping[str, Device], record: Record, name: str | None) -> str:
        """Return the pipeline as it is given; with the facts next to the record, as it is resolved."""
        if not self._facts_beside(record):
            return tomli_w.dumps(self._tables(record, name))
        run = pipeline.run.model_copy(update={"name": name or record.name})
        return resolved_text(replace(pipeline, devices=devices, run=run))

    def _tables(self, record: Record, name: str | None) -> dict[str, Any]:
        run = {
            "name": name or record.name,
            "uncertainties": self._uncertainties,
            "assumed": list(record.assumed),
        }
        facts: dict[str, Any] = {}
        if self._rig is not None:
            listed = record.facts.of_curve_list if record.facts is not None and not self._is_mapping else frozenset()
            facts["rig"] = {key: value for key, value in plain_facts(self._facts).items() if key not in listed}
            if self._facts.measured and isinstance(self._rig, str | Path):
                run["calibration"] = str(Path(self._rig).absolute())
        tables = {"run": run, "device": dict(record.devices), "alignment": dict(record.alignment), **facts}
        return {**tables, **self._part_tables(record)}

    def _part_tables(self, record: Record) -> dict[str, Any]:
        """Return the tables of tip, models and estimators; raises ConfigurationError where nothing states a tip."""
        known = registry.load()
        beside = record.facts.facts.tip if record.facts is not None else None
        is_listed = record.facts is not None and "tip" in record.facts.of_curve_list
        tip = beside if self._tip is None or (is_listed and self._tip == self._facts.tip) else self._tip
        if tip is None:
            models = part_tables(self._models, "model", known, False)
            return {"model": models, "estimator": self._estimator_tables}
        return {
            "indenter": {"tip": _tip_table(tip, known)},
            "model": self._model_tables,
            "estimator": self._estimator_tables,
        }

    @property
    def _is_mapping(self) -> bool:
        """The facts of `rig` are options, and not a file in place of that next to the record."""
        return isinstance(self._rig, Mapping)

    def _facts_beside(self, record: Record) -> list[str]:
        """Return the facts next to a record, as ``--set``, but for those that the arguments state."""
        stated = record.facts
        if stated is None:
            return []
        if self._rig is not None and not self._is_mapping:
            stated = stated.without(RigFacts.model_fields.keys() - stated.of_curve_list)
        labelled = zip(self._model_tables, self._models, strict=True)
        keys = [
            f"model.{name}.{key}" for name, part in labelled if isinstance(part, Part) for key in part.model_fields_set
        ]
        keys += [f"run.uncertainties.{key}" for key in self._uncertainties]
        tables = {"alignment": dict(record.alignment), "model": self._model_tables}
        known = facts_set(stated.facts, [f"{key}=0" for key in keys], tables, registry.load())
        options = plain_facts(self._facts).keys() if self._is_mapping else ()
        return list(stated.without({*known, *options, "tip"}).overrides)

    def _assignments(self, record: Record) -> list[str]:
        """Return the facts next to a record and what goes before them, as ``--set``."""
        facts = self._facts_beside(record)
        own = [f"run.uncertainties.{key}={json.dumps(value)}" for key, value in self._uncertainties.items()]
        return [*facts, *own] if facts else []

    def _tracks(self, record: Record, name: str | None) -> RecordTracks:
        """Return the tracks of records that are read like this one; those of the latest kind are kept."""
        ways = {key: {k: v for k, v in table.items() if k not in _NAMES} for key, table in record.devices.items()}
        facts = self._assignments(record), self._part_tables(record).get("indenter")
        kind = json.dumps([ways, dict(record.alignment), record.assumed, str(record.path.parent), facts], default=repr)
        if self._latest is not None and self._latest.kind == kind:
            known = self._latest.tracks.pipeline.devices
            if self._latest.streams == _streams(
                {key: _named_as(known[key], table) for key, table in record.devices.items()}
            ):
                return self._latest.tracks
        pipeline = self.pipeline(record, name)
        self._latest = _KindOfRecord(kind, _streams(pipeline.devices), RecordTracks(pipeline))
        return self._latest.tracks


def _tip_table(tip: Tip, known: Registry) -> dict[str, Any]:
    """Return the table of a tip that is stated in any of its forms; raises ConfigurationError."""
    if isinstance(tip, str):
        return tip_table(tip, known)
    return dict(tip) if isinstance(tip, Mapping) else table_of(tip, "tip", "indenter", known)


@dataclass(frozen=True)
class _KindOfRecord:
    """How records are read that share their tracks."""

    kind: str  # what is declared of them
    streams: list[tuple[Stream, ...]]  # of each device
    tracks: RecordTracks


def _streams(devices: Mapping[str, Device]) -> list[tuple[Stream, ...]]:
    return [device.streams for device in devices.values()]


def _named_as(device: Device, table: Mapping[str, Any]) -> Device:
    """Return the device with the record that a table names."""
    named = {key: Path(table[key]) if key == "file" else table[key] for key in _NAMES if key in table}
    return device.model_copy(update=named)


class Fitter:
    """A fit that is prepared once: the same tip, model and estimator for any number of records."""

    def __init__(self, estimator: RecordEstimator) -> None:
        self._estimator = estimator

    def fit(self, record: Record, *, name: str | None = None) -> Fit:
        """Return the fit of a record, to the same digits as `palpate.fit`.

        Raises ConfigurationError for what does not fit together, LogError for a record that cannot be read.
        """
        return Fit(self._estimator.estimate(record, name))

    def each(
        self,
        records: Iterable[Record],
        *,
        progress: Callable[[int], object] | None = None,
        cancelled: Callable[[], bool] | None = None,
    ) -> Iterator[Fit | PalpateError]:
        """Yield the fit of each record in their order, or the error by which it is refused; the others are fitted.

        `progress` gets how many are done; where `cancelled` answers True, no further record is begun.
        """
        for count, record in enumerate(records, start=1):
            if cancelled is not None and cancelled():
                return
            found: Fit | PalpateError
            try:
                found = self.fit(record)
            except PalpateError as error:
                found = error
            yield found
            if progress is not None:
                progress(count)
