"""Pipelines: all that one TOML file wires together, as an object."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

from palpate.contact import ContactModel, Indenter
from palpate.device import Device, truth_of
from palpate.estimation import Estimator
from palpate.flags import Flag
from palpate.parts import File, InputFile, Settings
from palpate.registry import Registry
from palpate.sink import Sink
from palpate.surface import Surface
from palpate.trajectory import Trajectory
from palpate.twin import Twin
from palpate.units import Time
from pydantic import Field

from palpate_engine.alignment import Aligner, AlignmentSettings, Ports
from palpate_engine.config.signal_wiring import ports_of
from palpate_engine.config.stated_truth import stated_truth
from palpate_engine.safety import SafetySettings
from palpate_engine.track_name import TrackName

MICRO_TIP_RADIUS = 5e-4  # [m] below which nothing of weight hangs behind the sensor: a choice (0375)
MAX_TIP_MASS = 1.0  # [kg] that the inertia of a larger tip may have: a choice (0375)
_MONTH = 30 * 86400.0  # [s] for which a calibration and a check hold unless a file says otherwise: a choice


def sphere_radii(models: Mapping[str, ContactModel]) -> set[float]:
    """Return the radii [m] of the tips of some models that are spheres."""
    tips = [getattr(model, "indenter", None) for model in models.values()]
    return {tip.sphere_radius for tip in tips if isinstance(tip, Indenter) and tip.sphere_radius is not None}


class RunSettings(Settings):
    """The ``[run]`` table: what concerns the run as a whole."""

    name: str = Field(default="run", min_length=1, description="what the run is called, in its folder and its tables")
    tracks: tuple[str, ...] = Field(
        default=("*",), description='which model/estimator pairs run, as patterns: "dr/*", "*/ekf"'
    )
    base: tuple[File, ...] = Field(
        default=(),
        description='files with the tables of a rig that this one shares, such as ["lab.toml"]; its own keys win',
    )
    plugins: tuple[File, ...] = Field(default=(), description="Python files next to the pipeline with your own parts")
    distributions: tuple[str, ...] = Field(
        default=(),
        description='installed distributions, with versions, whose parts the pipeline has: ["palpate-punch 1.0"]; '
        "resolved pipelines state them",
    )
    rig: InputFile | None = Field(
        default=None,
        description="file of facts of rig and specimens (`rig.toml`): what this file leaves open of tip, delay, mass, "
        "tare, thickness and Poisson's ratio, and what `palpate calibrate` has measured",
    )
    dialect: str | None = Field(
        default=None, description="which [dialect.NAME] stands in place of the file's own tables, to read other files"
    )
    calibration: InputFile | None = Field(
        default=None, description="calibration file: mass, tare, timing and noise that this file leaves open"
    )
    calibration_valid: Time = Field(default=_MONTH, gt=0, description="an older calibration is flagged")
    control: InputFile | None = Field(
        default=None,
        description="control chart of `palpate calibrate control`: the check of the rig that stands behind the run",
    )
    control_valid: Time = Field(default=_MONTH, gt=0, description="an older check is called old")
    seed: int = Field(default=0, ge=0, description="seed of everything that is random")
    average: Time = Field(default=1.0, ge=0.05, description="results are means over so much time at the end")
    uncertainties: dict[str, float | str] = Field(
        default={},
        description="standard uncertainties of what is assumed exact, by key of the models and their tips, or "
        '"force_scale", "position_scale": { radius = "20 um", poisson = 0.01, force_scale = 0.005 }; not declared: '
        "a radius to 0.5 %, Poisson's ratio within 0.02 below its value",
    )
    truth: dict[str, float | str] = Field(
        default={},
        description="true values of the specimen by name, with which results are compared: { elasticity = "
        '"112.5 kPa" }; no estimator reads them; a simulated rig states its own',
    )
    assumed: tuple[str, ...] = Field(
        default=(),
        description='keys whose values are assumed, as patterns: "indenter.*", "alignment.tip_mass"; they are '
        "flagged until they are taken out of here, or set on the command line",
    )
    rehearsal: str | None = Field(
        default=None,
        min_length=1,
        description="the [twin.NAME] in whose simulated time the run is made, never by its devices; `palpate rehearse` "
        "writes it",
    )
    curves: File | None = Field(
        default=None,
        description="of a folder of fits: the folder of its curves, from which `curves.csv` names their files",
    )
    report: bool = Field(default=False, description="write a report when the run has ended")
    estimates_interval: Time = Field(
        default=0.01, ge=0, description="estimates.csv has one row in so much time; 0: every sample"
    )


class CalibratedNumber(Protocol):
    """A number of a calibration."""

    @property
    def value(self) -> float:
        """In its unit [SI]."""
        ...

    @property
    def std(self) -> float:
        """Combined standard uncertainty."""
        ...


class CalibrationUse(Protocol):
    """A calibration that a pipeline names."""

    @property
    def values(self) -> Mapping[str, CalibratedNumber]:
        """Return its numbers by name: mass, delay, offset, force_std, ..."""
        ...

    def offset_doubt(self, pipeline: Pipeline, live: Mapping[str, Mapping[str, Any]]) -> Flag | None:
        """Return why its offset need not be that of the sensor as it is now; None where it is."""
        ...

    def alignment(self, settings: AlignmentSettings) -> AlignmentSettings:
        """Return the settings with what the calibration knows wherever the file leaves them open."""
        ...

    def estimator(self, estimator: Any) -> Any:
        """Return an estimator with the calibration's noise wherever it has such a setting and the file leaves it
        open."""
        ...

    def flags(self, pipeline: Pipeline, live: Mapping[str, Mapping[str, Any]]) -> Iterable[Flag]:
        """Return the flags against its use; `live` is the health that connected devices report, by name."""
        ...


class ControlUse(Protocol):
    """A control chart that a pipeline names, with the check that stands behind a run."""

    def facts(self, started: datetime) -> Mapping[str, Any]:
        """Return the last check for ``run.control`` of result.json; its age is that when the run started."""
        ...

    def flags(self, pipeline: Pipeline, live: Mapping[str, Mapping[str, Any]]) -> Iterable[Flag]:
        """Return the flags against it; `live` is the health that connected devices report, by name."""
        ...


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
    surfaces: Mapping[str, Surface]
    sinks: Mapping[str, Sink]
    twins: Mapping[str, Twin]
    safety: SafetySettings | None
    tracks: tuple[Track, ...]
    registry: Registry
    calibration: CalibrationUse | None = None
    control: ControlUse | None = None
    tables: Mapping[str, Settings] = field(default_factory=dict)  # those of analyses that the file has, by name
    stated: AlignmentSettings | None = None  # the alignment as the file has it, without the calibration
    inherited: Mapping[str, str] = field(default_factory=dict)  # ``file:line`` of each key that a base states
    looser_limits: tuple[str, ...] = ()  # sentences on limits of [safety] that are looser than those of a base

    @property
    def notices(self) -> tuple[str, ...]:
        """Return what a reader should know although nothing is wrong: of plugins, and of looser limits."""
        return (*self.registry.notices, *self.looser_limits)

    @property
    def ports(self) -> Ports:
        """Return the ports at which the signals are read."""
        return self._ports

    @property
    def truth(self) -> dict[str, float]:
        """Return the true values by name [SI]: those of the simulated device that is read, else those stated."""
        roles = self.ports.roles
        names = {roles[role].device for role in ("force", "position", "velocity") if role in roles}
        simulated_truth = truth_of({name: device for name, device in self.devices.items() if name in names})
        return {**stated_truth(self.models, self.run.truth), **simulated_truth}

    @property
    def tip_radius(self) -> float:
        """Radius [m] of the sphere that the tip is; 0 of another shape, whose place is that of its end."""
        return max(sphere_radii(self.models), default=0.0)

    @property
    def most_mass(self) -> float:
        """Mass [kg] that may hang behind the sensor at most: none behind a tip of less than half a millimetre."""
        radii = [getattr(tip, "radius", None) for tip in self.indenters.values()]
        small = bool(radii) and all(radius is not None and radius < MICRO_TIP_RADIUS for radius in radii)
        return 0.0 if small or self.alignment.tip_mass == 0 else MAX_TIP_MASS

    def new_aligner(self) -> Aligner:
        """Return the aligner of one run, which joins the streams of the devices."""
        return Aligner(self.alignment, self.ports, self.tip_radius, self.most_mass)

    @cached_property
    def _ports(self) -> Ports:
        return ports_of(self.alignment, self.devices)
