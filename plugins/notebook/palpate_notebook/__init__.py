"""The Python face: records in memory, runs, fits, comparisons, sweeps and maps, as a notebook uses them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader
from palpate import plugin

if TYPE_CHECKING:
    from palpate import Device

    from palpate_notebook.figure_object import Picture
    from palpate_notebook.fit_functions import compare, fit, prepare
    from palpate_notebook.fit_object import Fit
    from palpate_notebook.fitter_object import Fitter
    from palpate_notebook.folder_fits import fit_folder
    from palpate_notebook.map_object import MapView
    from palpate_notebook.memory_device import MemoryRecord
    from palpate_notebook.pipeline_changes import Draft, load, run
    from palpate_notebook.quantity import UncertainQuantity
    from palpate_notebook.record_from_log import read
    from palpate_notebook.record_object import Record, record
    from palpate_notebook.run_object import FinishedRun, open_run
    from palpate_notebook.sweep_functions import Sweep, sweep
    from palpate_notebook.track_object import TrackView

__getattr__, _, _ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "pipeline_changes": ["Draft", "load", "run"],
        "run_object": ["FinishedRun", "open_run"],
        "fit_object": ["Fit"],
        "fit_functions": ["compare", "fit", "prepare"],
        "fitter_object": ["Fitter"],
        "folder_fits": ["fit_folder"],
        "map_object": ["MapView"],
        "memory_device": ["MemoryRecord"],
        "figure_object": ["Picture"],
        "quantity": ["UncertainQuantity"],
        "record_from_log": ["read"],
        "record_object": ["Record", "record"],
        "sweep_functions": ["Sweep", "sweep"],
        "track_object": ["TrackView"],
    },
)

__all__ = [
    "Draft",
    "FinishedRun",
    "Fit",
    "Fitter",
    "MapView",
    "MemoryRecord",
    "Picture",
    "Record",
    "Sweep",
    "TrackView",
    "UncertainQuantity",
    "compare",
    "fit",
    "fit_folder",
    "load",
    "open_run",
    "prepare",
    "read",
    "record",
    "run",
    "sweep",
]


@plugin
def palpate_devices() -> dict[str, type[Device]]:
    """Readings that are in memory already."""
    from palpate_notebook.memory_device import MemoryRecord

    return {"memory-record": MemoryRecord}
