"""Test vectors: the samples of a run as a controller would have read them, and palpate's estimates of each."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from palpate import Batch, ConfigurationError, Estimates, Floats, Samples
from palpate_engine import GRAVITY, Pipeline, Result, Track, run_pipeline


@dataclass
class VectorRecorder:
    """A writer that keeps samples and the estimates of one track."""

    samples_blocks: list[Samples] = field(default_factory=list)
    estimates_blocks: list[Estimates] = field(default_factory=list)

    def batch(self, device: str, batch: Batch) -> None:
        """Drop raw readings."""

    def samples(self, samples: Samples) -> None:
        """Keep a block."""
        self.samples_blocks.append(samples)

    def estimates(self, track: str, estimates: Estimates) -> None:
        """Keep the estimates of a block."""
        self.estimates_blocks.append(estimates)


@dataclass(frozen=True)
class Vectors:
    """Samples with their raw force, and the estimates of a track."""

    samples: Samples
    force: Floats  # (n,) [N] as the sensor read it
    estimates: tuple[Estimates, ...]

    @property
    def rate(self) -> float:
        """The rate [Hz] of the samples."""
        return float(1.0 / np.median(self.samples.interval[1:]))

    def write(self, path: Path, parameter_names: list[str]) -> None:
        """Write ``vectors.csv``: one row for each sample, every number to the bit; the model has `parameter_names`."""
        samples, blocks = self.samples, self.estimates
        # The inputs of the filter on a controller.
        heading = ["stamp", "raw_force", "position", "velocity", "lateral_x", "lateral_y", "measuring"]
        columns = [self.force, samples.position, samples.velocity, samples.lateral[:, 0], samples.lateral[:, 1]]
        # It decides on contact by itself: `measuring` is 0 only in contact during a motion that is not for estimation.
        measuring = samples.active | ~samples.contact
        columns.append(measuring.astype(float))
        # The estimates: a column of each parameter, then of each standard deviation.
        heading += [*parameter_names, *(f"{name}_std" for name in parameter_names)]
        for field_name in ("values", "std"):
            columns += list(np.concatenate([getattr(block, field_name) for block in blocks]).T)
        scalar_names = ["surface", "surface_std", "force", "nis", "innovation", "status"]
        heading += scalar_names
        for field_name in scalar_names:
            columns.append(np.concatenate([getattr(block, field_name) for block in blocks]).astype(float))
        table = np.column_stack(columns).tolist()
        with path.open("w", encoding="utf-8") as file:
            print(",".join(heading), file=file)
            for stamp, row in zip(samples.stamp.tolist(), table, strict=True):
                print(stamp, *map(repr, row), sep=",", file=file)


def make_vectors(pipeline: Pipeline, track: Track) -> Vectors:
    """Run a pipeline with one track; raises ConfigurationError where that gives no samples in contact."""
    recorder = VectorRecorder()
    with TemporaryDirectory(prefix="palpate-export-") as scratch:
        single_track = replace(pipeline, tracks=(track,), sinks={})
        result = run_pipeline(single_track, Path(scratch) / "run", observer=recorder)
    result.demand_whole()
    samples = Samples.joined(recorder.samples_blocks) if recorder.samples_blocks else None
    if samples is None or not samples.active.any():
        raise ConfigurationError(f"{pipeline.path}: no sample is in contact, so there is nothing to test a filter on")
    force = _raw_force(samples.force, _offset(result), added_weight(pipeline))
    return Vectors(samples, force, tuple(recorder.estimates_blocks))


def _raw_force(force: Floats, offset: float, weight: float) -> Floats:
    """Return a reading (n,) that tare and weight turn into the force to the bit.

    Rounding of both sums misses by a few units in the last place at most, so that the neighbours are tried in turn:
    each step starts from the number before, so these are +1, -1, +2, -2 units and so on.
    """
    raw = force - weight + offset
    for step in (1, -2, 3, -4, 5, -6, 7, -8):
        wrong = np.isfinite(force) & (raw - offset + weight != force)
        if not wrong.any():
            break
        raw[wrong] += step * np.spacing(raw[wrong])
    return raw


def added_weight(pipeline: Pipeline) -> float:
    """Return the weight of the tip [N] that is added to the tared force."""
    settings = pipeline.alignment
    return settings.tip_mass * GRAVITY if settings.weight == "removed" and settings.tip_mass is not None else 0.0


def _offset(result: Result) -> float:
    tare = result.run.get("tare")
    return float(tare["offset"]) if tare else 0.0
