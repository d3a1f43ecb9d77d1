"""The chart of a rig's checks: a small text file in TOML, SI inside, to which checks are appended."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

from palpate import ConfigurationError, Settings
from palpate_engine import bounded_text, write_whole
from palpate_kit.runs.toml_file import read_settings
from pydantic import Field

from palpate_control.control_limits import CheckState, CheckValue, check_states

_FORMAT = 1  # of the file
_HEAD = (
    "# Control chart: checks of a rig on a reference, in SI units. `palpate calibrate control RUN` appends a check.\n"
)


class ChartReference(Settings):
    """The reference specimen or spring that is palpated in every check of a chart."""

    name: str = Field(min_length=1, description="what it is")
    value: float = Field(gt=0, allow_inf_nan=False, description="in its unit")
    unit: str = Field(description="SI")
    std: float = Field(gt=0, allow_inf_nan=False, description="standard uncertainty")


class RecordedCheck(Settings):
    """One check, as in the file."""

    date: datetime = Field(description="when its run started, with time zone")
    run: str = Field(description="the run folder")
    digest: str = Field(description="SHA-256 of the run's result.json")
    value: float = Field(allow_inf_nan=False, description="in the reference's unit")
    std: float = Field(gt=0, allow_inf_nan=False, description="combined standard uncertainty")
    repeat_std: float = Field(ge=0, allow_inf_nan=False, description="of it, what differs from check to check")


class ControlChart(Settings):
    """The checks of one robot with one sensor and tip on one reference."""

    format: int = Field(default=_FORMAT, ge=1, le=_FORMAT, description="version of this format")
    quantity: str = Field(description="the value that is compared: elasticity, stiffness, ...")
    track: str = Field(description="model and estimator of every check")
    reference: ChartReference
    tip: dict[str, Any] = Field(default={}, description="type and numbers of the tip; none for a spring without one")
    sensor: dict[str, str] = Field(default={}, description="what identifies the device of the force")
    robot: dict[str, str] = Field(default={}, description="what identifies the device of the position")
    check: tuple[RecordedCheck, ...] = Field(default=(), description="the checks, the oldest first")

    @property
    def states(self) -> list[CheckState]:
        """State of every check."""
        readings = [CheckValue(check.value, check.std, check.repeat_std) for check in self.check]
        return check_states(readings, self.reference.value, self.reference.std)


def read_chart(path: Path) -> ControlChart:
    """Return the chart in a file; raises ConfigurationError where it cannot be read, is damaged, or is not a chart."""
    chart = read_settings(path, ControlChart, "control chart")
    for number, check in enumerate(chart.check, 1):
        if check.date.tzinfo is None:
            raise ConfigurationError(f"{path}: is not a control chart: check {number}: date has no time zone")
    for number, (before, after) in enumerate(pairwise(chart.check), 2):
        if after.date < before.date:
            raise ConfigurationError(f"{path}: is a damaged control chart: check {number} is older than the one before")
    return chart


def append_check(path: Path, chart: ControlChart, check: RecordedCheck) -> ControlChart:
    """Append a check to the file, as a whole or not at all; return the chart with it. The text before it stays.

    `chart` is used for a new file. Raises ConfigurationError for a check that is in the chart already, or
    is older than its last, OutputError where it cannot be written.
    """
    with _locked(path.parent):
        text = bounded_text(path) if path.exists() else _head(chart)
        chart = read_chart(path) if path.exists() else chart
        for number, earlier_check in enumerate(chart.check, 1):
            if earlier_check.digest == check.digest:
                raise ConfigurationError(f"{check.run}: is check {number} of {path} already")
        if chart.check and check.date < chart.check[-1].date:
            last = chart.check[-1].date
            raise ConfigurationError(f"{check.run}: of {check.date} is older than the last check of {path}, of {last}")
        write_whole(path, f"{text.rstrip()}\n\n{_block(check)}")
    return chart.model_copy(update={"check": (*chart.check, check)})


def _head(chart: ControlChart) -> str:
    import tomli_w

    return _HEAD + tomli_w.dumps(chart.model_dump(mode="python", exclude={"check"}))


def _block(check: RecordedCheck) -> str:
    import tomli_w

    return f"[[check]]\n{tomli_w.dumps(check.model_dump(mode='python'))}"


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Keep other processes from appending in a folder, so that no check is lost; raises ConfigurationError."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise ConfigurationError(f"{folder}: no such folder: {error.strerror}") from error
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)
