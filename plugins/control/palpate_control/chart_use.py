"""A control chart that a pipeline names: the latest check before a run, and the doubts about it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from palpate import ConfigurationError, Flag
from palpate_engine import Pipeline, is_same_tip, plain_settings
from palpate_kit.runs.device_identity import other_identity

from palpate_control.chart_file import ControlChart, read_chart
from palpate_control.control_limits import CheckState


@dataclass(frozen=True)
class ChartUse:
    """A chart with at least one check."""

    path: Path
    chart: ControlChart
    state: CheckState  # of the last check
    valid_for: float  # [s]

    def facts(self, started: datetime) -> dict[str, Any]:
        """Return the last check, for ``run.control`` of result.json."""
        last = self.chart.check[-1]
        age = (started - last.date).total_seconds()
        return {
            "file": str(self.path),
            "reference": self.chart.reference.name,
            "date": last.date.isoformat(),
            "age": age,
            "old": age > self.valid_for,
            "checks": len(self.chart.check),
            "e_n": self.state.e_n,
            "in_control": self.state.in_control,
            "reasons": list(self.state.reasons),
        }

    def flags(self, pipeline: Pipeline, live: Mapping[str, Mapping[str, Any]]) -> Iterator[Flag]:
        """Yield a flag if the check is out of control, or was made with another tip, sensor or robot."""
        doubts = list(self.state.reasons)
        tips = [plain_settings(tip, pipeline.registry) for tip in pipeline.indenters.values()]
        if self.chart.tip and tips and not any(is_same_tip(self.chart.tip, tip, pipeline.registry) for tip in tips):
            doubts.append(f"the check was made with another tip: {settings_text(self.chart.tip)}")
        # The chart has what identified both devices; a device of this run has it by its settings, or reported it.
        signals = {"sensor": pipeline.alignment.force, "robot": pipeline.alignment.position}
        for role, signal in signals.items():
            name, checked_identity = signal.channel.partition(".")[0], getattr(self.chart, role)
            device = pipeline.devices.get(name)
            identity = {**(device.provenance if device is not None else {}), **live.get(name, {})}
            if (key := other_identity(checked_identity, identity)) is not None:
                change = f"{key.replace('_', ' ')} {checked_identity[key]}, now {identity[key]}"
                doubts.append(f"the check was made with another {role}: {change}")
        if doubts:
            yield Flag(
                "out-of-control", f"{self.path}, check of {self.chart.check[-1].date:%Y-%m-%d}: {'; '.join(doubts)}"
            )


def chart_use(path: Path, valid_for: float) -> ChartUse:
    """Return the chart in a file, whose last check is called old after `valid_for` [s]; raises ConfigurationError."""
    chart = read_chart(path)
    if not chart.check:
        raise ConfigurationError(f"{path}: holds no check yet")
    return ChartUse(path, chart, chart.states[-1], valid_for)


def settings_text(table: Mapping[str, Any]) -> str:
    """Return settings in a line.

    >>> settings_text({"type": "sphere", "radius": 0.005})
    'type sphere, radius 0.005'
    """
    return ", ".join(f"{key} {value}" for key, value in table.items()) or "none"
