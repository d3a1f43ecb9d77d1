"""A pipeline: everything that one TOML file wires together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import Field

from palpate import registry as registries
from palpate.alignment import AlignmentSettings, Ports
from palpate.config.assumed import still_assumed
from palpate.config.builder import Builder, unknown_tables
from palpate.config.calibrated import CalibrationUse, calibration_of
from palpate.config.known import unknown_sources
from palpate.config.migrations import MIGRATIONS, migrate
from palpate.config.mistakes import Mistake, raise_mistakes
from palpate.config.source import Source
from palpate.config.wired_safety import contradictions, wired
from palpate.config.wiring import ports_of, wrong_channels, wrong_wiring
from palpate.contact import ContactModel, Indenter
from palpate.device import Device
from palpate.errors import suggest
from palpate.estimation import Estimator
from palpate.flags import Flag
from palpate.parts import File, Settings
from palpate.registry import Registry
from palpate.safety import SafetySettings
from palpate.sink import Sink
from palpate.track_name import TrackName
from palpate.trajectory import Trajectory
from palpate.trust import demand_trust
from palpate.twin import Twin
from palpate.units import Time


class RunSettings(Settings):
    """The ``[run]`` table: what concerns the run as a whole."""

    name: str = Field(default="run", min_length=1, description="what the run is called, in its folder and its tables")
    tracks: tuple[str, ...] = Field(
        default=("*",), description='which model/estimator pairs run, as patterns: "dr/*", "*/ekf"'
    )
    plugins: tuple[File, ...] = Field(default=(), description="Python files beside the pipeline with parts of your own")
    calibration: File | None = Field(
        default=None, description="calibration file: mass, tare, timing and noise that this file leaves open"
    )
    calibration_valid: Time = Field(default=30 * 86400.0, gt=0, description="an older calibration is flagged")
    seed: int = Field(default=0, ge=0, description="seed of everything that is random")
    average: Time = Field(default=1.0, ge=0.05, description="results are means over so much time at the end")
    uncertainties: dict[str, float | str] = Field(
        default={},
        description="standard uncertainties of what is taken for known, by key of the models and their tips, or "
        '"force_scale", "position_scale": { radius = "20 um", poisson = 0.01, force_scale = 0.005 }; not declared: '
        "a radius to 0.5 %, Poisson's ratio within 0.02 below its value",
    )
    assumed: tuple[str, ...] = Field(
        default=(),
        description='keys whose values nobody has stated, as patterns: "indenter.*", "alignment.tip_mass"; they are '
        "flagged until they are taken out of here, or set on the command line",
    )
    report: bool = Field(default=False, description="write a report when the run has ended")
    estimates_interval: Time = Field(
        default=0.01, ge=0, description="estimates.csv has one row in so much time; 0: every sample"
    )


@dataclass(frozen=True)
class Track:
    """A contact model and an estimator, side by side with other tracks on the same samples."""

    name: TrackName
    model: ContactModel
    estimator: Estimator


@dataclass(frozen=True, kw_only=True)
class Pipeline:
    """Everything that one TOML file wires together, checked."""

    path: Path
    text: str
    run: RunSettings
    alignment: AlignmentSettings
    indenters: Mapping[str, Indenter]
    models: Mapping[str, ContactModel]
    estimators: Mapping[str, Estimator]
    devices: Mapping[str, Device]
    trajectories: Mapping[str, Trajectory]
    sinks: Mapping[str, Sink]
    twins: Mapping[str, Twin]
    safety: SafetySettings | None
    tracks: tuple[Track, ...]
    registry: Registry
    calibration: CalibrationUse | None = None
    tables: Mapping[str, Settings] = field(default_factory=dict)  # those of analyses that the file has, by name
    stated: AlignmentSettings | None = None  # the alignment as the file has it, without the calibration
    renamed: tuple[Flag, ...] = ()  # what the file calls by a name of an older version

    @property
    def ports(self) -> Ports:
        """Where each signal is read."""
        return self._ports

    @cached_property
    def _ports(self) -> Ports:
        return ports_of(self.alignment, self.devices)


def load_pipeline(path: Path, overrides: Iterable[str] = (), estimates: bool = True) -> Pipeline:
    """The pipeline in a file, with ``table.key=value`` overrides on top.

    Without `estimates` the file need not name models and estimators, and takes nothing from a calibration: enough to
    move and to record.

    Raises ConfigurationError with every mistake at once, each with its line; PluginError where a plugin fails.
    """
    source = Source.read(path)
    for assignment in overrides:
        source.override(assignment)
    return build_pipeline(source, estimates)


def build_pipeline(source: Source, estimates: bool = True) -> Pipeline:
    """The pipeline in a source; raises like `load_pipeline`."""
    tables = source.tables
    builder, registry, run, renamed = _begun(source)
    stated = builder.settings(AlignmentSettings, ("alignment",)) if "alignment" in tables else None
    extra = {name: builder.settings(part, (name,)) for name, part in registry.tables.items() if name in tables}
    safety = builder.settings(SafetySettings, ("safety",)) if "safety" in tables else None
    kinds = {kind: builder.parts(kind) for kind in registry.parts}
    builder.mistakes += _missing(tables, registry, ("device", "model", "estimator") if estimates else ("device",))
    builder.mistakes += _wrong_signals(tables, stated, kinds["device"], safety)
    use, problems = calibration_of(run, stated, registry) if estimates else (None, [])
    builder.mistakes += [*problems, *_wrong_uncertainties(run, kinds["model"])]
    alignment = stated
    if use and stated:
        alignment = use.alignment(stated)
        kinds["estimator"] = {name: use.estimator(part) for name, part in kinds["estimator"].items()}
    tracks, lost = _tracks(run or RunSettings(), kinds["model"], kinds["estimator"])
    if estimates and not builder.mistakes:
        builder.mistakes += lost
    if safety and alignment and not builder.mistakes:
        builder.mistakes += contradictions(safety, alignment, kinds["device"])
        safety = wired(safety, alignment, kinds["device"])
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
        sinks=kinds["sink"],
        twins=kinds["twin"],
        safety=safety,
        tracks=tracks,
        registry=registry,
        calibration=use,
        tables=extra,
        stated=stated,
        renamed=renamed,
    )
    assumed = still_assumed(run.assumed, pipeline, source.overridden)
    return replace(pipeline, run=run.model_copy(update={"assumed": assumed})) if run.assumed else pipeline


def _begun(source: Source) -> tuple[Builder, Registry, RunSettings | None, tuple[Flag, ...]]:
    """A source in the names of today, with the plugins that it asks for; its builder, and what was renamed."""
    tables, base = source.tables, source.path.parent
    renamed = migrate(source, MIGRATIONS)
    first = Builder(tables, Registry({}), base)
    run = first.settings(RunSettings, ("run",))
    demand_trust(run.plugins if run else (), base)
    registry = registries.load(run.plugins if run else ())
    renamed += migrate(source, registry.migrations)
    builder = Builder(tables, registry, base)
    builder.mistakes += first.mistakes + unknown_tables(tables, registry)
    return builder, registry, run, renamed


def _wrong_signals(
    tables: Mapping[str, Any],
    alignment: AlignmentSettings | None,
    devices: Mapping[str, Device],
    safety: SafetySettings | None,
) -> list[Mistake]:
    """Channels that are none, and wires that cannot be; nothing where not all devices could be built."""
    if not alignment or not isinstance(tables.get("device"), dict) or len(devices) != len(tables["device"]):
        return []
    return wrong_channels(alignment, devices) or wrong_wiring(ports_of(alignment, devices), safety)


def _wrong_uncertainties(run: RunSettings | None, models: Mapping[str, ContactModel]) -> list[Mistake]:
    unknown = unknown_sources(models, run.uncertainties) if run and models else {}
    return [Mistake(("run", "uncertainties", name), problem) for name, problem in unknown.items()]


def build_parts(source: Source, kind: str, registry: Registry | None = None) -> dict[str, Any]:
    """The parts of one kind in a source, whatever else it lacks; raises like `load_pipeline`.

    Without a registry it is that of the installed plugins and of those that the source names.
    """
    base = source.path.parent
    if registry is None:
        first = Builder(source.tables, Registry({}), base)
        run = first.settings(RunSettings, ("run",))
        raise_mistakes(first.mistakes, source)
        demand_trust(run.plugins, base)
        registry = registries.load(run.plugins)
    migrate(source, (*MIGRATIONS, *registry.migrations))
    builder = Builder(source.tables, registry, base)
    found = builder.parts(kind)
    raise_mistakes(builder.mistakes, source)
    registry.demand_sound({kind: found})
    return found


def _missing(tables: Mapping[str, Any], registry: Registry, needed: tuple[str, ...]) -> list[Mistake]:
    missing = [kind for kind in needed if not tables.get(kind)]
    alignment = Mistake((), "the table [alignment] is missing: it says which channel is the force")
    return [alignment] * ("alignment" not in tables) + [
        Mistake(
            (), f"a pipeline needs at least one [{kind}.*] table (there are: {', '.join(sorted(registry.parts[kind]))})"
        )
        for kind in missing
    ]


def _tracks(
    run: RunSettings, models: Mapping[str, ContactModel], estimators: Mapping[str, Estimator]
) -> tuple[tuple[Track, ...], list[Mistake]]:
    every = [
        Track(TrackName(m, e), model, estimator) for m, model in models.items() for e, estimator in estimators.items()
    ]
    mistakes = []
    for pattern in run.tracks:
        if not any(fnmatchcase(track.name, pattern) for track in every):
            names = [track.name for track in every]
            mistakes.append(Mistake(("run", "tracks"), f"no track is called {pattern!r}{suggest(pattern, names)}"))
    chosen = tuple(track for track in every if any(fnmatchcase(track.name, pattern) for pattern in run.tracks))
    return chosen, mistakes
