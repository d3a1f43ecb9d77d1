"""Which of many models and estimators can run at all, and why the others cannot."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy, deepcopy
from dataclasses import replace
from typing import Any

from palpate import ConfigurationError, PluginError
from palpate.host import ConsentError, Pipeline, Source, build_pipeline, start_tracks

_KINDS = ("model", "estimator")


def with_what_runs(source: Source) -> tuple[Pipeline, dict[str, str]]:
    """The pipeline with the tracks that start, and why each other one does not, by MODEL/ESTIMATOR.

    A model or an estimator whose table or code is refused takes its own tracks along, and no others. Raises
    ConfigurationError for a mistake in anything else, and where nothing is left.
    """
    whole = deepcopy(source.tables)
    try:
        pipeline, refused = build_pipeline(_copied(source, whole)), dict[str, str]()
    except (ConfigurationError, PluginError) as error:
        if isinstance(error, ConsentError):
            raise
        pipeline, refused = _without_refused(source, whole, error)
    running = []
    for track in pipeline.tracks:
        try:
            start_tracks(replace(pipeline, tracks=(track,)))
        except (ConfigurationError, PluginError) as error:
            refused[str(track.name)] = _reason(error, pipeline)
        else:
            running.append(track)
    if not running:
        raise ConfigurationError(f"no track can run: {'; '.join(f'{name}: {why}' for name, why in refused.items())}")
    return replace(pipeline, tracks=tuple(running)), refused


def _without_refused(
    source: Source, whole: Mapping[str, Any], error: ConfigurationError | PluginError
) -> tuple[Pipeline, dict[str, str]]:
    """The pipeline without the parts that are refused by themselves; raises `error` where these are not the cause."""
    bad = {
        kind: {name: why for name in whole.get(kind, {}) if (why := _refusal(source, whole, kind, name)) is not None}
        for kind in _KINDS
    }
    tables = deepcopy(dict(whole))
    for kind in _KINDS:
        tables[kind] = {name: table for name, table in tables.get(kind, {}).items() if name not in bad[kind]}
    if not any(bad.values()) or not all(tables[kind] for kind in _KINDS):
        raise error
    refused = {}
    for model in whole["model"]:
        for estimator in whole["estimator"]:
            if (why := bad["model"].get(model, bad["estimator"].get(estimator))) is not None:
                refused[f"{model}/{estimator}"] = why
    return build_pipeline(_copied(source, tables)), refused


def _refusal(source: Source, whole: Mapping[str, Any], kind: str, name: str) -> str | None:
    """Why a part is refused although nothing but its tips stands beside it; None where it is not."""
    tables = {key: table for key, table in whole.items() if key in ("run", "device", "alignment", "indenter")}
    alone = _copied(source, {**tables, kind: {name: whole[kind][name]}})
    alone.tables["run"] = {key: value for key, value in whole.get("run", {}).items() if key == "plugins"}
    try:
        build_pipeline(alone, estimates=False)
    except ConsentError:
        raise
    except (ConfigurationError, PluginError) as error:
        return str(error).removeprefix(f"{source.path}: ")
    return None


def _reason(error: Exception, pipeline: Pipeline) -> str:
    return str(error).removeprefix(f"{pipeline.path}: ")


def _copied(source: Source, tables: Mapping[str, Any]) -> Source:
    """A source with other tables, which building may rename."""
    other = copy(source)
    other.tables = deepcopy(dict(tables))
    return other
