"""A pipeline: everything that one TOML file wires together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from pydantic import Field

from palpate import registry as registries
from palpate.alignment import AlignmentSettings, Signal
from palpate.config.builder import Builder, unknown_tables
from palpate.config.mistakes import Mistake, raise_mistakes
from palpate.config.source import Source
from palpate.contact import ContactModel, Indenter
from palpate.device import Device, address
from palpate.errors import PalpateError
from palpate.estimation import Estimator
from palpate.parts import File, Settings
from palpate.registry import Registry, suggest
from palpate.safety import SafetySettings
from palpate.sink import Sink
from palpate.trajectory import Trajectory
from palpate.twin import Twin
from palpate.units import Time


class RunSettings(Settings):
    """The ``[run]`` table: what concerns the run as a whole."""

    name: str = Field(default="run", min_length=1, description="what the run is called, in its folder and its tables")
    tracks: tuple[str, ...] = Field(
        default=("*",), description='which model/estimator pairs run, as patterns: "dr/*", "*/ekf"'
    )
    plugins: tuple[File, ...] = Field(default=(), description="Python files beside the pipeline with parts of your own")
    seed: int = Field(default=0, ge=0, description="seed of everything that plays dice")
    average: Time = Field(default=1.0, ge=0, description="results are means over the last so many seconds of estimates")
    estimates_interval: Time = Field(
        default=0.01, ge=0, description="estimates.csv has one row in so much time; 0: every sample"
    )


@dataclass(frozen=True)
class Track:
    """A contact model and an estimator, side by side with other tracks on the same samples."""

    name: str  # "dr/ekf"
    model: ContactModel
    estimator: Estimator


@dataclass(frozen=True)
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


def load_pipeline(path: Path, overrides: Iterable[str] = ()) -> Pipeline:
    """The pipeline in a file, with ``table.key=value`` overrides on top.

    Raises ConfigurationError with every mistake at once, each with its line; PluginError where a plugin fails.
    """
    source = Source.read(path)
    for assignment in overrides:
        source.override(assignment)
    return build_pipeline(source)


def build_pipeline(source: Source) -> Pipeline:
    """The pipeline in a source; raises like `load_pipeline`."""
    tables, base = source.tables, source.path.parent
    first = Builder(tables, Registry({}), base)
    run = first.settings(RunSettings, ("run",))
    registry = registries.load(run.plugins if run else ())
    builder = Builder(tables, registry, base)
    builder.mistakes += first.mistakes + unknown_tables(tables)
    alignment = None
    if "alignment" in tables:
        alignment = builder.settings(AlignmentSettings, ("alignment",))
    else:
        builder.mistakes.append(Mistake((), "the table [alignment] is missing: it says which channel is the force"))
    safety = builder.settings(SafetySettings, ("safety",)) if "safety" in tables else None
    kinds = {kind: builder.parts(kind) for kind in registry.parts}
    builder.mistakes += _missing_kinds(tables, registry)
    if alignment and len(kinds["device"]) == len(tables.get("device", {})):
        builder.mistakes += _wrong_channels(alignment, kinds["device"])
    tracks, lost = _tracks(run or RunSettings(), kinds["model"], kinds["estimator"])
    if not builder.mistakes:
        builder.mistakes += lost
    raise_mistakes(builder.mistakes, source)
    assert alignment is not None
    return Pipeline(
        source.path,
        source.text,
        run,
        alignment,
        kinds["indenter"],
        kinds["model"],
        kinds["estimator"],
        kinds["device"],
        kinds["trajectory"],
        kinds["sink"],
        kinds["twin"],
        safety,
        tracks,
        registry,
    )


def _missing_kinds(tables: Mapping[str, Any], registry: Registry) -> list[Mistake]:
    missing = [kind for kind in ("device", "model", "estimator") if not tables.get(kind)]
    return [
        Mistake(
            (), f"a pipeline needs at least one [{kind}.*] table (there are: {', '.join(sorted(registry.parts[kind]))})"
        )
        for kind in missing
    ]


def _wrong_channels(alignment: AlignmentSettings, devices: Mapping[str, Device]) -> list[Mistake]:
    mistakes = []
    channels: list[str] = []
    for name, device in devices.items():
        try:
            channels += [address(name, stream, channel) for stream in device.streams for channel in stream.channels]
        except PalpateError as error:
            mistakes.append(Mistake(("device", name), str(error)))
    if mistakes:
        return mistakes
    for role in AlignmentSettings.model_fields:
        signal = getattr(alignment, role)
        if isinstance(signal, Signal) and signal.channel not in channels:
            problem = f"no device has a channel {signal.channel!r}{suggest(signal.channel, channels)}"
            mistakes.append(Mistake(("alignment", role), problem))
    return mistakes


def _tracks(
    run: RunSettings, models: Mapping[str, ContactModel], estimators: Mapping[str, Estimator]
) -> tuple[tuple[Track, ...], list[Mistake]]:
    every = [Track(f"{m}/{e}", model, estimator) for m, model in models.items() for e, estimator in estimators.items()]
    mistakes = []
    for pattern in run.tracks:
        if not any(fnmatchcase(track.name, pattern) for track in every):
            names = [track.name for track in every]
            mistakes.append(Mistake(("run", "tracks"), f"no track is called {pattern!r}{suggest(pattern, names)}"))
    chosen = tuple(track for track in every if any(fnmatchcase(track.name, pattern) for pattern in run.tracks))
    return chosen, mistakes
