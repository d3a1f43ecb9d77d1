"""A control chart that a pipeline names: a plugin reads the file and says which check stands behind the run."""

from __future__ import annotations

from palpate.errors import PalpateError
from palpate.key_mistakes import Mistake
from palpate.offers import function_of
from palpate.registry import Registry

from palpate_engine.config.pipeline import ControlUse, RunSettings


def control_of(run: RunSettings | None, registry: Registry) -> tuple[ControlUse | None, list[Mistake]]:
    """Return the control chart that ``[run]`` names, if any, and what is wrong with it."""
    if run is None or run.control is None:
        return None, []
    if not registry.controls:
        return None, [Mistake(("run", "control"), "is given, but no plugin here reads control charts")]
    try:
        reader = next(iter(registry.controls.values()))  # that of a plugin file, then palpate's own
        use: ControlUse = function_of(reader)(run.control, run.control_valid)
    except PalpateError as error:
        return None, [Mistake(("run", "control"), f"{error}; `palpate calibrate control` makes one")]
    return use, []
