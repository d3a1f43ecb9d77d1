"""Which of many models and estimators can run at all, and why the others cannot."""

from __future__ import annotations

from collections.abc import Container
from copy import copy, deepcopy
from dataclasses import replace

from palpate import ConfigurationError, PluginError
from palpate_engine import ConsentError, Pipeline, Source, build_pipeline, start_tracks

_KINDS = ("model", "estimator")


def with_what_runs(source: Source, added: Container[tuple[str, str]]) -> tuple[Pipeline, dict[str, str]]:
    """The pipeline with the tracks that start, and why each other one does not, by MODEL/ESTIMATOR.

    A part whose code is refused, or that was `added` (kinds and names) and lacks what no table says, takes its own
    tracks along, and no others. Raises UserError for a mistake in anything else, and where nothing is left.
    """
    pipeline, bad = _built(source, added)
    refused = {
        f"{model}/{estimator}": bad.get(("model", model)) or bad["estimator", estimator]
        for model in source.tables["model"]
        for estimator in source.tables["estimator"]
        if ("model", model) in bad or ("estimator", estimator) in bad
    }
    running = []
    for track in pipeline.tracks:
        try:
            start_tracks(replace(pipeline, tracks=(track,)))
        except (ConfigurationError, PluginError) as error:
            refused[str(track.name)] = str(error).removeprefix(f"{pipeline.path}: ")
        else:
            running.append(track)
    if not running:
        raise ConfigurationError(f"no track can run: {'; '.join(f'{name}: {why}' for name, why in refused.items())}")
    return replace(pipeline, tracks=tuple(running)), refused


def _built(source: Source, added: Container[tuple[str, str]]) -> tuple[Pipeline, dict[tuple[str, str], str]]:
    """The pipeline without the parts that are refused, and why these are, by kind and name."""
    bad: dict[tuple[str, str], str] = {}
    while True:
        try:
            return build_pipeline(_without(source, bad)), bad
        except ConsentError:
            raise
        except (ConfigurationError, PluginError) as error:
            left = [(kind, name) for kind in _KINDS for name in source.tables.get(kind, {}) if (kind, name) not in bad]
            if isinstance(error, PluginError):  # of a check, which does not say where
                told = {part: str(error) for part in left if _builds(_without(source, {**bad, part: ""}))}
            else:
                told = {part: error.by_table[part] for part in left if part in added and part in error.by_table}
            if not told or any(all((kind, name) in {**bad, **told} for name in source.tables[kind]) for kind in _KINDS):
                raise
            bad |= told


def _builds(source: Source) -> bool:
    try:
        build_pipeline(source)
    except (ConfigurationError, PluginError):
        return False
    return True


def _without(source: Source, bad: dict[tuple[str, str], str]) -> Source:
    """A copy of a source, which building may change, without some of its parts and what was assumed of them."""
    other = copy(source)
    other.tables = deepcopy(source.tables)
    for kind, name in bad:
        del other.tables[kind][name]
    if isinstance(run := other.tables.get("run"), dict) and "assumed" in run:
        gone = tuple(f"{kind}.{name}." for kind, name in bad)
        run["assumed"] = [key for key in run["assumed"] if not key.startswith(gone)]
    return other
