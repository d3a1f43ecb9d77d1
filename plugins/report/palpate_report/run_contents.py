"""Contents of a run folder, complete or not: the one source of report and pictures."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from palpate import BudgetRow, Condition, Effect, FitReport, LogError, Unknown
from palpate_engine import (
    DerivedValue,
    Result,
    RunSettings,
    TrackComparison,
    TrackName,
    TrackResult,
    UncertainValue,
    registry,
    toml_tables,
)
from palpate_kit.runs.result_file import estimate_of, read_flags
from palpate_kit.runs.run_folder import EstimatesTable, RunFolder, TrackTable

_Kind = TypeVar("_Kind")
_UNNAMED = RunSettings.model_fields["name"].default
_SIGNS = ("result.json", "pipeline.toml", "estimates.csv", "estimates.parquet", "estimates.arrows")
_WHY_NOT = {
    False: "No result.json: the run was killed, lost power, or is still going on.",
    True: "The result.json is incomplete: the run ended while it was being written.",
}


@dataclass(frozen=True)
class RunContents:
    """A run folder as far as it can be read."""

    folder: RunFolder

    @classmethod
    def read(cls, path: Path) -> RunContents:
        """Return the folder of a run, or of its result.json; raises LogError for anything else."""
        folder = path.parent if path.name == "result.json" else path
        if not folder.is_dir() or not (RunFolder(folder).began or any((folder / name).is_file() for name in _SIGNS)):
            raise LogError(f"{path}: is not a run folder: it has none of {', '.join(_SIGNS)}")
        record = cls(RunFolder(folder))
        record.document  # noqa: B018  (a result of a newer palpate is refused here)
        return record

    @property
    def path(self) -> Path:
        """The folder."""
        return self.folder.path

    @cached_property
    def document(self) -> Mapping[str, Any]:
        """The contents of ``result.json``; empty without a whole one."""
        return self.folder.result if self._finished else {}

    @property
    def why_not(self) -> str | None:
        """Reason why a run has no result; None if it has one."""
        return None if self._finished else _WHY_NOT[(self.path / "result.json").exists()]

    @cached_property
    def _finished(self) -> bool:
        return self.folder.finished

    @property
    def name(self) -> str:
        """Name of the run; its folder where nobody has named it."""
        named = self.document.get("run", {}).get("name") or self.resolved.get("run", {}).get("name")
        return str(self.path.resolve().name if named in (None, "", _UNNAMED) else named)

    @property
    def given_text(self) -> str | None:
        """The pipeline as given."""
        return _text(self.folder.given)

    @property
    def resolved_text(self) -> str | None:
        """The pipeline as run."""
        return _text(self.folder.pipeline) if self.folder.began else None

    @property
    def resolved(self) -> Mapping[str, Any]:
        """The tables of the pipeline as run; empty where it cannot be read."""
        return self._resolved

    @cached_property
    def _resolved(self) -> Mapping[str, Any]:
        try:
            return toml_tables(self.resolved_text or "")
        except tomllib.TOMLDecodeError:
            return {}

    @property
    def tip_mass(self) -> float:
        """Mass of the tip [kg] whose inertia is in the force; 0 where none is declared."""
        mass = self.resolved.get("alignment", {}).get("tip_mass")
        return float(mass) if isinstance(mass, int | float) else 0.0

    @cached_property
    def _read_tables(self) -> tuple[list[EstimatesTable], str | None]:
        try:
            return self.folder.tables, None
        except LogError as error:
            return [], str(error)

    @property
    def unreadable(self) -> str | None:
        """The error by which the tables of estimates could not be read; None if they were read."""
        return self._read_tables[1]

    @property
    def tables(self) -> list[EstimatesTable]:
        """The tables of estimates, those made afterwards first; none where they cannot be read."""
        return self._read_tables[0]

    @cached_property
    def tracks(self) -> dict[str, tuple[EstimatesTable, TrackTable]]:
        """Each track's estimates with the table they stand in, by name: in the order of the result."""
        tables: dict[str, tuple[EstimatesTable, TrackTable]] = {}
        for table in self.tables:
            tables |= {
                name: (table, table.track(name)) for name in table.tracks if name not in tables and len(table.numbers)
            }
        order = list(self.document.get("tracks", {}))
        return dict(sorted(tables.items(), key=lambda item: order.index(item[0]) if item[0] in order else len(order)))

    def unit(self, track: str, parameter: str) -> str:
        """SI unit of a track's parameter: by the result, or by its model without a result; nothing if unknown."""
        value = self.document.get("tracks", {}).get(track, {}).get("parameters", {}).get(parameter)
        if value:
            return str(value["unit"])
        table = self.resolved.get("model", {}).get(TrackName.parse(track).model, {})
        entry = registry.load().parts["model"].get(table.get("type", ""))
        units = {parameter_type.name: parameter_type.unit for parameter_type in entry.part.parameters} if entry else {}  # type: ignore[attr-defined]
        return str(units.get(parameter, ""))

    @property
    def logs(self) -> list[str]:
        """Names of logs in the folder, from which it can be replayed."""
        return sorted(file.name for file in self.path.glob("*.mcap"))

    def result(self) -> Result:
        """Return the result as sections of a report take it; raises LogError if it is missing."""
        document = self.folder.result
        tracks = {name: _track(table) for name, table in document["tracks"].items()}
        run, streams, truth = document["run"], document["streams"], document["truth"]
        return Result(self.path, run, streams, tracks, (), truth, None, document=document)


def _text(path: Path) -> str | None:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None


def _nan(value: Any) -> float:
    return float("nan") if value is None else float(value)


def _value(table: Mapping[str, Any]) -> UncertainValue:
    """Return a value with its uncertainties from its table in ``result.json``; unknown numbers are NaN."""
    budget = {key.removeprefix("systematic_"): _nan(v) for key, v in table.items() if key.startswith("systematic_")}
    return UncertainValue(
        value=_nan(estimate_of(table)),
        std=_nan(table["std"]),
        unit=table["unit"],
        settling=_nan(table["settling"]),
        systematic=table.get("systematic"),
        budget=budget,
        per_shear=table.get("equivalent_delay"),
        unknown=table["combined"] is None,
        places=table.get("places", {}),
        last=table.get("last", {}),
        verdict=table.get("verdict"),
    )


def _object(kind: type[_Kind], table: Mapping[str, Any], **others: Any) -> _Kind:
    """Return an object of a table's keys and of others; keys of a later version are left alone."""
    return kind(**{field.name: table[field.name] for field in fields(kind) if field.name in table} | others)  # type: ignore[arg-type]


def _rows(rows: Any) -> tuple[BudgetRow, ...]:
    effects = ({name: _object(Effect, effect) for name, effect in row["effects"].items()} for row in rows)
    return tuple(_object(BudgetRow, row, effects=of_row) for row, of_row in zip(rows, effects, strict=True))


def _report(table: Mapping[str, Any]) -> FitReport:
    unknowns = {
        name: _object(Unknown, unknown, interval=unknown["interval"] and tuple(unknown["interval"]))
        for name, unknown in table["unknowns"].items()
    }
    pairs = {(pair["first"], pair["second"]): pair["value"] for pair in table["correlations"]}
    others = {"rss": _nan(table["rss"]), "budget": _rows(table["budget"]), "correlations": pairs}
    return _object(FitReport, table, unknowns=unknowns, **others)


def _track(table: Mapping[str, Any]) -> TrackResult:
    """Return the result of a track from its table in ``result.json``."""
    others = {
        "parameters": {name: _value(value) for name, value in table["parameters"].items()},
        "surface": _value(table["surface"]),
        "derived": tuple(
            DerivedValue(name, _value(value), value["caveat"]) for name, value in table["derived"].items()
        ),
        "flags": read_flags(table["flags"]),
        "immaterial": read_flags(table.get("immaterial", ())),
        "conditions": tuple(map(Condition.of_table, table["conditions"])),
        "budget": _rows(table["budget"]),
        "report": _report(table["fit"]) if "fit" in table else None,
        "comparison": TrackComparison.of_table(table["comparison"]) if "comparison" in table else None,
    }
    numbers = {name: _nan(table[name]) for name in ("force_rms", "nis", "seconds_per_sample")}
    return _object(TrackResult, table, **numbers, **others)
