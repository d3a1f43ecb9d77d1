"""The Python face: records in memory, runs, fits, comparisons, sweeps and maps, as a notebook wants them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import lazily, plugin

if TYPE_CHECKING:
    from palpate import Device

    from palpate_notebook.draft import Draft, load, run
    from palpate_notebook.finished import FinishedRun, open_run
    from palpate_notebook.fitted import Fit
    from palpate_notebook.fitting import compare, fit
    from palpate_notebook.mapped import MapView
    from palpate_notebook.memory import MemoryRecord
    from palpate_notebook.picture import Picture
    from palpate_notebook.quantity import Quantity
    from palpate_notebook.reading import read
    from palpate_notebook.records import Record, record
    from palpate_notebook.sweeping import Sweep, sweep
    from palpate_notebook.track import TrackView

__getattr__ = lazily(
    __name__,
    {
        "palpate_notebook.draft": "Draft load run",
        "palpate_notebook.finished": "FinishedRun open_run",
        "palpate_notebook.fitted": "Fit",
        "palpate_notebook.fitting": "compare fit",
        "palpate_notebook.mapped": "MapView",
        "palpate_notebook.memory": "MemoryRecord",
        "palpate_notebook.picture": "Picture",
        "palpate_notebook.quantity": "Quantity",
        "palpate_notebook.reading": "read",
        "palpate_notebook.records": "Record record",
        "palpate_notebook.sweeping": "Sweep sweep",
        "palpate_notebook.track": "TrackView",
    },
)

__all__ = [
    "Draft",
    "FinishedRun",
    "Fit",
    "MapView",
    "MemoryRecord",
    "Picture",
    "Quantity",
    "Record",
    "Sweep",
    "TrackView",
    "compare",
    "fit",
    "load",
    "open_run",
    "read",
    "record",
    "run",
    "sweep",
]


@plugin
def palpate_devices() -> dict[str, type[Device]]:
    """Readings that are in memory already."""
    from palpate_notebook.memory import MemoryRecord

    return {"memory-record": MemoryRecord}
