"""Functions that estimate records: one fit, or many tracks in parallel."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate import ContactModel, Estimator, Part
from palpate_engine import input_files

from palpate_notebook.argument_names import explains_arguments
from palpate_notebook.fit_object import Fit
from palpate_notebook.fitter_object import Fitter, RecordEstimator, Rig, Tip, facts_in
from palpate_notebook.record_from_frame import record_of
from palpate_notebook.record_object import Record
from palpate_notebook.run_object import FinishedRun

if TYPE_CHECKING:
    import pandas

_cache = threading.local()  # `latest`: in each thread, key and estimator of the latest call


@explains_arguments
def fit(
    record: Record | str | Path | pandas.DataFrame,
    *,
    signals: Mapping[str, str | float] | None = None,
    tip: Tip = None,
    model: str | ContactModel = "dr",
    estimator: str | Estimator = "casadi-fit",
    uncertainties: Mapping[str, str | float] | None = None,
    rig: Rig = None,
    name: str | None = None,
) -> Fit:
    """Fit a model to a record, to a log by its path, or to a table of pandas, all of it at once.

    The columns of a log or table are recognised by their names and numbers; `signals` says which is which, as in
    `palpate.read`; units of a table may be in ``frame.attrs["units"]``.
    `model` and `estimator` are parts, as in ``DimensionalityReduction(indenter=Sphere(radius="5 mm"), poisson=0.49)``,
    or names of parts with their defaults, in full or by their initials: "dr" is "dimensionality-reduction", on the
    `tip`, which is a part, words such as "sphere 3 mm", or a table as in a pipeline:
    ``{"type": "blunt-cone", "angle": "30 deg", "tip_radius": "1 mm"}``. `uncertainties` are the standard uncertainties
    of what is assumed exact: ``{"radius": "20 um"}``. `rig` are the facts of the rig and its specimens, a file such as
    "rig.toml" or its keys: ``{"thickness": "22 mm", "delay": "0 ms +- 1 ms"}``; what the record states otherwise is
    refused.

    Raises ConfigurationError for what does not fit together, LogError for a record that cannot be read.
    """
    readings = record_of(record, signals)
    return Fit(_cached_estimator([model], [estimator], tip, uncertainties, rig).estimate(readings, name))


@explains_arguments
def prepare(
    *,
    tip: Tip = None,
    model: str | ContactModel = "dr",
    estimator: str | Estimator = "casadi-fit",
    uncertainties: Mapping[str, str | float] | None = None,
    rig: Rig = None,
) -> Fitter:
    """Return a fitter for any number of records, which fits each like `fit` and does what they share once.

    Parts, names, `uncertainties` and `rig` as in `fit`. Raises ConfigurationError for a part that no plugin has.
    """
    return Fitter(RecordEstimator([model], [estimator], tip, uncertainties, rig))


@explains_arguments
def compare(
    record: Record,
    *,
    models: Sequence[str | ContactModel] = ("dr",),
    estimators: Sequence[str | Estimator] = ("ekf", "kinematic-ekf"),
    tip: Tip = None,
    uncertainties: Mapping[str, str | float] | None = None,
    rig: Rig = None,
    name: str | None = None,
) -> FinishedRun:
    """Return a run of every model with every estimator on one record, which is read once.

    Parts, names and errors as in `fit`.
    """
    return _cached_estimator(models, estimators, tip, uncertainties, rig).estimate(record, name)


def _cached_estimator(
    models: Sequence[str | ContactModel],
    estimators: Sequence[str | Estimator],
    tip: Tip,
    uncertainties: Mapping[str, str | float] | None,
    rig: Rig,
) -> RecordEstimator:
    """Return the estimator of the arguments, that of this thread's latest call if it had the same ones.

    Files that belong to the parts are compared by their times of modification.
    """
    parts = [part for part in (*models, *estimators, tip) if isinstance(part, Part)]
    file_times = [(path, path.stat().st_mtime_ns) for part in parts for path in input_files(part) if path.exists()]
    facts = facts_in(rig)
    tip = dict(tip) if isinstance(tip, Mapping) else tip  # its owner may change it before the next call
    key: tuple[Any, ...] = (tuple(models), tuple(estimators), tip, dict(uncertainties or {}), file_times, facts)
    latest: tuple[tuple[Any, ...], RecordEstimator] | None = getattr(_cache, "latest", None)
    if latest is not None and latest[0] == key:
        return latest[1]
    estimator = RecordEstimator(models, estimators, tip, uncertainties, rig)
    _cache.latest = key, estimator
    return estimator
