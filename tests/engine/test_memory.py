"""What a live run keeps while it goes on: counted in bytes, in simulated time."""

import gc
import tracemalloc
from array import array
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest
from palpate import Batch
from palpate.sink import Run
from palpate_engine.alignment import Aligner
from palpate_engine.pipeline.closing_reserve import ClosingReserve
from palpate_engine.pipeline.data_path import DataPath
from palpate_engine.pipeline.latency import Latency
from palpate_engine.pipeline.outputs import Outputs
from palpate_engine.pipeline.tracks import Tracks, start_tracks
from palpate_testing import simulated_time

BLOCK, RATE = 0.256, 500.0  # [s], [Hz]
PERIOD = 32  # blocks that come to 4096 samples
FIRST_TRACE = 24  # block; a period before the first look at least
LOOKS = 60, 60 + 4 * PERIOD  # blocks


def arrivals(block, noise):
    """A quarter of a second of a press of 4 mm that oscillates, after a second of free air."""
    times = block * BLOCK + np.arange(round(BLOCK * RATE)) / RATE
    depth = np.where(times < 1.0, -5e-3, np.minimum(times - 1.0, 1.0) * 4e-3 + 1e-3 * np.sin(4 * np.pi * times))
    rate = np.gradient(depth, times)
    wrench = 0.02 * noise.standard_normal((len(times), 3))
    wrench[:, 2] += 16 / 9 * 112.5e3 * 5e-3**0.5 * np.maximum(depth, 0.0) ** 1.5
    stamps = np.rint(times * 1e9).astype(np.int64)
    tip = np.column_stack([-depth, -rate, times > 2.0])
    return [("rig", Batch("wrench", stamps, stamps, wrench)), ("rig", Batch("tip", stamps, stamps, tip))]


def look():
    """Memory [bytes] by line of code, without what diagnoses keep, which is bounded by itself, and without looks."""
    gc.collect()
    others = [tracemalloc.Filter(False, "*sample_keeper.py"), tracemalloc.Filter(False, tracemalloc.__file__)]
    return tracemalloc.take_snapshot().filter_traces(others)


@pytest.mark.parametrize("is_kept", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_memory_is_flat(live_pipeline, tmp_path, is_kept):
    """Half a minute leaves less than 50 kB: one number kept of each of its 16 384 samples is 131 kB.

    Samples are kept in pieces up to 4096, 290 kB, and then in one: both looks are at the same place of that. In
    simulated time no piece is cut by how fast a computer is. What is left is 17 kB.
    """
    pipeline, folder = replace(live_pipeline(), sinks={}), tmp_path / "out"
    folder.mkdir()
    tracks, noise = Tracks(start_tracks(pipeline)), np.random.default_rng(0)
    parameters = {track.track.name: track.track.model.parameters for track in tracks.running}
    looks, kept = [], array("d")
    with ExitStack() as stack:
        stack.enter_context(simulated_time())
        outputs = Outputs(
            stack,
            pipeline,
            Run(folder, pipeline.ports.streams, parameters, {}, {}),
            tracks.online,
            print,
            ClosingReserve(None),
        )
        latency = Latency(pipeline.ports["position"])
        path = DataPath(Aligner(pipeline.alignment, pipeline.ports), tracks, outputs, latency)
        for block in range(LOOKS[1] + 1):
            if block == FIRST_TRACE:
                tracemalloc.start()
            batches = arrivals(block, noise)
            path.step(batches)
            while path.backlog.behind:
                path.step([])
            if is_kept:
                kept.extend(batches[0][1].values[:, 2])
            if block in LOOKS:
                looks.append(look())
        tracemalloc.stop()
    assert path.backlog.estimated > 45.0
    grown = looks[1].compare_to(looks[0], "lineno")
    assert (sum(entry.size_diff for entry in grown) < 50 * 1024) != is_kept, grown[:10]
