"""Groups of values of one parameter: of runs, or of curves by a column of ``curves.csv``, and what compares them."""

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
from palpate_studies.parameter_values import ParameterValue, readings, tell_left_out


@dataclass
class ValueGroup:
    """What the runs or curves of a group say of a parameter."""

    name: str
    unit: str = ""
    readings: list[ParameterValue] = field(default_factory=list)  # those that may enter statistics
    cells: list[Cells] = field(default_factory=list)  # of all curves, by column of ``curves.csv``
    skipped: int = 0
    words: Counter[str] = field(default_factory=Counter)  # verdicts of all values that were not rejected
    rejected: dict[str, str] = field(default_factory=dict)  # by run: why
    failures: dict[str, UserError] = field(default_factory=dict)  # by path

    def read(self, path: Path, estimated: LogRuns, track: str | None, parameter: str, where: str | None = None) -> None:
        """Take in the readings of a file; one that cannot be read is left out. Raises ConsentError."""
        try:
            of_file = list(readings(estimated.run_of(path), track, parameter, where=where))
        except ConsentError:
            raise
        except UserError as error:
            self.failures[str(path)] = error.with_traceback(None)  # which holds the file's contents
            return
        for reading in of_file:
            self.take(reading)

    def take(self, reading: ParameterValue) -> None:
        """Take in one reading."""
        self.unit = reading.unit
        self.cells += [reading.groups] if reading.groups else []
        if reading.rejected is not None:
            self.rejected[reading.name] = reading.rejected
            return
        self.words["without a value" if reading.value is None else verdict_word(reading.verdict)] += 1
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
        """Standard uncertainties [SI] that the runs share, of those that state them."""
        return [reading.systematic for reading in self.readings if reading.systematic is not None]

    def demand_values(self, parameter: str) -> None:
        """Say which runs are left out; raises what the first failed with, or LogError, where no run has a value."""
        tell_left_out(self.failures, others=bool(self.readings))
        if not self.readings:
            raise LogError(f"group {self.name}: no run has a value of {parameter}")


def read_groups(
    files: Mapping[str, Sequence[Path]], track: str | None, parameter: str, where: str | None
) -> dict[str, ValueGroup]:
    """What the files of each group say of a parameter; raises UserError where a group says nothing."""
    estimated = LogRuns()
    groups = {name: ValueGroup(name) for name in files}
    for name, paths in files.items():
        for path in paths:
            groups[name].read(path, estimated, track, parameter, where)
        groups[name].demand_values(parameter)
    return groups


def groups_by_column(
    paths: Iterable[Path], by: str, track: str | None, parameter: str, where: str | None
) -> dict[str, ValueGroup]:
    """Curves of folders in groups by a column of curves.csv; raises UserError where a group says nothing."""
    groups: dict[str, ValueGroup] = {}
    for path in paths:
        if not is_fit_folder(path):
            raise ConfigurationError(f"--by {by}: {path} is not a folder of fits of many curves")
        columns = FitFolder(path).columns
        if by not in columns:
            raise ConfigurationError(f"--by {by}: {path / 'curves.csv'} has no such column{suggest(by, columns)}")
        for reading in readings(path, track, parameter, where=where):
            name = reading.groups.get(by) or NO_GROUP
            groups.setdefault(name, ValueGroup(name)).take(reading)
    for group in groups.values():
        group.demand_values(parameter)
    if not groups:
        raise ConfigurationError(f"--where {where!r}: holds of no curve")
    return groups


def compare(groups: Mapping[str, ValueGroup], unit: str | None, mixed: bool) -> GroupComparison:
    """Return the groups in the order of their names, compared by units of replication.

    Raises ConfigurationError for an unknown unit, and for a mixed model that cannot be fitted.
    """
    ordered = {name: groups[name] for name in sorted(groups, key=natural)}
    if not any(group.cells for group in ordered.values()):
        if unit not in (None, RUN, CURVE):
            raise ConfigurationError(f"--unit {unit}: only curves of a folder of fits have columns, in its curves.csv")
        chosen = RUN
    else:
        chosen = replication_unit({name: group.cells for name, group in ordered.items()}, unit)
    values = {
        name: [
            (reading.name if chosen == RUN else unit_of(reading.name, reading.groups, chosen), reading.value)
            for reading in group.readings
            if reading.value is not None
        ]
        for name, group in ordered.items()
    }
    return compare_groups(values, chosen, mixed)
