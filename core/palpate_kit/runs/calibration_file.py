"""Calibrations in files: tables of a rig's file of facts, in SI; files of older versions have them alone."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

from palpate import ConfigurationError, Settings
from palpate_engine import MEASURED, MEASUREMENT
from pydantic import Field

from palpate_kit.runs.toml_file import read_tables, settings_of

_FORMAT = 1


class CalibratedValue(Settings):
    """One value of a calibration file."""

    value: float = Field(allow_inf_nan=False, description="in its unit")
    unit: str = Field(description="SI")
    std: float = Field(ge=0, allow_inf_nan=False, description="combined standard uncertainty")
    interval: tuple[float, float] = Field(description="95 %")
    fit: float = Field(default=0.0, ge=0, description="standard uncertainty from the fits")
    type_a: float | None = Field(default=None, ge=0, description="standard uncertainty from the scatter of the repeats")
    type_b: float = Field(default=0.0, ge=0, description="declared standard uncertainty")
    repeats: tuple[float, ...] = Field(default=(), description="the value of each repeat")


class NoiseSpectrum(Settings):
    """Noise at standstill by octaves, in a calibration file."""

    unit: str = Field(description="of the densities")
    frequencies: tuple[float, ...] = Field(description="middle of each octave [Hz]")
    densities: tuple[float, ...] = Field(description="root of the one-sided power density")


class Calibration(Settings):
    """A calibration, as in its file."""

    format: int = Field(default=_FORMAT, ge=1, le=_FORMAT, description="version of this format")
    name: str = Field(default="", description="what the calibration is called")
    created: datetime = Field(description="when it was made, with time zone")
    values: dict[str, CalibratedValue] = Field(description="by name: mass, delay, offset, ...")
    channels: dict[str, str] = Field(description="channels of force, position and velocity")
    devices: dict[str, dict[str, str]] = Field(default={}, description="type, serial number, versions, file and hash")
    tip: dict[str, Any] | None = Field(default=None, description="the indenter that was mounted, where it was named")
    shake: dict[str, Any] = Field(default={}, description="frequencies [Hz], amplitudes [m], residual [N]")
    spectra: dict[str, NoiseSpectrum] = Field(
        default={}, description="noise at standstill of force, position and velocity"
    )
    logs: dict[str, dict[str, str]] = Field(default={}, description="file and hash of each log, by step and device")
    notes: tuple[str, ...] = Field(default=(), description="notes for the user")
    versions: dict[str, str] = Field(default={}, description="of palpate and its libraries")
    command: str = Field(default="", description="that made it")

    def tables(self) -> dict[str, Any]:
        """Return the tables of a file of facts: what was measured, and how."""
        plain = _plain(self.model_dump(mode="python", exclude_none=True))
        return {MEASURED: plain.pop("values"), MEASUREMENT: plain}

    def text(self) -> str:
        """Return the file's text."""
        import tomli_w

        return tomli_w.dumps(_plain(self.model_dump(mode="python", exclude_none=True)))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items() if item not in ((), {}, None)}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return value


def read_calibration(path: Path) -> Calibration:
    """Return the calibration in a file of facts, or in one of its own; raises ConfigurationError if it has none."""
    tables = read_tables(path, "calibration file")
    if MEASURED in tables:
        tables = {"values": tables[MEASURED], **tables.get(MEASUREMENT, {})}
    calibration = settings_of(tables, path, Calibration, "calibration file")
    if calibration.created.tzinfo is None:
        raise ConfigurationError(f"{path}: is not a calibration file: created has no time zone")
    return calibration
