"""The Python interface: records in memory, runs, fits, comparisons, sweeps and maps, as a notebook uses them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import plugin
from palpate_kit.lazy_names import lazy_names

if TYPE_CHECKING:
    from palpate_notebook.figure_object import Picture as Picture
    from palpate_notebook.fit_functions import compare as compare, fit as fit, prepare as prepare
    from palpate_notebook.fit_object import Fit as Fit
    from palpate_notebook.fitter_object import Fitter as Fitter
    from palpate_notebook.folder_fits import fit_folder as fit_folder
    from palpate_notebook.map_object import MapView as MapView
    from palpate_notebook.memory_device import MemoryRecord as MemoryRecord
    from palpate_notebook.pipeline_changes import Draft as Draft, load as load, run as run
    from palpate_notebook.quantity import UncertainQuantity as UncertainQuantity
    from palpate_notebook.record_from_log import read as read
    from palpate_notebook.record_object import Record as Record, record as record
    from palpate_notebook.run_object import FinishedRun as FinishedRun, open_run as open_run
    from palpate_notebook.sweep_functions import Sweep as Sweep, sweep as sweep
    from palpate_notebook.track_object import TrackView as TrackView


@plugin
def palpate_devices() -> dict[str, str]:
    """Return the device of readings in memory."""
    return {"memory-record": "palpate_notebook.memory_device:MemoryRecord"}


__getattr__, __all__ = lazy_names(
    __name__,
    "palpate_notebook.pipeline_changes:Draft",
    "palpate_notebook.run_object:FinishedRun",
    "palpate_notebook.fit_object:Fit",
    "palpate_notebook.fitter_object:Fitter",
    "palpate_notebook.map_object:MapView",
    "palpate_notebook.memory_device:MemoryRecord",
    "palpate_notebook.figure_object:Picture",
    "palpate_notebook.record_object:Record",
    "palpate_notebook.sweep_functions:Sweep",
    "palpate_notebook.track_object:TrackView",
    "palpate_notebook.quantity:UncertainQuantity",
    "palpate_notebook.fit_functions:compare",
    "palpate_notebook.fit_functions:fit",
    "palpate_notebook.folder_fits:fit_folder",
    "palpate_notebook.pipeline_changes:load",
    "palpate_notebook.run_object:open_run",
    "palpate_notebook.fit_functions:prepare",
    "palpate_notebook.record_from_log:read",
    "palpate_notebook.record_object:record",
    "palpate_notebook.pipeline_changes:run",
    "palpate_notebook.sweep_functions:sweep",
)
