"""Groups of values of one parameter: of runs, or of curves by a column of ``curves.csv``, and their comparison."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from palpate import ConfigurationError, LogError, UserError, suggest
from palpate_engine import ConsentError, verdict_word
from palpate_kit.curves.fit_folder import FitFolder, is_fit_folder
from palpate_kit.curves.replication_unit import NO_GROUP, Cells, replication_unit, unit_of
from palpate_kit.numerics.group_comparison import CURVE, RUN, GroupComparison, compare_groups
from palpate_kit.runs.run_groups import natural

from palpate_studies.log_estimates import LogRuns
from palpate_studies.parameter_values import ParameterValue, readings, report_left_out


@dataclass
class ValueGroup:
    """The values of a parameter in the runs or curves of a group."""

    name: str
    unit: str = ""
    readings: list[ParameterValue] = field(default_factory=list)  # that may enter statistics
    cells: list[Cells] = field(default_factory=list)  # of each curve, by column of ``curves.csv``
    skipped: int = 0  # readings without a value, or with one that cannot be used
    verdicts: Counter[str] = field(default_factory=Counter)  # of all readings that were not rejected
    rejected: dict[str, str] = field(default_factory=dict)  # by run: the reason
    failures: dict[str, UserError] = field(default_factory=dict)  # by path

    def read(self, path: Path, log_runs: LogRuns, track: str | None, parameter: str, where: str | None = None) -> None:
        """Add the readings of a file; one that cannot be read is left out. Raises ConsentError."""
        try:
            file_readings = list(readings(log_runs.run_of(path), track, parameter, where=where))
        except ConsentError:
            raise
        except UserError as error:
            self.failures[str(path)] = error.with_traceback(None)  # a traceback holds the contents of the file
            return
        for reading in file_readings:
            self.add(reading)

    def add(self, reading: ParameterValue) -> None:
        """Add one reading: to those of statistics, to the rejected or to the skipped ones."""
        self.unit = reading.unit
        if reading.groups:
            self.cells.append(reading.groups)
        if reading.rejected is not None:
            self.rejected[reading.name] = reading.rejected
            return
        self.verdicts["without a value" if reading.value is None else verdict_word(reading.verdict)] += 1
        if reading.usable:
            self.readings.append(reading)
        else:
            self.skipped += 1

    @property
    def values(self) -> list[float]:
        """The values [SI]."""
        return [reading.value for reading in self.readings if reading.value is not None]

    @property
    def common(self) -> list[float]:
        """The standard uncertainties [SI] that runs have in common, of those that state them."""
        return [reading.systematic for reading in self.readings if reading.systematic is not None]

    def demand_values(self, parameter: str) -> None:
        """Report the files that are left out; if no run has a value, raise the error of the first file, or LogError."""
        report_left_out(self.failures, has_values=bool(self.readings))
        if not self.readings:
            raise LogError(f"group {self.name}: no run has a value of {parameter}")


def read_groups(
    files: Mapping[str, Sequence[Path]], track: str | None, parameter: str, where: str | None
) -> dict[str, ValueGroup]:
    """Return the values of a parameter in the files of each group; raises UserError for a group without a value."""
    log_runs = LogRuns()
    groups = {name: ValueGroup(name) for name in files}
    for name, paths in files.items():
        for path in paths:
            groups[name].read(path, log_runs, track, parameter, where)
        groups[name].demand_values(parameter)
    return groups


def groups_by_column(
    paths: Iterable[Path], column: str, track: str | None, parameter: str, where: str | None
) -> dict[str, ValueGroup]:
    """Return the curves of folders in groups by a column of curves.csv; raises UserError for one without a value."""
    groups: dict[str, ValueGroup] = {}
    for path in paths:
        if not is_fit_folder(path):
            raise ConfigurationError(f"--by {column}: {path} is not a folder of fits of many curves")
        columns = FitFolder(path).columns
        if column not in columns:
            raise ConfigurationError(
                f"--by {column}: {path / 'curves.csv'} has no such column{suggest(column, columns)}"
            )
        for reading in readings(path, track, parameter, where=where):
            name = reading.groups.get(column) or NO_GROUP
            groups.setdefault(name, ValueGroup(name)).add(reading)
    for group in groups.values():
        group.demand_values(parameter)
    if not groups:
        raise ConfigurationError(f"--where {where!r}: holds of no curve")
    return groups


def compare(groups: Mapping[str, ValueGroup], unit: str | None, mixed: bool) -> GroupComparison:
    """Return the groups in the natural order of their names, compared by units of replication, a column of curves.csv.

    Raises ConfigurationError for an unknown unit, and for a mixed model that cannot be fitted.
    """
    ordered = {name: groups[name] for name in sorted(groups, key=natural)}
    if not any(group.cells for group in ordered.values()):
        if unit not in (None, RUN, CURVE):
            raise ConfigurationError(f"--unit {unit}: only curves of a folder of fits have columns, in its curves.csv")
        column = RUN
    else:
        column = replication_unit({name: group.cells for name, group in ordered.items()}, unit)
    unit_values: dict[str, list[tuple[str, float]]] = {}  # by group: the unit and the value of each reading
    for name, group in ordered.items():
        unit_values[name] = []
        for reading in group.readings:
            if reading.value is not None:
                unit_name = reading.name if column == RUN else unit_of(reading.name, reading.groups, column)
                unit_values[name].append((unit_name, reading.value))
    return compare_groups(unit_values, column, mixed)
