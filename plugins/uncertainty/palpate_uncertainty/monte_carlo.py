"""Monte Carlo after GUM Supplement 1 (JCGM 101:2008): every declared input drawn again, the estimator run again."""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from palpate import ConfigurationError, ContactModel, Estimator, Floats, Problem, Samples, Settings
from palpate_engine import RESULT, Pipeline, build_pipeline, run_pipeline
from palpate_kit.budget.systematic_terms import weight_per_mass
from palpate_kit.jobs.process_pool import begin_worker
from palpate_kit.runs.replay_source import read_run_log, replay_source
from palpate_kit.runs.result_file import estimate_of, open_table
from palpate_kit.runs.run_folder import RunFolder
from palpate_kit.runs.sample_observer import SampleObserver
from palpate_kit.terminal.progress import progress, report_progress

_UNDECLARED = " (not declared)"
_HALF_WIDTH = math.sqrt(3)  # of a rectangular distribution, in standard deviations
_INTERVAL = (0.025, 0.975)  # quantiles of the 95 % interval
# Choices, of `palpate report budget --monte-carlo` alone: no verdict depends on them.
_SLOPE_SAMPLES = 10  # samples to either side that the slope of the force is taken over
_CHUNK_DRAWS = 8  # draws of one job
_COMPILED_SAMPLES = 100_000  # samples, from which on machine code for one draw is worth its compilation


@dataclass(frozen=True)
class Case:
    """One track of a run, ready to be estimated again."""

    name: str
    model: ContactModel
    estimator: Estimator
    problem: Problem
    samples: Samples
    average: float  # [s] at the end that a value is the mean of
    weight_per_mass: float  # [N/kg]
    rows: tuple[Mapping[str, Any], ...]  # of its budget
    parameters: Mapping[str, Mapping[str, Any]]  # as in result.json
    covariance: Floats | None  # (k, k) of the estimator's own scatter

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the parameters."""
        return tuple(parameter.name for parameter in self.model.parameters)


@dataclass(frozen=True)
class PropagatedDraws:
    """Results of the draws of one track."""

    name: str
    values: Floats  # (n, k); NaN where nothing was estimated
    parameters: Mapping[str, Mapping[str, Any]]

    @property
    def lost(self) -> int:
        """The number of draws without an estimate."""
        return int(np.count_nonzero(~np.isfinite(self.values).all(axis=1)))

    def table(self) -> dict[str, dict[str, float]]:
        """Return, by parameter, value and uncertainty of the budget, and mean, std and 95 % interval of the draws."""
        rows = {}
        estimated = self.values[np.isfinite(self.values).all(axis=1)]
        for i, (name, parameter) in enumerate(self.parameters.items()):
            draws = estimated[:, i]
            low, high = np.quantile(draws, _INTERVAL).tolist()
            rows[name] = {
                "value": estimate_of(parameter), "combined": parameter["combined"], "mean": float(draws.mean()),
                "std": float(draws.std(ddof=1)), "low": low, "high": high,
            }  # fmt: skip
        return rows


def cases(run: Path, tracks: Sequence[str]) -> list[Case]:
    """Return the tracks of a run with the samples of its log; raises ConfigurationError for a run without one."""
    run_log = read_run_log(run)
    if run_log is None:
        raise ConfigurationError(f"{run}: holds no log of its own; add a [sink.*] to the pipeline, and run it again")
    pipeline = build_pipeline(replay_source(run_log, list(tracks)))
    observer = SampleObserver()
    with tempfile.TemporaryDirectory() as folder, progress(str(run), "s"):
        run_pipeline(pipeline, Path(folder) / "replay", report_progress, observer)
    samples = Samples.joined(observer.blocks)
    result = RunFolder(run).result
    # The weight of a mass behind the sensor, along the tool; its tables are empty for a tool that was not turned.
    turned = result["run"].get("turned_tool", {})
    weight = weight_per_mass(pipeline.alignment, turned.get("along", 0.0), turned.get("weight", 0.0))
    tracks_of, names = result["tracks"], [track.name for track in pipeline.tracks]
    return [_case(run, pipeline, name, result=tracks_of[str(name)], samples=samples, weight=weight) for name in names]


def _case(run: Path, pipeline: Pipeline, name: Any, result: Mapping[str, Any], samples: Samples, weight: float) -> Case:
    """Return the track of a name, with the rows of its budget and its covariance by the run's result.

    `weight` [N/kg] is that of a mass behind the sensor.
    """
    track = next(candidate for candidate in pipeline.tracks if candidate.name == name)
    settings = pipeline.alignment
    standstill = pipeline.safety.standstill if pipeline.safety else None
    # The uncertainty between force and motion: those of both time-stamps together.
    motion = settings.velocity or settings.position
    timing = [signal.uncertainty for signal in (settings.force, motion) if signal.uncertainty]
    timing_uncertainty = math.hypot(*timing) if timing else None
    problem = Problem(
        track.model,
        settings.tip_mass,
        timing_uncertainty,
        standstill,
        zero_uncertainty=settings.zero_uncertainty,
        force_zero=settings.force_zero,
    )
    # A draw needs the estimate alone.
    changes = {key: value for key, value in {"profile": False, "bootstrap": 0}.items() if hasattr(track.estimator, key)}
    return Case(
        name=str(name),
        model=track.model,
        estimator=track.estimator.model_copy(update=changes),
        problem=problem,
        samples=samples,
        average=pipeline.run.average,
        weight_per_mass=weight,
        rows=tuple(result["budget"]),
        parameters=result["parameters"],
        covariance=_covariance(run, track.model, name, result),
    )


def _covariance(run: Path, model: ContactModel, name: Any, result: Mapping[str, Any]) -> Floats | None:
    """Return the covariance (k, k) of a model's parameters in a track's result; None where it has none."""
    names = [parameter.name for parameter in model.parameters]
    table = result.get("details", {}).get("covariance")
    with open_table(run / RESULT, f"tracks.{name}.details.covariance"):
        if isinstance(table, Mapping) and set(names) <= set(table["names"]):
            places = [table["names"].index(n) for n in names]
            return np.array(table["matrix"], float)[np.ix_(places, places)]
    return None


def propagate_draws(
    case: Case, draws: int, seed: int, workers: int | None = None, report: Callable[[int], None] = lambda done: None
) -> PropagatedDraws:
    """Return so many draws of a track, the same for the same seed however many processes share them."""
    chunks = [range(first, min(first + _CHUNK_DRAWS, draws)) for first in range(0, draws, _CHUNK_DRAWS)]
    values: list[Floats] = []
    initializer = _use_virtual_machine if len(case.samples) < _COMPILED_SAMPLES else None
    with ProcessPoolExecutor(workers, initializer=begin_worker, initargs=(initializer,)) as pool:
        for chunk in pool.map(partial(_chunk, case, seed), chunks):
            values.append(chunk)
            report(sum(map(len, values)))
    return PropagatedDraws(case.name, np.concatenate(values), case.parameters)


def _use_virtual_machine() -> None:
    """Run filters on the virtual machine, with the same bits: a draw's tip is compiled for one short run only."""
    os.environ.setdefault("PALPATE_KERNEL", "vm")


def _chunk(case: Case, seed: int, numbers: range) -> Floats:
    """Return the values (n, k) of the draws of these numbers."""
    return np.array([_draw(case, np.random.default_rng([seed, number])) for number in numbers])


def _draw(case: Case, random: np.random.Generator) -> Floats:
    """Return the values (k,) of one draw: the estimate with every input changed, plus the effects without an input.

    Each row of the budget is drawn once, in its order: by its effect alone, as a change of the samples, or of a number
    of the model, whose key is then the name of the cause. NaN where nothing is estimated.
    """
    model, samples, mass = case.model, case.samples, case.problem.tip_mass
    effects = np.zeros(len(case.names))
    for row in case.rows:
        cause, is_declared = row["source"].removesuffix(_UNDECLARED), not row["source"].endswith(_UNDECLARED)
        std = row["std"]
        if cause == "estimator":
            effects += _scatter(case, row, random)
        elif std is None:  # settling, lack of fit: only the effect is known
            effects += _effects(case, row) * random.uniform(-_HALF_WIDTH, _HALF_WIDTH)
        elif cause == "mass" and mass is not None:
            change = std * random.standard_normal()
            mass += change
            samples = replace(samples, force=samples.force + case.weight_per_mass * change)
        elif cause in ("mounting", "normal", "curvature", "beam"):
            effects += _effects(case, row) * random.standard_normal()
        elif cause in ("timing", "tare", "force_scale", "position_scale", "compliance"):
            samples = _changed(samples, cause, std * random.standard_normal())
        else:
            model = with_number(model, cause, std * _shift(cause, is_declared, random))
    # The mean over the last part of a recursive estimate; of a fit it is constant.
    estimates = case.estimator.start(replace(case.problem, model=model, tip_mass=mass)).run(samples)
    rows = np.flatnonzero(np.isfinite(estimates.values).all(axis=1))
    if not len(rows):
        return np.full(len(case.names), np.nan)
    begin = estimates.time[rows[-1]] - (case.average if case.estimator.online else math.inf)
    averaged_rows = rows[estimates.time[rows] >= begin]
    return np.asarray(estimates.values[averaged_rows].mean(axis=0) + effects)


def _shift(cause: str, is_declared: bool, random: np.random.Generator) -> float:
    """Return the shift of a number of the model [standard uncertainties]; normal unless its default is not."""
    if is_declared or cause not in ("poisson", "stick"):
        return float(random.standard_normal())
    if cause == "stick":  # a tip sticks or slides
        return float(random.choice((-1.0, 1.0)))
    return float(-_HALF_WIDTH * random.uniform())  # rectangular, below the value


def _effects(case: Case, row: Mapping[str, Any]) -> Floats:
    """Return the contributions (k,) of a row of the budget; 0 where it has none."""
    effects = row["effects"]
    return np.array([effects[name]["contribution"] or 0.0 if name in effects else 0.0 for name in case.names])


def _scatter(case: Case, row: Mapping[str, Any], random: np.random.Generator) -> Floats:
    """Return the estimator's own scatter (k,): by its covariance, and what its std has beyond that uncorrelated."""
    std = _effects(case, row)
    if case.covariance is None:
        return np.asarray(std * random.standard_normal(len(std)))
    uncorrelated = np.sqrt(np.maximum(std**2 - np.diag(case.covariance), 0.0))
    correlated_draw = random.multivariate_normal(np.zeros(len(std)), case.covariance, method="eigh")
    return np.asarray(correlated_draw + uncorrelated * random.standard_normal(len(std)))


def _changed(samples: Samples, cause: str, size: float) -> Samples:
    """Return the samples that would be read if a source were off by `size` [SI]."""
    force = samples.force
    match cause:
        case "timing":  # by the slope of the force, which leaves its noise as it is
            return replace(samples, force=force + size * _slope(samples))
        case "tare":
            return replace(samples, force=force + size)
        case "force_scale":
            return replace(samples, force=force * (1 + size))
        case "compliance":  # the robot is displaced by F/k
            rate = size * _slope(samples)
            return replace(samples, position=samples.position + size * force, velocity=samples.velocity + rate)
    # The scale of the position: heights grow from the highest one, which stays.
    fixed = float(np.nanmax(samples.position))
    height = fixed + (samples.position - fixed) * (1 + size)
    return replace(samples, position=height, velocity=samples.velocity * (1 + size))


def _slope(samples: Samples) -> Floats:
    """Return the slope (n,) [N/s] of the force by a local cubic, readings that are missing interpolated."""
    from scipy.signal import savgol_filter

    interval = float(np.median(samples.interval[1:]))
    is_finite = np.isfinite(samples.force)
    force = np.interp(samples.time, samples.time[is_finite], samples.force[is_finite])
    return np.asarray(savgol_filter(force, 2 * _SLOPE_SAMPLES + 1, 3, deriv=1) / interval)


def with_number(part: Any, name: str, change: float) -> Any:
    """Return a model with the number of a name, its own or its tip's, changed by `change` [SI]."""
    for key in type(part).model_fields:
        value = getattr(part, key)
        if key == name and isinstance(value, float):
            return part.model_copy(update={key: value + change})
        if isinstance(value, Settings) and (inner := with_number(value, name, change)) is not value:
            return part.model_copy(update={key: inner})
    return part
