"""A calibration that a pipeline takes: a plugin reads the file and says what is taken from it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, Protocol

from palpate.alignment import AlignmentSettings
from palpate.config.mistakes import Mistake
from palpate.errors import PalpateError
from palpate.extensions import function_of
from palpate.flags import Flag
from palpate.registry import Registry

if TYPE_CHECKING:
    from palpate.config.pipeline_file import Pipeline, RunSettings


class CalibratedNumber(Protocol):
    """A number of a calibration."""

    @property
    def value(self) -> float:
        """In its unit [SI]."""
        ...

    @property
    def std(self) -> float:
        """Combined standard uncertainty."""
        ...


class CalibrationUse(Protocol):
    """A calibration that a pipeline names."""

    @property
    def values(self) -> Mapping[str, CalibratedNumber]:
        """What it knows, by name: mass, delay, offset, force_std, ..."""
        ...

    def offset_doubt(self, pipeline: Pipeline, live: Mapping[str, Mapping[str, Any]]) -> Flag | None:
        """Why its offset need not be that of the sensor as it is now; None where it is."""
        ...

    def alignment(self, settings: AlignmentSettings) -> AlignmentSettings:
        """The settings with what the calibration knows wherever the file leaves them open."""
        ...

    def estimator(self, estimator: Any) -> Any:
        """An estimator with the calibration's noise wherever it has such a setting and the file leaves it open."""
        ...

    def flags(self, pipeline: Pipeline, live: Mapping[str, Mapping[str, Any]]) -> Iterable[Flag]:
        """What speaks against it; `live` is what connected devices said of themselves, by name."""
        ...


def calibration_of(
    run: RunSettings | None, alignment: AlignmentSettings | None, registry: Registry
) -> tuple[CalibrationUse | None, list[Mistake]]:
    """The calibration that ``[run]`` names, if any, and what is wrong with it."""
    wanted = alignment is not None and alignment.tare == "calibrated"
    if run is None or run.calibration is None:
        problem = Mistake(("alignment", "tare"), 'is "calibrated", but [run] names no calibration')
        return None, [problem] if wanted else []
    if not registry.calibrations:
        return None, [Mistake(("run", "calibration"), "is given, but no plugin here reads calibration files")]
    try:
        reader = registry.calibrations[min(registry.calibrations)]
        use: CalibrationUse = function_of(reader)(run.calibration, run.calibration_valid)
    except PalpateError as error:
        return None, [Mistake(("run", "calibration"), f"{error}; `palpate calibrate` makes one")]
    if alignment is not None and wanted and use.alignment(alignment).tare == "calibrated":
        return None, [Mistake(("alignment", "tare"), 'is "calibrated", but the calibration holds no offset')]
    return use, []
