"""The plan of a calibration: devices, channels, motion and tip of a file; it may name models and filters or not."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from palpate import registry as registries
from palpate.alignment import AlignmentSettings
from palpate.calibration import CalibrationSettings
from palpate.config.builder import Builder, unknown_tables
from palpate.config.mistakes import Mistake, raise_mistakes
from palpate.config.pipeline_file import RunSettings, wrong_channels
from palpate.config.source import Source
from palpate.contact import Indenter
from palpate.device import Device
from palpate.registry import Registry
from palpate.safety import SafetySettings
from palpate.trajectory import Trajectory


@dataclass(frozen=True)
class CalibrationPlan:
    """What a calibration needs of a file."""

    path: Path
    run: RunSettings
    alignment: AlignmentSettings
    settings: CalibrationSettings
    devices: Mapping[str, Device]
    trajectories: Mapping[str, Trajectory]
    indenters: Mapping[str, Indenter]
    safety: SafetySettings | None
    registry: Registry


def load_plan(path: Path, overrides: Iterable[str] = ()) -> CalibrationPlan:
    """The calibration plan in a file; raises ConfigurationError with every mistake at once, each with its line."""
    source = Source.read(path)
    for assignment in overrides:
        source.override(assignment)
    tables, base = source.tables, path.parent
    first = Builder(tables, Registry({}), base)
    run = first.settings(RunSettings, ("run",))
    registry = registries.load(run.plugins if run else ())
    builder = Builder(tables, registry, base)
    builder.mistakes += first.mistakes + unknown_tables(tables)
    if "alignment" not in tables:
        builder.mistakes.append(Mistake((), "the table [alignment] is missing: it says which channel is the force"))
    if not tables.get("device"):
        builder.mistakes.append(Mistake((), "a calibration needs at least one [device.*] table"))
    alignment = builder.settings(AlignmentSettings, ("alignment",)) if "alignment" in tables else None
    settings = builder.settings(CalibrationSettings, ("calibration",))
    kinds = {kind: builder.parts(kind) for kind in ("device", "trajectory", "indenter")}
    if alignment and len(kinds["device"]) == len(tables.get("device", {})):
        builder.mistakes += wrong_channels(alignment, kinds["device"])
        for name, step in settings.steps.items() if settings else ():
            mistakes = wrong_channels(alignment, step.device) if step.device else []
            builder.mistakes += [Mistake(("calibration", name, "device"), mistake.problem) for mistake in mistakes]
    safety = builder.settings(SafetySettings, ("safety",)) if "safety" in tables else None
    raise_mistakes(builder.mistakes, source)
    assert alignment is not None
    parts = (kinds["device"], kinds["trajectory"], kinds["indenter"])
    return CalibrationPlan(path, run, alignment, settings, *parts, safety, registry)
