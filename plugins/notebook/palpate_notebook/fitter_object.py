"""Fits that are prepared once, for any number of records."""

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
_RECORD_KEYS = ("file", "sha256")  # keys of a device that identify a record; the others state how it is read


def facts_in(rig: Rig) -> RigFacts:
    """Return the facts of a file, or of a mapping of its keys; for None no facts. Raises ConfigurationError."""
    if rig is None:
        return RigFacts()
    if not isinstance(rig, Mapping):
        return read_rig(Path(rig))
    try:
        return facts_of(rig)
    except ConfigurationError as error:
        # The message names options of the command line: name the keys in their place.
        message = str(error)
        for key in RigFacts.model_fields:
            message = message.replace(f"{option_of(key)}:", f'rig["{key}"]:')
        raise ConfigurationError(message) from error


class RecordEstimator:
    """Models and estimators for any number of records; records that are read alike share one pipeline."""

    def __init__(
        self,
        models: Sequence[str | ContactModel],
        estimators: Sequence[str | Estimator],
        tip: Tip,
        uncertainties: Mapping[str, str | float] | None,
        rig: Rig = None,
    ) -> None:
        """Prepare the tables that all records share; the arguments are those of `fit`. Raises ConfigurationError."""
        for argument, parts in (("models", models), ("estimators", estimators)):
            if isinstance(parts, str) or not parts:
                raise ConfigurationError(f'{argument}: must be a list of parts or of their names, such as ["dr"]')
        self._models = tuple(models)
        self._rig = rig
        self._tip = tip
        self._facts = facts_in(rig)
        if tip is None:
            self._tip = self._facts.tip
        else:  # the argument takes precedence over the facts
            self._facts = self._facts.model_copy(update={"tip": None})
        self._uncertainties = dict(uncertainties or {})
        parts_registry = registry.load()
        # With a tip: if neither argument nor facts state one, that of the record is expected.
        self._model_tables = part_tables(models, "model", parts_registry, with_tip=True)
        self._estimator_tables = part_tables(estimators, "estimator", parts_registry, with_tip=False)
        self._latest: _SharedTracks | None = None

    def pipeline(self, record: Record, name: str | None = None) -> Pipeline:
        """Return the pipeline of a record; raises ConfigurationError with every mistake at once."""
        source = source_of(record.name, record.path, self._tables(record, name))
        for assignment in self._assignments(record):
            source.override(assignment)
        return build_pipeline(source)

    def estimate(self, record: Record, name: str | None = None) -> FinishedRun:
        """Return the run of a record; raises ConfigurationError, and LogError where it cannot be read."""
        if not isinstance(record, Record):
            remedy = "palpate.read(path) makes one of a file, palpate.record(...) of arrays"
            raise ConfigurationError(f"a {type(record).__name__} is not a record: {remedy}")
        tracks = self._tracks(record, name)
        pipeline = tracks.pipeline
        devices = _devices_of_record(pipeline.devices, record)
        text = self._pipeline_text(pipeline, devices, record, name)
        for notice in pipeline.notices:
            warnings.warn(notice, stacklevel=4)
        with quietly():
            outcome = tracks.estimate(devices, name=name or record.name, text=text)
        return finished_run(FinishedRun, outcome, record)

    def _pipeline_text(
        self, pipeline: Pipeline, devices: Mapping[str, Device], record: Record, name: str | None
    ) -> str:
        """Return the text of the pipeline for the run: its tables, resolved if files next to the record add facts."""
        if not self._fact_assignments(record):
            return tomli_w.dumps(self._tables(record, name))
        run = pipeline.run.model_copy(update={"name": name or record.name})
        return resolved_text(replace(pipeline, devices=devices, run=run))

    def _tables(self, record: Record, name: str | None) -> dict[str, Any]:
        """Return the tables of the pipeline of a record."""
        run = {
            "name": name or record.name,
            "uncertainties": self._uncertainties,
            "assumed": list(record.assumed),
        }
        tables = {"run": run, "device": dict(record.devices), "alignment": dict(record.alignment)}
        if self._rig is not None:
            # Facts of the record's row of curves.csv take precedence over those of a file.
            listed_keys: frozenset[str] = frozenset()
            if record.facts is not None and not self._is_mapping:
                listed_keys = record.facts.of_curve_list
            tables["rig"] = {key: fact for key, fact in plain_facts(self._facts).items() if key not in listed_keys}
            if self._facts.measured and isinstance(self._rig, str | Path):
                run["calibration"] = str(Path(self._rig).absolute())
        return {**tables, **self._part_tables(record)}

    def _part_tables(self, record: Record) -> dict[str, Any]:
        """Return the tables of tip, models and estimators; raises ConfigurationError where nothing states a tip."""
        parts_registry = registry.load()
        tip = self._tip_for(record)
        if tip is None:
            models = part_tables(self._models, "model", parts_registry, with_tip=False)
            return {"model": models, "estimator": self._estimator_tables}
        return {
            "indenter": {"tip": _tip_table(tip, parts_registry)},
            "model": self._model_tables,
            "estimator": self._estimator_tables,
        }

    def _tip_for(self, record: Record) -> Tip:
        """Return the tip for a record: of the arguments, else of its row of curves.csv, of `rig`, or next to it."""
        if record.facts is None:
            return self._tip
        is_listed = "tip" in record.facts.of_curve_list
        is_of_rig = self._tip == self._facts.tip
        return record.facts.facts.tip if self._tip is None or (is_listed and is_of_rig) else self._tip

    @property
    def _is_mapping(self) -> bool:
        """True if `rig` is a mapping, which adds to the file next to the record, where a file replaces it."""
        return isinstance(self._rig, Mapping)

    def _fact_assignments(self, record: Record) -> list[str]:
        """Return the facts of files next to a record that no argument states, as ``--set``."""
        facts = record.facts
        if facts is None:
            return []
        if self._rig is not None and not self._is_mapping:
            facts = facts.without(RigFacts.model_fields.keys() - facts.of_curve_list)
        # The facts that settings of the models and uncertainties state.
        settings = []
        for label, part in zip(self._model_tables, self._models, strict=True):
            if isinstance(part, Part):
                settings += [f"model.{label}.{key}" for key in part.model_fields_set]
        settings += [f"run.uncertainties.{key}" for key in self._uncertainties]
        tables = {"alignment": dict(record.alignment), "model": self._model_tables}
        stated = facts_set(facts.facts, [f"{key}=0" for key in settings], tables, registry.load())
        options = plain_facts(self._facts).keys() if self._is_mapping else ()
        return list(facts.without({*stated, *options, "tip"}).overrides)

    def _assignments(self, record: Record) -> list[str]:
        """Return the facts of files next to a record, then the uncertainties that override them, as ``--set``."""
        facts = self._fact_assignments(record)
        uncertainties = [f"run.uncertainties.{key}={json.dumps(u)}" for key, u in self._uncertainties.items()]
        return [*facts, *uncertainties] if facts else []

    def _tracks(self, record: Record, name: str | None) -> RecordTracks:
        """Return the tracks of records that are read like this one; those of the latest call are kept."""
        reading_settings = {}
        for device_name, table in record.devices.items():
            reading_settings[device_name] = {key: entry for key, entry in table.items() if key not in _RECORD_KEYS}
        facts = self._assignments(record), self._part_tables(record).get("indenter")
        key = json.dumps(
            [reading_settings, dict(record.alignment), record.assumed, str(record.path.parent), facts], default=repr
        )
        latest = self._latest
        if latest is not None and latest.key == key:
            # Files with the same settings may still have other channels.
            devices = _devices_of_record(latest.tracks.pipeline.devices, record)
            if latest.streams == _streams(devices):
                return latest.tracks
        pipeline = self.pipeline(record, name)
        self._latest = _SharedTracks(key, _streams(pipeline.devices), RecordTracks(pipeline))
        return self._latest.tracks


def _tip_table(tip: Tip, parts_registry: Registry) -> dict[str, Any]:
    """Return the table of a tip that is stated in any of its forms; raises ConfigurationError."""
    if isinstance(tip, str):
        return tip_table(tip, parts_registry)
    return dict(tip) if isinstance(tip, Mapping) else table_of(tip, "tip", "indenter", parts_registry)


@dataclass(frozen=True)
class _SharedTracks:
    """Tracks of records that are read alike."""

    key: str  # JSON of settings and declarations that the records share
    streams: list[tuple[Stream, ...]]  # of each device
    tracks: RecordTracks


def _streams(devices: Mapping[str, Device]) -> list[tuple[Stream, ...]]:
    """Return the streams of each device."""
    return [device.streams for device in devices.values()]


def _devices_of_record(devices: Mapping[str, Device], record: Record) -> dict[str, Device]:
    """Return the devices of a pipeline, each reading the file or memory of a record."""
    record_devices = {}
    for name, table in record.devices.items():
        identity = {key: Path(table[key]) if key == "file" else table[key] for key in _RECORD_KEYS if key in table}
        record_devices[name] = devices[name].model_copy(update=identity)
    return record_devices


class Fitter:
    """Fit that is prepared once: the same tip, model and estimator for any number of records."""

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
        """Yield the fit of each record in their order, or the error of a record that is refused.

        `progress` gets the number of records that are done; once `cancelled` returns True, no other record is begun.
        """
        for count, record in enumerate(records, start=1):
            if cancelled is not None and cancelled():
                return
            outcome: Fit | PalpateError
            try:
                outcome = self.fit(record)
            except PalpateError as error:
                outcome = error
            yield outcome
            if progress is not None:
                progress(count)
