"""Calibration of a rig: mass, timing, tare, noise, weight and compliance, from a shake or step by step."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import CalibrationReader, Command, plugin

if TYPE_CHECKING:
    from palpate import FlagMeaning, Settings


@plugin
def palpate_commands() -> dict[str, Command]:
    """Making a calibration."""
    return {
        "calibrate": Command(
            "palpate_calibration.calibrate_command:calibrate",
            "Calibrate mass, delay, tare and noise of a rig.",
            "hardware",
        )
    }


@plugin
def palpate_tables() -> dict[str, type[Settings]]:
    """How a calibration is made."""
    from palpate_calibration.settings import CalibrationSettings

    return {"calibration": CalibrationSettings}


@plugin
def palpate_offers() -> dict[str, dict[str, CalibrationReader]]:
    """What a run takes from a calibration."""
    return {"calibration": {"calibration": CalibrationReader("palpate_calibration.calibration_use:calibration_in")}}


@plugin
def palpate_flags() -> dict[str, FlagMeaning]:
    """Flags on a calibration."""
    from palpate_calibration.flags import CALIBRATION_FLAGS

    return CALIBRATION_FLAGS
