"""Calibration of a rig: mass, timing, tare, noise, weight and compliance, from a shake or step by step."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, plugin

if TYPE_CHECKING:
    from palpate import Settings


@plugin
def palpate_commands() -> dict[str, Command]:
    """Making a calibration."""
    return {
        "calibrate": Command(
            "palpate_calibration.command:calibrate", "Calibrate mass, delay, tare and noise of a rig.", "hardware"
        )
    }


@plugin
def palpate_tables() -> dict[str, type[Settings]]:
    """How a calibration is made."""
    from palpate_calibration.settings import CalibrationSettings

    return {"calibration": CalibrationSettings}
