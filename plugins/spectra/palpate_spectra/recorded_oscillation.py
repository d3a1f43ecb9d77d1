"""What a spectrum is made of: a recorded oscillation in contact, and what its pipeline declares of the rig."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from palpate import ConfigurationError, ContactModel, Flag, Floats, LogError, Samples, suggest
from palpate_engine import Pipeline, UncertainValue, build_pipeline, load_pipeline
from palpate_kit.runs.continuation import recorded_pipeline
from palpate_kit.runs.replay_source import read_run_log, replay_source
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.runs.sample_observer import SampleObserver
from palpate_kit.terminal.progress import progress, report_progress

_LEAST = 200  # samples
_GAP = 2.5  # of the usual interval
_AIR = 50  # samples in air from which on the touch is known
_RESOLVED = 0.4  # of the way from the touch to five times the noise
_MASS = 0.05  # of itself, where no uncertainty of the tip's mass is declared
_STIFFNESS = 0.1  # of itself: the uncertainty of a rig's stiffness is never declared


# Of what the run itself flags: what counts against the readings or the surface, not against the model of its track.
_CONCERNING = {
    "gaps", "missing-force", "saturated", "assumed", "stuck", "duplicates", "backwards", "clock-wander", "clock-drift",
    "rate-contradicted", "wrong-stamps",
    "force-late", "velocity-late", "outliers", "calibration-old", "calibration-sensor", "calibration-tip",
    "calibration-mass", "calibration-delay", "surface-mismatch", "beyond-model-range", "diverged", "implausible",
}  # fmt: skip


@dataclass(frozen=True)
class RecordedOscillation:
    """One recording of an oscillation in contact."""

    name: str
    track: str
    model: ContactModel  # of which tip, layer and Poisson's ratio are taken
    time: Floats  # (n,) [s]
    force: Floats  # (n,) [N] that the sensor felt: contact, and inertia of the tip
    height: Floats  # (n,) [m] of the arm's tip as measured
    surface: float  # [m]
    surface_std: float  # [m]
    tip_mass: float = 0.0  # [kg]
    tip_mass_std: float = 0.0  # [kg]
    compliance: float = 0.0  # [m/N] of robot and sensor
    compliance_std: float = 0.0  # [m/N]
    timing: float | None = None  # [s] standard uncertainty between force and motion; None: not declared
    uncertainties: Mapping[str, Any] = field(default_factory=dict)  # declared, by key of the model
    flags: tuple[Flag, ...] = ()

    def cut(self, rows: slice) -> RecordedOscillation:
        """Return some of its rows."""
        return replace(self, time=self.time[rows], force=self.force[rows], height=self.height[rows])


def read_oscillation(path: Path, track: str | None, surface: float | None = None) -> RecordedOscillation:
    """The oscillation of a run folder, of a log that carries its pipeline, or of a pipeline file without a live device.

    Its samples are made again from the readings; the height of the skin is that of the track unless a `surface` [m] is
    given. Raises UserError.
    """
    replayed = replay(path, track)
    samples, name = replayed.samples, replayed.track
    known, rows = _stretch(samples, path)
    found = replayed.surface
    height = found.value if surface is None else surface
    if not math.isfinite(height):
        raise LogError(f"{path}: {name} found no surface; give its height with --surface")
    return RecordedOscillation(
        str(path), name, replayed.model, known.time[rows], known.force[rows], known.position[rows], height,
        _surface_std(found.combined, samples, height) if surface is None else 0.0,
        **replayed.rig, uncertainties=replayed.uncertainties, flags=replayed.flags,
    )  # fmt: skip


@dataclass(frozen=True)
class ReplayedSamples:
    """The samples of a recording, made again, and what its pipeline declares."""

    track: str
    model: ContactModel
    samples: Samples
    surface: UncertainValue  # that the track found
    rig: Mapping[str, Any]  # mass, compliance and timing, as `Recorded` has them
    uncertainties: Mapping[str, Any]
    flags: tuple[Flag, ...]  # that concern readings and surface


def replay(path: Path, track: str | None) -> ReplayedSamples:
    """Return a run folder, a log that carries its pipeline, or a pipeline file without a live device; raises
    UserError."""
    pipeline = _pipeline(path, track)
    if live := [name for name, device in pipeline.devices.items() if device.live]:
        raise ConfigurationError(f"{path}: device {', '.join(live)} is live; record first: palpate run {path}")
    from palpate_engine import run_pipeline

    kept = SampleObserver()
    with tempfile.TemporaryDirectory() as folder, progress(str(path), "s"):
        result = run_pipeline(pipeline, Path(folder) / "run", report_progress, kept)
        result.demand_whole()
    name = next(iter(result.tracks))
    found = result.tracks[name]
    model = next(one.model for one in pipeline.tracks if str(one.name) == name)
    if not kept.blocks:
        raise LogError(f"{path}: has no samples")
    flags = tuple(flag for flag in (*result.flags, *found.flags) if flag.code in _CONCERNING)
    return ReplayedSamples(
        name, model, Samples.joined(kept.blocks), found.surface, _rig(pipeline), pipeline.run.uncertainties, flags
    )


def _pipeline(path: Path, track: str | None) -> Pipeline:
    """Return the pipeline of a recording, with the one requested track."""
    if path.suffix == ".toml":
        name = _track(load_pipeline(path), track, path)
        return load_pipeline(path, [f'run.tracks=["{name}"]'])
    carried = None
    try:
        carried = read_run_log(path)
    except LogError:
        if not (path.is_dir() and RunFolder(path).began):
            raise
    if carried is not None:
        name = _track(build_pipeline(replay_source(carried)), track, path)
        return build_pipeline(replay_source(carried, [name]))
    if not (path.is_dir() and RunFolder(path).began):
        raise LogError(f"{path}: is neither a run folder nor a log that carries the pipeline of its run")
    name = _track(recorded_pipeline(path), track, path)
    return recorded_pipeline(path, [f'run.tracks=["{name}"]'])


def _track(pipeline: Pipeline, wanted: str | None, path: Path) -> str:
    """Return the requested track, or the first whose model has a tip."""
    names = [str(track.name) for track in pipeline.tracks]
    if wanted is not None and wanted not in names:
        raise ConfigurationError(f"{path}: has no track {wanted!r}{suggest(wanted, names)}")
    tipped = [str(track.name) for track in pipeline.tracks if has_tip(track.model)]
    chosen = [name for name in tipped if wanted in (None, name)]
    if not chosen:
        said = f"the model of {wanted}" if wanted else "no model"
        raise ConfigurationError(f"{path}: {said} has {'no' if wanted else 'a'} tip, so that no modulus follows")
    return chosen[0]


def has_tip(model: ContactModel) -> bool:
    """Return True if a model declares its tip, and Poisson's ratio."""
    return getattr(model, "indenter", None) is not None and hasattr(model, "poisson")


def _stretch(samples: Samples, path: Path) -> tuple[Samples, slice]:
    """Samples that are meant for estimation and whole, and the longest stretch of them without a gap."""
    whole = samples.active & np.isfinite(samples.force) & np.isfinite(samples.position)
    known = samples[whole]
    if len(known) < _LEAST:
        raise LogError(f"{path}: has {len(known)} samples in contact; a spectrum needs {_LEAST}")
    step = np.diff(known.time)
    edges = [0, *(np.flatnonzero(step > _GAP * float(np.median(step))) + 1).tolist(), len(known)]
    lengths = np.diff(edges)
    longest = int(np.argmax(lengths))
    if lengths[longest] < _LEAST:
        raise LogError(f"{path}: its longest stretch without a gap has {lengths[longest]} samples, {_LEAST} are needed")
    return known, slice(edges[longest], edges[longest + 1])


def _surface_std(std: float, samples: Samples, surface: float) -> float:
    """Return the track's own uncertainty, and how far the skin lay from there when the force first showed it.

    A track's surface is that of its model, and a relaxing material moves it by more than the track's uncertainty.
    """
    return math.hypot(std if math.isfinite(std) else 0.0, beyond(touch_of(samples), surface))


def beyond(touch: tuple[float, float] | None, surface: float) -> float:
    """Return how much farther [m] a surface is from the touch than the touch allows; 0 where that is unknown."""
    return 0.0 if touch is None else max(abs(touch[0] - surface) - touch[1], 0.0)


def touch_of(samples: Samples) -> tuple[float, float] | None:
    """Height of the first touch [m] and how far off the skin may be [m]; None of a record without free air.

    The touch is known to the depth at which the force is as large as its noise: some 0.4 of the depth at which it is
    five times as large (of a force that goes with d^1.5).
    """
    touched = np.flatnonzero(samples.contact)
    if not len(touched) or touched[0] < _AIR:
        return None
    first = int(touched[0])
    air = samples.force[:first][np.isfinite(samples.force[:first])]
    if len(air) < _AIR // 2:
        return None
    noise = float(np.std(np.diff(air)) / math.sqrt(2))
    risen = np.flatnonzero(samples.force[first:] - float(np.median(air)) > 5 * noise)
    if not len(risen):
        return None
    there = float(np.nanmean(samples.position[first - 1 : first + 1]))
    return there, _RESOLVED * abs(float(samples.position[first + risen[0]]) - there)


def _rig(pipeline: Pipeline) -> dict[str, Any]:
    """Mass, compliance and timing, with what is not declared of them."""
    aligned = pipeline.alignment
    mass, mass_std = aligned.tip_mass or 0.0, aligned.tip_mass_uncertainty
    compliance = 1.0 / aligned.series_stiffness if aligned.series_stiffness else 0.0
    timing = [s.uncertainty for s in (aligned.force, aligned.position) if s.uncertainty is not None]
    return {
        "tip_mass": mass, "tip_mass_std": _MASS * mass if mass_std is None else mass_std,
        "compliance": compliance, "compliance_std": _STIFFNESS * compliance,
        "timing": math.hypot(*timing) if timing else None,
    }  # fmt: skip
