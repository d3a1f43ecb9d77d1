"""The response of a track to lumps: its own estimator runs on the record with virtual lumps pushed below the tip."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from palpate import Estimates, Floats, PalpateError, Samples, Status
from palpate_engine import Flow, Pipeline, build_pipeline, each, interruptible, run_flow, start_tracks
from palpate_kit.runs.continuation import recorded_pipeline
from palpate_kit.runs.replay_source import read_run_log, replay_source
from palpate_records.recording import Recording

from palpate_maps.body_field import FWHM
from palpate_maps.lump_criteria import TrackResponse
from palpate_maps.sites import travel_directions
from palpate_maps.stiffness_field import distances, near

# Choices of decision 0577.
SIGMA = 6e-3 / FWHM  # [m] of the virtual lumps: about as narrow as the contact leaves one
_CONTRAST = 0.1  # near what an exam excludes, so that an estimator adapts to it as to a lump at the limit
_APART = 20e-3  # [m] between virtual lumps, whose flanks then do not meet
_REACH = 12e-3  # [m] about a virtual lump in which its response is looked for: lags of a filter
_MIN_SAMPLES = 100  # about virtual lumps, that show a response: a choice
_FAR = 1e3  # [m] in place of a coordinate that is not known
_MAX_SAMPLES = 400_000  # of a record, that the estimator runs on: a choice of computing time
_MAX_POINTS = 4000  # samples, evenly, that the response is fitted on: a choice of computing time
_MAX_LAG = 10e-3  # [m]: half of the distance of virtual lumps
_MAX_HEIGHT = 2.0  # of a response over the lump's: an estimator that overshoots
_UNUSABLE = Status.IDLE | Status.WAITING | Status.DIVERGED


def track_response(run: Path, track: str, parameter: str) -> TrackResponse | None:
    """Return the response of a run's track to narrow lumps; None of a run without a log, or that cannot be read."""
    try:
        pipeline = _pipeline_on_log(run, track)
        return None if pipeline is None else response_of(pipeline, _samples_of(pipeline), parameter)
    except PalpateError:
        return None


def _pipeline_on_log(run: Path, track: str) -> Pipeline | None:
    """Return the pipeline of a run with one track, on the run's log, or on those that its devices read.

    None where the log carries no pipeline; raises PalpateError where it cannot be read.
    """
    pipeline = recorded_pipeline(run, [f"run.tracks={json.dumps([track])}"])
    if all(isinstance(device, Recording) for device in pipeline.devices.values()):
        return replace(pipeline, sinks={})
    carried = read_run_log(run)
    return None if carried is None else build_pipeline(replay_source(carried, [track]))


def response_of(pipeline: Pipeline, samples: Samples, parameter: str) -> TrackResponse | None:
    """Return the response of a pipeline's one track on samples; None where it estimates nothing below virtual lumps.

    The force is raised by 1 + s(x, y), s virtual lumps that lie below the way of the tip: what a contact measures whose
    stiffness and viscosity are higher by s. The track estimates with and without them, so that noise and relief are in
    both; the difference of the logarithms is fitted by lumps that are lower, later and longer along the way.
    """
    samples = samples[:_MAX_SAMPLES]
    middles = _middles(samples)
    if not len(middles):
        return None
    shape = np.exp(-0.5 * (distances(samples.lateral, middles) / SIGMA) ** 2)
    shape = np.where(np.isfinite(shape), shape, 0.0).sum(axis=1)
    names = [unknown.name for unknown in pipeline.tracks[0].model.parameters]
    # Estimates without and with the lumps.
    values = []
    for height in (0.0, _CONTRAST):
        (running,) = start_tracks(pipeline)
        estimates = running.tracker.run(replace(samples, force=samples.force * (1 + height * shape)))
        values.append(_usable_values(estimates, names.index(parameter)))
    rows = np.isfinite(values).all(axis=0) & near(np.nan_to_num(samples.lateral, nan=_FAR), middles, _REACH)
    if np.count_nonzero(rows) < _MIN_SAMPLES:
        return None
    return _fitted(samples[rows], middles, np.log(values[1][rows] / values[0][rows]))


def _samples_of(pipeline: Pipeline) -> Samples:
    """Return the samples of a recorded pipeline, without any estimate; raises KeyboardInterrupt at Ctrl-C."""
    aligner, blocks = pipeline.new_aligner(), list[Samples]()
    with interruptible() as interrupt:
        run_flow(Flow(pipeline, each(aligner.feed), interrupt))
        if interrupt.reason is not None:
            raise KeyboardInterrupt
    blocks += [aligner.samples(), aligner.samples(final=True)]
    return Samples.joined(blocks)


def _usable_values(estimates: Estimates, column: int) -> Floats:
    """Return the values (n,) of a parameter that a map would use; NaN elsewhere."""
    value = estimates.values[:, column]
    usable = ((estimates.status & int(_UNUSABLE)) == 0) & (value > 0)
    return np.asarray(np.where(usable, value, np.nan))


def _middles(samples: Samples) -> Floats:
    """Return middles (m, 2) [m] of virtual lumps below the way of the tip in contact, far from each other."""
    place = samples.lateral[samples.active & np.isfinite(samples.lateral).all(axis=1)]
    middles = np.zeros((0, 2))
    while len(place):
        # The first place of the way that is far from all; not where the way begins, which a filter starts on.
        place = place[np.linalg.norm(place - place[0], axis=1) > _APART / 2] if not len(middles) else place
        if not len(place):
            break
        middles = np.vstack([middles, place[0]])
        place = place[np.linalg.norm(place - middles[-1], axis=1) > _APART]
    return middles


def _fitted(samples: Samples, middles: Floats, difference: Floats) -> TrackResponse:
    """Return height, lag and blur of the least squares of differences (n,) of a track's logarithms near middles."""
    from scipy.optimize import least_squares

    # Evenly thinned samples, the way of the tip there, and their offsets [m] from the nearest virtual lump.
    rows = np.unique(np.linspace(0, len(samples) - 1, min(len(samples), _MAX_POINTS)).astype(int))
    direction = travel_directions(samples.time, samples.lateral)[rows]
    nearest = np.argmin(distances(samples.lateral[rows], middles), axis=1)
    offset = samples.lateral[rows] - middles[nearest]

    def residual(unknowns: Floats) -> Floats:
        response = TrackResponse(*unknowns.tolist())
        return np.asarray(difference[rows] - np.log1p(_CONTRAST * response.shape(offset, direction, SIGMA)))

    # Height relative to the lump's, lag [m] and blur [m]; the search starts from a response like the lump.
    low, high = [0.0, -_MAX_LAG, 0.0], [_MAX_HEIGHT, _MAX_LAG, _MAX_LAG]
    start, scale = [1.0, 0.0, 1e-3], [1.0, 1e-3, 1e-3]
    optimum = least_squares(residual, start, bounds=(low, high), x_scale=scale)
    height, lag, blur = optimum.x.tolist()
    # Of stays alone nothing is known along a way.
    return TrackResponse(height, lag, blur) if direction.any() else TrackResponse(height)
