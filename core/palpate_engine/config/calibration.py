"""A calibration that a pipeline takes: a plugin reads the file and says what is taken from it."""

from __future__ import annotations

from palpate.errors import PalpateError
from palpate.key_mistakes import Mistake
from palpate.offers import function_of
from palpate.registry import Registry

from palpate_engine.alignment import AlignmentSettings
from palpate_engine.config.pipeline import CalibrationUse, RunSettings


def calibration_of(
    run: RunSettings | None, alignment: AlignmentSettings | None, registry: Registry
) -> tuple[CalibrationUse | None, list[Mistake]]:
    """Return the calibration that ``[run]`` names, if any, and what is wrong with it."""
    needs_offset = alignment is not None and alignment.tare == "calibrated"
    if run is None or run.calibration is None:
        problem = Mistake(("alignment", "tare"), 'is "calibrated", but [run] names no calibration')
        return None, [problem] if needs_offset else []
    if not registry.calibrations:
        return None, [Mistake(("run", "calibration"), "is given, but no plugin here reads calibration files")]
    try:
        reader = next(iter(registry.calibrations.values()))  # that of a plugin file, then palpate's own
        use: CalibrationUse = function_of(reader)(run.calibration, run.calibration_valid)
    except PalpateError as error:
        return None, [Mistake(("run", "calibration"), f"{error}; `palpate calibrate` makes one")]
    # The calibration has to hold the offset that the alignment takes from it.
    if alignment is not None and needs_offset and use.alignment(alignment).tare == "calibrated":
        return None, [Mistake(("alignment", "tare"), 'is "calibrated", but the calibration holds no offset')]
    return use, []
