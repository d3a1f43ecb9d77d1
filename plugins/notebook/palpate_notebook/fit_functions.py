"""Records estimated: one fit, or many tracks side by side."""

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

_latest = threading.local()  # the estimator of the latest call in each thread, and what it was made of


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
    known = record_of(record, signals)
    return Fit(_estimator([model], [estimator], tip, uncertainties, rig).estimate(known, name))


@explains_arguments
def prepare(
    *,
    tip: Tip = None,
    model: str | ContactModel = "dr",
    estimator: str | Estimator = "casadi-fit",
    uncertainties: Mapping[str, str | float] | None = None,
    rig: Rig = None,
) -> Fitter:
    """Return a fitter for any number of records: what `fit` does of each, with all that they share done once.

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
    """Return every model with every estimator on one record, read once; parts and names as in `fit`, which raises
    the same."""
    return _estimator(models, estimators, tip, uncertainties, rig).estimate(record, name)


def _estimator(
    models: Sequence[str | ContactModel],
    estimators: Sequence[str | Estimator],
    tip: Tip,
    uncertainties: Mapping[str, str | float] | None,
    rig: Rig,
) -> RecordEstimator:
    """Return the latest estimator of this thread where it is of the same parts, and of files that have not changed
    since."""
    parts = [part for part in (*models, *estimators, tip) if isinstance(part, Part)]
    states = [(path, path.stat().st_mtime_ns) for part in parts for path in input_files(part) if path.exists()]
    facts = facts_in(rig)
    tip = dict(tip) if isinstance(tip, Mapping) else tip  # its owner may change it before the next call
    made_of: tuple[Any, ...] = (tuple(models), tuple(estimators), tip, dict(uncertainties or {}), states, facts)
    known: tuple[tuple[Any, ...], RecordEstimator] | None = getattr(_latest, "known", None)
    if known is not None and known[0] == made_of:
        return known[1]
    found = RecordEstimator(models, estimators, tip, uncertainties, rig)
    _latest.known = made_of, found
    return found
