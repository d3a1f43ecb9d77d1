"""Records estimated: one fit, or many tracks side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import tomli_w
from palpate import ConfigurationError, ContactModel, Estimator, Indenter, Part, Samples
from palpate.host import Pipeline, Registry, Source, build_pipeline, plain_settings, registry, suggest

from palpate_notebook.fit_object import Fit
from palpate_notebook.record_object import Record
from palpate_notebook.run_object import FinishedRun

_UNCHECKED = "unchecked"


def fit(
    record: Record,
    *,
    tip: Indenter | None = None,
    model: str | ContactModel = "dr",
    estimator: str | Estimator = "casadi-fit",
    uncertainties: Mapping[str, str | float] | None = None,
    name: str | None = None,
) -> Fit:
    """Fit a model to a record, all of it at once.

    `model` and `estimator` are parts, as in ``DimensionalityReduction(indenter=Sphere(radius="5 mm"), poisson=0.49)``,
    or names of parts with their defaults, in full or by their initials: "dr" is "dimensionality-reduction", on the
    `tip`. `uncertainties` are the standard uncertainties of what is taken for known: ``{"radius": "20 um"}``.

    Raises ConfigurationError for what does not fit together, LogError for a record that cannot be read.
    """
    run = _estimated(record, tip, [model], [estimator], uncertainties, name)
    return Fit(run)


def compare(
    record: Record,
    *,
    models: Sequence[str | ContactModel] = ("dr",),
    estimators: Sequence[str | Estimator] = ("ekf", "kinematic-ekf"),
    tip: Indenter | None = None,
    uncertainties: Mapping[str, str | float] | None = None,
    name: str | None = None,
) -> FinishedRun:
    """Every model with every estimator on one record, read once; parts and names as in `fit`, which raises the same."""
    return _estimated(record, tip, models, estimators, uncertainties, name)


def align_record(record: Record) -> Samples:
    """The record's samples, before any model; raises like `fit`."""
    from palpate_notebook.run_functions import execute

    tables = {"device": dict(record.devices), "alignment": dict(record.alignment)}
    pipeline = build_pipeline(_source(record, tables), estimates=False)
    return execute(pipeline, None, record).aligned


def _estimated(
    record: Record,
    tip: Indenter | None,
    models: Sequence[str | ContactModel],
    estimators: Sequence[str | Estimator],
    uncertainties: Mapping[str, str | float] | None,
    name: str | None,
) -> FinishedRun:
    from palpate_notebook.run_functions import execute

    return execute(pipeline_of(record, tip, models, estimators, uncertainties, name), None, record)


def pipeline_of(
    record: Record,
    tip: Indenter | None,
    models: Sequence[str | ContactModel],
    estimators: Sequence[str | Estimator],
    uncertainties: Mapping[str, str | float] | None = None,
    name: str | None = None,
) -> Pipeline:
    """The pipeline that estimates a record; raises ConfigurationError with every mistake at once."""
    for part, kind in ((models, "models"), (estimators, "estimators")):
        if isinstance(part, str) or not part:
            raise ConfigurationError(f'{kind}: must be a list of parts or of their names, such as ["dr"]')
    known = registry.load()
    tables: dict[str, Any] = {
        "run": {
            "name": name or record.name,
            "uncertainties": dict(uncertainties or {}),
            "assumed": list(record.assumed),
        },
        "device": dict(record.devices),
        "alignment": dict(record.alignment),
    }
    if tip is not None:
        tables["indenter"] = {"tip": table_of(tip, "tip", "indenter", known)}
    tables["model"] = _tables(models, "model", known, tip is not None)
    tables["estimator"] = _tables(estimators, "estimator", known, False)
    return build_pipeline(_source(record, tables))


def _source(record: Record, tables: dict[str, Any]) -> Source:
    try:
        return Source(tomli_w.dumps(tables), record.path)
    except TypeError as error:
        raise ConfigurationError(
            f"{record.name}: contains something that cannot be written in a pipeline file: {error}"
        ) from error


def _tables(given: Sequence[str | Part], kind: str, known: Registry, with_tip: bool) -> dict[str, Any]:
    """A table for each part, by a short name that no other has."""
    tables: dict[str, Any] = {}
    for part in given:
        if isinstance(part, str):
            label, table = part, {"type": _full_name(part, kind, known)}
            wanted = known.find(kind, table["type"]).model_fields.get("indenter")
            if wanted is not None and (with_tip or wanted.is_required()):
                if not with_tip:
                    raise ConfigurationError(f'{kind} {part!r} needs a tip, such as tip=Sphere(radius="5 mm")')
                table["indenter"] = "tip"
        else:
            table = table_of(part, kind, kind, known)
            label = table["type"]
        count = sum(key == label or key.startswith(f"{label}_") for key in tables)
        tables[label if not count else f"{label}_{count + 1}"] = table
    return tables


def table_of(part: object, what: str, kind: str, known: Registry) -> dict[str, Any]:
    """A part as a table of a pipeline file; raises ConfigurationError for what is no part of an installed plugin."""
    if not isinstance(part, Part) or part.kind != kind:
        raise ConfigurationError(f"{what}: {part!r} is no {kind} and no name of one")
    if not any(entry.part is type(part) for entry in known.parts[kind].values()):
        raise ConfigurationError(
            f"{what}: {type(part).__name__} is a part of no plugin: a distribution offers it by a hook, or a file "
            "beside a pipeline does, in [run] plugins"
        )
    table: dict[str, Any] = _without_marks(plain_settings(part, known))
    return table


def _without_marks(value: Any) -> Any:
    """Numbers of a part in Python are doubted like those of a file."""
    if isinstance(value, dict):
        return {key: _without_marks(item) for key, item in value.items() if key != _UNCHECKED}
    return [_without_marks(item) for item in value] if isinstance(value, list) else value


def _full_name(name: str, kind: str, known: Registry) -> str:
    """A part's name in full, from it or from its initials; raises ConfigurationError."""
    names = known.parts[kind]
    if name in names:
        return name
    meant = [full for full in names if "".join(word[0] for word in full.split("-")) == name and "-" in full]
    if len(meant) != 1:
        raise ConfigurationError(f"there is no {kind} {name!r}{suggest(name, names)}")
    return meant[0]
