"""The plan of a calibration: devices, channels, motion and tip of a file; it may name models and filters or not."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from palpate import ConfigurationError, Device, Indenter, Trajectory
from palpate_engine import (
    AlignmentSettings,
    Ports,
    Registry,
    RunSettings,
    SafetySettings,
    load_pipeline,
    ports_of,
    refuse_rehearsal,
    wrong_channels,
)

from palpate_calibration.settings import CalibrationSettings


@dataclass(frozen=True, kw_only=True)
class CalibrationPlan:
    """Devices, channels, motion, tip and limits of a calibration, as a file states them."""

    path: Path
    run: RunSettings
    alignment: AlignmentSettings
    settings: CalibrationSettings
    devices: Mapping[str, Device]
    trajectories: Mapping[str, Trajectory]
    indenters: Mapping[str, Indenter]
    safety: SafetySettings | None
    registry: Registry

    @property
    def ports(self) -> Ports:
        """Port of each signal."""
        return self._ports

    @cached_property
    def _ports(self) -> Ports:
        return ports_of(self.alignment, self.devices)


def load_plan(path: Path, overrides: Iterable[str] = ()) -> CalibrationPlan:
    """Return the calibration plan in a file; raises ConfigurationError with every mistake, each with its line."""
    pipeline = load_pipeline(path, overrides, estimates=False)
    refuse_rehearsal(pipeline)
    settings = pipeline.tables.get("calibration", CalibrationSettings())
    assert isinstance(settings, CalibrationSettings)
    # Channels that a step's own devices do not have.
    mistakes = []
    for name, step in settings.steps.items():
        if step.device:
            for mistake in wrong_channels(pipeline.alignment, step.device):
                mistakes.append(f"{path}: [calibration] {name}.device: {mistake.problem}")
    if mistakes:
        raise ConfigurationError("\n".join(mistakes))
    return CalibrationPlan(
        path=pipeline.path,
        run=pipeline.run,
        alignment=pipeline.alignment,
        settings=settings,
        devices=pipeline.devices,
        trajectories=pipeline.trajectories,
        indenters=pipeline.indenters,
        safety=pipeline.safety,
        registry=pipeline.registry,
    )
