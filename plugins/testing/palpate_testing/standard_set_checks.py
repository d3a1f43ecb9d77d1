"""Checks of an estimator on the standard set: two short records of each scene of ``palpate bench``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from palpate import Estimator
from palpate_engine import Source, Track, TrackName, build_pipeline
from palpate_kit.comparison.record_rows import Row, record_rows
from palpate_kit.comparison.standard_set import SHORT_SETTINGS, scene_files

from palpate_testing.failure_messages import demand

SEEDS = (1, 2)
# Scenes whose material is that of the model, and the share of the force that an error of its prediction may be there:
# seven times that of the worst shipped estimator, 3.4 % (afukf, tip).
RIGHT_MODEL, MAX_PREDICTION = ("sine", "noise", "tip"), 0.25


def check_standard_set(estimator: Estimator) -> None:
    """Check that an estimator survives the standard set, and predicts the force where the model is right.

    Checked: it raises on no record, has a number or says why not, is faster than the record, and the force that its
    estimates predict is within a quarter of the measured one. Raises AssertionError with the reason.
    """
    name = type(estimator).__name__
    for row in standard_rows(estimator):
        scene = f"{name}, scene {row['scene']} (palpate bench), seed {row['record']}"
        demand(row["flag"] != "failed", f"{scene}: {row['reason']}")
        demand(not row["is_slow"], f"{scene}: slower than the record")
        prediction = row["prediction"]
        if row["scene"] not in RIGHT_MODEL or prediction is None:
            continue
        demand(
            prediction <= MAX_PREDICTION,
            f"{scene}: the force that its estimates predict is off by {prediction:.0%} of the force, allowed "
            f"{MAX_PREDICTION:.0%}",
        )


def standard_rows(estimator: Estimator) -> Iterator[Row]:
    """Return the measures of an estimator on two records of at most 3 s of contact of each scene."""
    for file in scene_files():
        source = Source.read(file)
        for assignment in (*SHORT_SETTINGS[file.stem], 'run.tracks=["dr/ekf"]'):
            source.override(assignment)
        pipeline = build_pipeline(source)
        (track,) = pipeline.tracks
        checked = Track(TrackName(track.name.model, "checked"), track.model, estimator)
        for seed in SEEDS:
            run = pipeline.run.model_copy(update={"seed": seed})
            yield from record_rows(replace(pipeline, run=run, tracks=(checked,)), seed)
