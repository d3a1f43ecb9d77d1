"""Calibration of a rig: mass, timing, tare, noise, weight and compliance, from a shake or step by step."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import CalibrationReader, Command, plugin

if TYPE_CHECKING:
    from palpate import FlagMeaning, Settings


@plugin
def palpate_commands() -> dict[str, Command]:
    """Return the command that makes a calibration."""
    return {
        "calibrate": Command(
            "palpate_calibration.calibrate_command:calibrate",
            "Calibrate mass, delay, tare and noise of a rig.",
            "hardware",
        )
    }


@plugin
def palpate_tables() -> dict[str, type[Settings]]:
    """Return the settings of a calibration."""
    from palpate_calibration.settings import CalibrationSettings

    return {"calibration": CalibrationSettings}


@plugin
def palpate_offers() -> dict[str, dict[str, CalibrationReader]]:
    """Return the reader of the calibration that a run names."""
    return {"calibration": {"calibration": CalibrationReader("palpate_calibration.calibration_use:calibration_in")}}


@plugin
def palpate_flags() -> dict[str, FlagMeaning]:
    """Return the meanings of flags on a calibration."""
    from palpate_calibration.flags import CALIBRATION_FLAGS

    return CALIBRATION_FLAGS
