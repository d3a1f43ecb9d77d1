"""Rig: that part of a pipeline which it takes to move and to listen."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from palpate.device import Device
from palpate.trajectory import Trajectory

from palpate_engine.alignment import AlignmentSettings, Ports
from palpate_engine.config import RunSettings
from palpate_engine.safety import SafetySettings


class Rig(Protocol):
    """A pipeline, or the plan of a calibration."""

    @property
    def path(self) -> Path:
        """The file."""
        ...

    @property
    def run(self) -> RunSettings:
        """Its [run] table."""
        ...

    @property
    def alignment(self) -> AlignmentSettings:
        """Its [alignment] table."""
        ...

    @property
    def ports(self) -> Ports:
        """Return the ports at which its signals are read."""
        ...

    @property
    def devices(self) -> Mapping[str, Device]:
        """Its devices by name."""
        ...

    @property
    def trajectories(self) -> Mapping[str, Trajectory]:
        """Its motions by name."""
        ...

    @property
    def safety(self) -> SafetySettings | None:
        """Its [safety] table."""
        ...
