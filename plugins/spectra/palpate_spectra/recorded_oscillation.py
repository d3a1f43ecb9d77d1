"""A recorded oscillation in contact, from which a spectrum is made, and the rig that its pipeline declares."""

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

from palpate_spectra.first_touch import excess_distance, first_touch

# Choices, as docs/spectrum.md states those that a user meets.
_MIN_SAMPLES = 200  # in contact without a gap
_GAP_INTERVALS = 2.5  # of the usual interval: a longer one between two samples is a gap
_MASS_STD_SHARE = 0.05  # of the tip's mass, where no uncertainty of it is declared
_COMPLIANCE_STD_SHARE = 0.1  # of a rig's compliance, whose uncertainty is never declared


# Flags of the run that count against the readings or the surface, and not against the model of its track.
_READING_FLAGS = {
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
        """Return the recording of some of its rows."""
        return replace(self, time=self.time[rows], force=self.force[rows], height=self.height[rows])


def read_oscillation(path: Path, track: str | None, surface: float | None = None) -> RecordedOscillation:
    """Return the oscillation of a run folder, of a log with its pipeline, or of a pipeline file without a live device.

    Its samples are made again from the readings; the height of the skin is that of the track unless a `surface` [m] is
    stated. Raises UserError.
    """
    replayed = replay(path, track)
    samples, rows = _longest_contact(replayed.samples, path)
    height = replayed.surface.value if surface is None else surface
    if not math.isfinite(height):
        raise LogError(f"{path}: {replayed.track} found no surface; give its height with --surface")
    surface_std = _surface_std(replayed.surface.combined, replayed.samples, height) if surface is None else 0.0
    return RecordedOscillation(
        name=str(path),
        track=replayed.track,
        model=replayed.model,
        time=samples.time[rows],
        force=samples.force[rows],
        height=samples.position[rows],
        surface=height,
        surface_std=surface_std,
        **replayed.rig,
        uncertainties=replayed.uncertainties,
        flags=replayed.flags,
    )


@dataclass(frozen=True)
class ReplayedSamples:
    """The samples of a recording, made again, and what its pipeline declares."""

    track: str
    model: ContactModel
    samples: Samples
    surface: UncertainValue  # that the track found
    rig: Mapping[str, Any]  # mass, compliance and timing, as `RecordedOscillation` has them
    uncertainties: Mapping[str, Any]
    flags: tuple[Flag, ...]  # that concern readings and surface


def replay(path: Path, track_name: str | None) -> ReplayedSamples:
    """Return the samples of a run folder, a log with its pipeline, or a pipeline file without a live device.

    Without a track's name the first track counts whose model has a tip. Raises UserError.
    """
    pipeline = _track_pipeline(path, track_name)
    if live := [name for name, device in pipeline.devices.items() if device.live]:
        raise ConfigurationError(f"{path}: device {', '.join(live)} is live; record first: palpate run {path}")
    from palpate_engine import run_pipeline

    observer = SampleObserver()
    with tempfile.TemporaryDirectory() as folder, progress(str(path), "s"):
        result = run_pipeline(pipeline, Path(folder) / "run", report_progress, observer)
        result.demand_whole()
    name = next(iter(result.tracks))
    track_result = result.tracks[name]
    model = next(track.model for track in pipeline.tracks if str(track.name) == name)
    if not observer.blocks:
        raise LogError(f"{path}: has no samples")
    flags = tuple(flag for flag in (*result.flags, *track_result.flags) if flag.code in _READING_FLAGS)
    return ReplayedSamples(
        track=name,
        model=model,
        samples=Samples.joined(observer.blocks),
        surface=track_result.surface,
        rig=_declared_rig(pipeline),
        uncertainties=pipeline.run.uncertainties,
        flags=flags,
    )


def _track_pipeline(path: Path, track_name: str | None) -> Pipeline:
    """Return the pipeline of a pipeline file, log or run folder, with one track alone (see `_choose_track`).

    Raises LogError for any other file.
    """
    if path.suffix == ".toml":
        name = _choose_track(load_pipeline(path), track_name, path)
        return load_pipeline(path, [f'run.tracks=["{name}"]'])
    # A log counts before the folder of a run that has begun: it has the readings and the pipeline.
    is_run_folder = path.is_dir() and RunFolder(path).began
    run_log = None
    try:
        run_log = read_run_log(path)
    except LogError:
        if not is_run_folder:
            raise
    if run_log is not None:
        name = _choose_track(build_pipeline(replay_source(run_log)), track_name, path)
        return build_pipeline(replay_source(run_log, [name]))
    if not is_run_folder:
        raise LogError(f"{path}: is neither a run folder nor a log that carries the pipeline of its run")
    name = _choose_track(recorded_pipeline(path), track_name, path)
    return recorded_pipeline(path, [f'run.tracks=["{name}"]'])


def _choose_track(pipeline: Pipeline, requested: str | None, path: Path) -> str:
    """Return the requested track, or the first whose model has a tip; raises ConfigurationError where none has one."""
    names = [str(track.name) for track in pipeline.tracks]
    if requested is not None and requested not in names:
        raise ConfigurationError(f"{path}: has no track {requested!r}{suggest(requested, names)}")
    names_with_tip = [str(track.name) for track in pipeline.tracks if has_tip(track.model)]
    candidates = [name for name in names_with_tip if requested in (None, name)]
    if candidates:
        return candidates[0]
    lack = f"the model of {requested} has no" if requested else "no model has a"
    raise ConfigurationError(f"{path}: {lack} tip, so that no modulus follows")


def has_tip(model: ContactModel) -> bool:
    """Return True if a model declares its tip, and Poisson's ratio."""
    return getattr(model, "indenter", None) is not None and hasattr(model, "poisson")


def _longest_contact(samples: Samples, path: Path) -> tuple[Samples, slice]:
    """Return the whole samples that are meant for estimation, and the rows of their longest stretch without a gap.

    Raises LogError where the stretch has fewer than 200 samples.
    """
    is_whole = samples.active & np.isfinite(samples.force) & np.isfinite(samples.position)
    whole = samples[is_whole]
    if len(whole) < _MIN_SAMPLES:
        raise LogError(f"{path}: has {len(whole)} samples in contact; a spectrum needs {_MIN_SAMPLES}")
    intervals = np.diff(whole.time)
    is_gap = intervals > _GAP_INTERVALS * float(np.median(intervals))
    edges = [0, *(np.flatnonzero(is_gap) + 1).tolist(), len(whole)]
    lengths = np.diff(edges)
    longest = int(np.argmax(lengths))
    if lengths[longest] < _MIN_SAMPLES:
        raise LogError(
            f"{path}: its longest stretch without a gap has {lengths[longest]} samples, {_MIN_SAMPLES} are needed"
        )
    return whole, slice(edges[longest], edges[longest + 1])


def _surface_std(track_std: float, samples: Samples, surface: float) -> float:
    """Return the standard uncertainty [m] of a track's surface [m]: its own, and its distance from the first touch.

    A track's surface is that of its model, and a relaxing material moves it by more than the track's uncertainty.
    """
    finite_std = track_std if math.isfinite(track_std) else 0.0
    return math.hypot(finite_std, excess_distance(first_touch(samples), surface))


def _declared_rig(pipeline: Pipeline) -> dict[str, Any]:
    """Return mass, compliance and timing of a pipeline's rig [SI], as `RecordedOscillation` names them.

    Standard uncertainties that are not declared are 5 % of the mass and 10 % of the compliance.
    """
    alignment = pipeline.alignment
    mass = alignment.tip_mass or 0.0
    mass_std = alignment.tip_mass_uncertainty
    compliance = 1.0 / alignment.series_stiffness if alignment.series_stiffness else 0.0
    stream_delays = (alignment.force, alignment.position)
    timing_stds = [delay.uncertainty for delay in stream_delays if delay.uncertainty is not None]
    return {
        "tip_mass": mass,
        "tip_mass_std": _MASS_STD_SHARE * mass if mass_std is None else mass_std,
        "compliance": compliance,
        "compliance_std": _COMPLIANCE_STD_SHARE * compliance,
        "timing": math.hypot(*timing_stds) if timing_stds else None,
    }
