"""Pipelines from TOML files: one file becomes a checked pipeline, or all mistakes in it at once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from palpate import registry as registries
from palpate.contact import ContactModel
from palpate.device import Device, is_live
from palpate.errors import suggest
from palpate.estimation import Estimator
from palpate.key_mistakes import Mistake
from palpate.parts import Settings
from palpate.registry import Registry
from palpate.trust import PluginFile, announce, approved_files, plugin_files_at_hand

from palpate_engine.alignment import AlignmentSettings
from palpate_engine.config.assumed_values import assumed_keys
from palpate_engine.config.bases import apply_bases, looser_limits
from palpate_engine.config.calibration import calibration_of
from palpate_engine.config.control import control_of
from palpate_engine.config.declared_uncertainties import unknown_sources
from palpate_engine.config.dialects import choose_dialect
from palpate_engine.config.file_version import demand_version
from palpate_engine.config.mistakes import raise_mistakes
from palpate_engine.config.part_builder import Builder, unknown_tables
from palpate_engine.config.pipeline import (
    CalibrationUse,
    ControlUse,
    Pipeline,
    RunSettings,
    Track,
    sphere_radii,
)
from palpate_engine.config.pipeline_source import Source
from palpate_engine.config.rig_settings import apply_rig
from palpate_engine.config.safety_wiring import contradictions, wire_safety
from palpate_engine.config.signal_wiring import check_wiring, ports_of, with_gravity, wrong_channels
from palpate_engine.config.stated_truth import wrong_truth
from palpate_engine.safety import SafetySettings
from palpate_engine.track_name import TrackName


def load_pipeline(path: Path, overrides: Iterable[str] = (), estimates: bool = True, named: bool = True) -> Pipeline:
    """Return the pipeline in a file, with ``table.key=value`` overrides on top.

    Without `estimates` the file need not name models and estimators, and takes nothing from a calibration: enough to
    move and to record. The plugin files of a file that a person has `named` may be executed; see `Source.read`.

    Raises ConfigurationError with every mistake at once, each with its line; PluginError where a plugin fails.
    """
    source = Source.read(path, named)
    for assignment in overrides:
        source.override(assignment)
    return build_pipeline(source, estimates)


def build_pipeline(source: Source, estimates: bool = True) -> Pipeline:
    """Return the pipeline in a source; without `estimates` no model and no estimator is demanded.

    Raises like `load_pipeline`.
    """
    builder, registry, run = _begin(source)
    tables = source.tables
    # Each table becomes settings or parts. The builder notes what is wrong with one and goes on with the next.
    stated: AlignmentSettings | None = _settings_in(builder, tables, AlignmentSettings, "alignment")
    analyses = {name: builder.settings(part, (name,)) for name, part in registry.tables.items() if name in tables}
    safety: SafetySettings | None = _settings_in(builder, tables, SafetySettings, "safety")
    kinds = {kind: builder.parts(kind) for kind in registry.parts}  # parts by kind, then by name
    # The tables have to agree with each other.
    builder.mistakes += _missing(tables, registry, ("device", "model", "estimator") if estimates else ("device",))
    builder.mistakes += _wrong_signals(tables, stated, kinds["device"], safety)
    builder.mistakes += _wrong_rehearsal(run, kinds)
    calibration, control, mistakes = _rig_measurements(run, stated, registry) if estimates else (None, None, [])
    builder.mistakes += [*mistakes, *_wrong_uncertainties(run, kinds["model"]), *_wrong_truth(run, kinds["model"])]
    # A calibration fills in what the file leaves open, and the arm knows where gravity is.
    alignment = stated
    if calibration and stated:
        alignment = calibration.alignment(stated)
        kinds["estimator"] = {name: calibration.estimator(part) for name, part in kinds["estimator"].items()}
    if alignment:
        alignment = with_gravity(alignment, kinds["device"])
        builder.mistakes += _wrong_orientation(alignment, kinds["model"]) if estimates else []
    # Patterns of tracks, and limits of the rig, are compared only with tables that are in order.
    tracks, unknown_tracks = _tracks(run or RunSettings(), kinds["model"], kinds["estimator"])
    if estimates and not builder.mistakes:
        builder.mistakes += unknown_tracks
    looser = looser_limits(source, safety)
    if safety and alignment and not builder.mistakes:
        builder.mistakes += contradictions(alignment, kinds["device"])
        safety = wire_safety(safety, alignment, kinds["device"])
    raise_mistakes(builder.mistakes, source)
    registry.demand_sound(kinds)
    assert alignment is not None
    assert run is not None
    pipeline = Pipeline(
        path=source.path,
        text=source.text,
        run=run,
        alignment=alignment,
        indenters=kinds["indenter"],
        models=kinds["model"],
        estimators=kinds["estimator"],
        devices=kinds["device"],
        trajectories=kinds["trajectory"],
        surfaces=kinds["surface"],
        sinks=kinds["sink"],
        twins=kinds["twin"],
        safety=safety,
        tracks=tracks,
        registry=registry,
        calibration=calibration,
        control=control,
        tables=analyses,
        stated=stated,
        inherited={".".join(key): place for key, place in source.inherited.items() if not source.is_stated(key)},
        looser_limits=looser,
    )
    # Patterns of assumed keys become the keys themselves, less those that the command line states.
    assumed = assumed_keys(run.assumed, pipeline, source.overridden)
    return replace(pipeline, run=run.model_copy(update={"assumed": assumed})) if run.assumed else pipeline


def _settings_in(builder: Builder, tables: Mapping[str, Any], settings: type[Settings], name: str) -> Any:
    """Return the settings of a plain table of a pipeline; None where it is missing or not in order."""
    return builder.settings(settings, (name,)) if name in tables else None


def _rig_measurements(
    run: RunSettings | None, stated: AlignmentSettings | None, registry: Registry
) -> tuple[CalibrationUse | None, ControlUse | None, list[Mistake]]:
    """Return the calibration and the control chart that ``[run]`` names, and what is wrong with them."""
    calibration, calibration_mistakes = calibration_of(run, stated, registry)
    control, chart_mistakes = control_of(run, registry)
    return calibration, control, [*calibration_mistakes, *chart_mistakes]


def _begin(source: Source) -> tuple[Builder, Registry, RunSettings | None]:
    """Return the builder of a source, the plugins that it asks for, and its ``[run]``.

    Dialect, bases and the facts of a rig change the tables first; [run] is read before the plugins, which it names, and
    again where the facts have set a key of it.
    """
    tables = source.tables
    choose_dialect(source)
    apply_bases(source)
    version = demand_version(source)
    _add_plugins_at_hand(source)
    run_builder = Builder(source, Registry({}))
    run = run_builder.settings(RunSettings, ("run",))
    registry = (_registry(source) if run else registries.load()).of_version(version)
    if apply_rig(source, run and run.rig, registry):
        run_builder = Builder(source, Registry({}))
        run = run_builder.settings(RunSettings, ("run",))
    builder = Builder(source, registry)
    builder.mistakes += run_builder.mistakes + unknown_tables(tables, registry)
    return builder, registry, run


def _add_plugins_at_hand(source: Source) -> None:
    """Name the files of ``palpate --plugin FILE`` in [run], so that what the pipeline resolves to names them, too."""
    run = source.tables.get("run", {})
    named = run.get("plugins", []) if isinstance(run, dict) else None
    if isinstance(named, list) and all(isinstance(text, str) for text in named):
        named_files = {(source.path.parent / text).resolve() for text in named}
        additional = [str(file.path) for file in plugin_files_at_hand() if file.path.resolve() not in named_files]
        if additional:
            source.tables["run"] = {**run, "plugins": [*named, *additional]}


def plugin_files(source: Source) -> tuple[PluginFile, ...]:
    """Return the plugin files that a source names, with content that may be executed.

    Raises ConfigurationError for what is not a list of files, ConsentError where one may not be executed.
    """
    run = source.tables.get("run")
    if not isinstance(run, dict) or "plugins" not in run:
        return ()
    alone = Source("", source.path)
    alone.tables = {"run": {"plugins": run["plugins"]}}
    builder = Builder(alone, Registry({}))
    settings = builder.settings(RunSettings, ("run",))
    raise_mistakes(builder.mistakes, source)
    return approved_files(settings.plugins, source.path, source.has_chosen_plugins)


def _registry(source: Source) -> Registry:
    """Return the parts of the installed plugins and of the files that [run] names, once all of them are approved."""
    files = plugin_files(source)
    announce(files)
    return registries.load(files)


def _wrong_signals(
    tables: Mapping[str, Any],
    alignment: AlignmentSettings | None,
    devices: Mapping[str, Device],
    safety: SafetySettings | None,
) -> list[Mistake]:
    """Return a mistake for each unknown channel, else for each wire that cannot be; nothing where a device could not be
    built."""
    if not alignment or not isinstance(tables.get("device"), dict) or len(devices) != len(tables["device"]):
        return []
    return wrong_channels(alignment, devices) or check_wiring(ports_of(alignment, devices), safety)


def _wrong_orientation(alignment: AlignmentSettings, models: Mapping[str, ContactModel]) -> list[Mistake]:
    """Return a weight to subtract that is not known, and an inclination that would count twice."""
    mistakes = []
    if alignment.weight == "turning" and alignment.tip_mass is None:
        problem = 'is needed for weight = "turning": weigh all that hangs behind the sensor'
        mistakes.append(Mistake(("alignment", "tip_mass"), problem))
    inclined = [name for name, model in models.items() if getattr(getattr(model, "skin", None), "inclination", 0.0)]
    # The key that states the direction along which the force counts.
    direction_key = ("alignment", "surface" if alignment.normal is None else "normal")
    if alignment.is_projecting and inclined:
        problem = f"counts the inclination once more that [model.{inclined[0]}] skin states: leave one of them out"
        mistakes.append(Mistake(direction_key, problem))
    if alignment.is_projecting and len(radii := sorted(sphere_radii(models))) > 1:
        problem = f"is that under one tip, and the models have spheres of {1e3 * radii[0]:g} and {1e3 * radii[-1]:g} mm"
        mistakes.append(Mistake(direction_key, problem))
    return mistakes


def _wrong_uncertainties(run: RunSettings | None, models: Mapping[str, ContactModel]) -> list[Mistake]:
    unknown = unknown_sources(models, run.uncertainties) if run and models else {}
    return [Mistake(("run", "uncertainties", name), problem) for name, problem in unknown.items()]


def _wrong_truth(run: RunSettings | None, models: Mapping[str, ContactModel]) -> list[Mistake]:
    wrong = wrong_truth(models, run.truth) if run and models else ()
    return [Mistake(("run", "truth", name), problem) for name, problem in wrong]


def build_parts(source: Source, kind: str, registry: Registry | None = None) -> dict[str, Any]:
    """Return the parts of one kind in a source, whatever else it lacks; raises like `load_pipeline`.

    Without a registry it is that of the installed plugins and of those that the source names.
    """
    choose_dialect(source)
    apply_bases(source)
    if registry is None:
        run_builder = Builder(source, Registry({}))
        run_builder.settings(RunSettings, ("run",))
        raise_mistakes(run_builder.mistakes, source)
        registry = _registry(source)
    registry = registry.of_version(demand_version(source))
    run = Builder(source, Registry({})).settings(RunSettings, ("run",))
    apply_rig(source, run and run.rig, registry)
    builder = Builder(source, registry)
    parts = builder.parts(kind)
    raise_mistakes(builder.mistakes, source)
    registry.demand_sound({kind: parts})
    return parts


def _wrong_rehearsal(run: RunSettings | None, kinds: Mapping[str, Mapping[str, Any]]) -> list[Mistake]:
    """Return a rehearsal without its twin; one that is read from its log needs none."""
    if run is None or run.rehearsal is None or run.rehearsal in kinds["twin"] or not is_live(kinds["device"]):
        return []
    hint = suggest(run.rehearsal, kinds["twin"])
    return [Mistake(("run", "rehearsal"), f"no [twin.{run.rehearsal}]{hint}")]


def _missing(tables: Mapping[str, Any], registry: Registry, needed: tuple[str, ...]) -> list[Mistake]:
    """Return a mistake for each table without which no pipeline runs: [alignment], and one of each needed kind."""
    mistakes = []
    if "alignment" not in tables:
        mistakes.append(Mistake((), "the table [alignment] is missing: it says which channel is the force"))
    for kind in needed:
        if not tables.get(kind):
            types = ", ".join(sorted(registry.parts[kind]))
            mistakes.append(Mistake((), f"a pipeline needs at least one [{kind}.*] table (there are: {types})"))
    return mistakes


def _tracks(
    run: RunSettings, models: Mapping[str, ContactModel], estimators: Mapping[str, Estimator]
) -> tuple[tuple[Track, ...], list[Mistake]]:
    """Return the tracks that the patterns of [run] name, and a mistake for each pattern that names none."""
    # Every model with every estimator.
    tracks = []
    for model_name, model in models.items():
        for estimator_name, estimator in estimators.items():
            tracks.append(Track(TrackName(model_name, estimator_name), model, estimator))
    names = [track.name for track in tracks]
    mistakes = []
    for pattern in run.tracks:
        if not any(fnmatchcase(name, pattern) for name in names):
            mistakes.append(Mistake(("run", "tracks"), f"no track is called {pattern!r}{suggest(pattern, names)}"))
    chosen = tuple(track for track in tracks if any(fnmatchcase(track.name, pattern) for pattern in run.tracks))
    return chosen, mistakes
