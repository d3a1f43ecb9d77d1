"""The tracks of a pipeline on one record after the other: the results of runs, in memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from palpate.clocks import clock
from palpate.device import Batch, Device, is_live
from palpate.errors import ConfigurationError
from palpate.estimation import Estimates, Samples, Tracker

from palpate_engine.alignment import Aligner
from palpate_engine.config import Pipeline
from palpate_engine.pipeline.arrivals import Arrivals, Progress
from palpate_engine.pipeline.flow import Flow
from palpate_engine.pipeline.interrupt import Interrupt
from palpate_engine.pipeline.provenance import run_facts
from palpate_engine.pipeline.run_flow import run_flow
from palpate_engine.pipeline.run_result import Result, build_result
from palpate_engine.pipeline.tracks import RunningTrack, Tracks, start_tracks

_SECOND = 1e9  # [ns]


@dataclass(frozen=True)
class RecordOutcome:
    """The outcome of a run of one record: its samples, every estimate, its result."""

    pipeline: Pipeline
    samples: Samples
    estimates: Mapping[str, Sequence[Estimates]]  # blocks of each track
    result: Result  # without a folder


class RecordTracks:
    """The tracks of a pipeline, for many records that are read alike.

    The results are those of `run_pipeline`, by the same code and to the same digits; nothing is written, no sink is
    opened and no thread started. An estimator that is `reusable` keeps its tracker, and what that has compiled, from
    record to record. Raises ConfigurationError for a pipeline with a live device.
    """

    def __init__(self, pipeline: Pipeline, compares: bool | None = None) -> None:
        if is_live(pipeline.devices):
            raise ConfigurationError(f"{pipeline.path}: has a live device; only what is recorded can be read again")
        self.pipeline = pipeline
        self._compares = compares  # of several tracks, if not stated
        self._reusable: dict[str, Tracker] = {}

    def estimate(
        self,
        devices: Mapping[str, Device] | None = None,
        batches: Iterable[tuple[str, Batch]] | None = None,
        name: str | None = None,
        text: str | None = None,
        detail: bool = True,
    ) -> RecordOutcome:
        """Return the outcome of one record.

        `devices` stand for those of the pipeline, which they are alike but for the record that they name;
        `batches` with the device of each, in the order of their arrival, for what the devices would send;
        `name` and `text` for those of the pipeline. Without `detail` the result has values, verdicts and
        findings, and not what details alone show, nor by which versions they are found and from which inputs;
        it then has no table. Raises LogError where the record cannot be read, and PalpateError as a run does.
        """
        pipeline = self._with(devices, name, text)
        started = datetime.fromtimestamp(clock().epoch_ns() / _SECOND, UTC).astimezone()
        start = clock().now()
        tracks = Tracks(list(self._start(pipeline)))
        aligner, samples, estimates = _read(pipeline, tracks, batches)
        facts: dict[str, Any] = run_facts(pipeline) if detail else {}
        facts |= {"started": started.isoformat(timespec="seconds"), "duration": clock().now() - start}
        report = aligner.report
        results = tracks.results(pipeline, report, detail)
        result = build_result(
            pipeline, folder=Path(), facts=facts, live=None, report=report, tracks=results, interrupt=Interrupt()
        )
        return RecordOutcome(pipeline, samples, estimates, result)

    def _with(self, devices: Mapping[str, Device] | None, name: str | None, text: str | None) -> Pipeline:
        """Return the pipeline with other devices, name and text, where stated."""
        pipeline = self.pipeline
        run = pipeline.run if name is None else pipeline.run.model_copy(update={"name": name})
        return replace(
            pipeline,
            run=run,
            devices=pipeline.devices if devices is None else devices,
            text=pipeline.text if text is None else text,
        )

    def _start(self, pipeline: Pipeline) -> Iterator[RunningTrack]:
        """Start the tracks; a reusable estimator gets the tracker of the record before."""
        for running in start_tracks(pipeline, self._compares):
            if running.track.estimator.reusable:
                running.tracker = self._reusable.setdefault(str(running.track.name), running.tracker)
            yield running


def _read(
    pipeline: Pipeline, tracks: Tracks, batches: Iterable[tuple[str, Batch]] | None
) -> tuple[Aligner, Samples, dict[str, list[Estimates]]]:
    """Take a record along the data path to its end; return its aligner, its samples and the estimates of each track."""
    aligner = pipeline.new_aligner()
    blocks: list[Samples] = []
    estimates: dict[str, list[Estimates]] = {}

    def take(arrivals: Arrivals, final: bool = False) -> Progress:
        samples = aligner.aligned(arrivals, final)
        if len(samples) or final:
            blocks.append(samples)
        for track, block in tracks.estimate(samples).items():
            estimates.setdefault(track, []).append(block)
        return Progress(aligner.reached, 0.0)

    # From the devices of the pipeline, or from batches that are given; then what waits at the end.
    if batches is None:
        run_flow(Flow(pipeline, take, Interrupt()))
    else:
        for arrival in batches:
            take([arrival])
    take([], final=True)
    if (offline := tracks.estimate_offline()) is not None:
        estimates |= {track: [block] for track, block in offline[1].items()}
    return aligner, Samples.joined(blocks), estimates
