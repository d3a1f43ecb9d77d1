"""A pipeline: everything that one TOML file wires together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from pydantic import Field

from palpate import registry as registries
from palpate.alignment import SIGNAL_UNITS, AlignmentSettings, Signal
from palpate.calibration import CalibrationSettings, CalibrationUse, read_calibration
from palpate.config.builder import Builder, unknown_tables
from palpate.config.conformance import check_tips
from palpate.config.mistakes import Mistake, raise_mistakes
from palpate.config.source import Source
from palpate.contact import ContactModel, Indenter
from palpate.design import DesignSettings
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
    calibration: File | None = Field(
        default=None, description="calibration file: mass, tare, timing and noise that this file leaves open"
    )
    calibration_valid: Time = Field(default=30 * 86400.0, gt=0, description="an older calibration is flagged")
    seed: int = Field(default=0, ge=0, description="seed of everything that plays dice")
    average: Time = Field(default=1.0, ge=0.05, description="results are means over so much time at the end")
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
    calibration: CalibrationUse | None = None
    design: DesignSettings = field(default_factory=DesignSettings)
    stated: AlignmentSettings | None = None  # the alignment as the file has it, without the calibration


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
    design = builder.settings(DesignSettings, ("design",))
    builder.settings(CalibrationSettings, ("calibration",))
    safety = builder.settings(SafetySettings, ("safety",)) if "safety" in tables else None
    kinds = {kind: builder.parts(kind) for kind in registry.parts}
    builder.mistakes += _missing_kinds(tables, registry)
    if alignment and len(kinds["device"]) == len(tables.get("device", {})):
        builder.mistakes += wrong_channels(alignment, kinds["device"])
    stated = alignment
    use, problems = _calibration(run, alignment)
    builder.mistakes += problems
    if use and alignment:
        alignment = use.alignment(alignment)
        kinds["estimator"] = {name: use.estimator(part) for name, part in kinds["estimator"].items()}
    tracks, lost = _tracks(run or RunSettings(), kinds["model"], kinds["estimator"])
    if not builder.mistakes:
        builder.mistakes += lost
    raise_mistakes(builder.mistakes, source)
    check_tips((*kinds["indenter"].values(), *kinds["model"].values(), *kinds["device"].values()), registry)
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
        use,
        design,
        stated,
    )


def _calibration(
    run: RunSettings | None, alignment: AlignmentSettings | None
) -> tuple[CalibrationUse | None, list[Mistake]]:
    if run is None or run.calibration is None:
        if alignment is not None and alignment.tare == "calibrated":
            problem = 'is "calibrated", but [run] names no calibration'
            return None, [Mistake(("alignment", "tare"), problem)]
        return None, []
    try:
        calibration = read_calibration(run.calibration)
    except PalpateError as error:
        return None, [Mistake(("run", "calibration"), f"{error}; `palpate calibrate` makes one")]
    if alignment is not None and alignment.tare == "calibrated" and "offset" not in calibration.values:
        return None, [Mistake(("alignment", "tare"), 'is "calibrated", but the calibration holds no offset')]
    return CalibrationUse(calibration, str(run.calibration), run.calibration_valid), []


def _missing_kinds(tables: Mapping[str, Any], registry: Registry) -> list[Mistake]:
    missing = [kind for kind in ("device", "model", "estimator") if not tables.get(kind)]
    return [
        Mistake(
            (), f"a pipeline needs at least one [{kind}.*] table (there are: {', '.join(sorted(registry.parts[kind]))})"
        )
        for kind in missing
    ]


def wrong_channels(alignment: AlignmentSettings, devices: Mapping[str, Device]) -> list[Mistake]:
    """A mistake for every role whose channel no device has."""
    mistakes = []
    units: dict[str, str] = {}
    for name, device in devices.items():
        try:
            units |= {address(name, stream, c): c.unit for stream in device.streams for c in stream.channels}
        except PalpateError as error:
            mistakes.append(Mistake(("device", name), str(error)))
    if mistakes:
        return mistakes
    for role in AlignmentSettings.model_fields:
        signal = getattr(alignment, role)
        if not isinstance(signal, Signal):
            continue
        wanted = SIGNAL_UNITS.get(role)
        if signal.channel not in units:
            problem = f"no device has a channel {signal.channel!r}{suggest(signal.channel, units)}"
            mistakes.append(Mistake(("alignment", role), problem))
        elif wanted is not None and units[signal.channel] not in (wanted, "1"):
            problem = f"{signal.channel!r} is in {units[signal.channel]}, but {role} is wanted in {wanted}"
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
