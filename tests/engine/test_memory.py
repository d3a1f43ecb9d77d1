"""What a live run keeps while it goes on: counted in bytes, without a clock."""

import gc
import tracemalloc
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
from palpate import Batch
from palpate.sink import Run
from palpate_engine.alignment import Aligner
from palpate_engine.pipeline.closing_reserve import ClosingReserve
from palpate_engine.pipeline.data_path import DataPath
from palpate_engine.pipeline.latency import Latency
from palpate_engine.pipeline.outputs import Outputs
from palpate_engine.pipeline.tracks import Tracks, start_tracks

BLOCK, RATE = 0.25, 500.0  # [s], [Hz]


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


def test_memory_is_flat(live_pipeline, tmp_path):
    """Half a minute leaves less than 100 kB: one number kept of each of its 15 000 samples would be more.

    What other code of the process allocates once meanwhile, such as a kernel, is some 25 kB.

    What diagnoses keep is bounded by itself, at 16 blocks of 4096 samples.
    """
    pipeline, folder = replace(live_pipeline(), sinks={}), tmp_path / "out"
    folder.mkdir()
    tracks, noise = Tracks(start_tracks(pipeline)), np.random.default_rng(0)
    parameters = {track.track.name: track.track.model.parameters for track in tracks.running}
    looks = []
    with ExitStack() as stack:
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
        for block in range(round(45 / BLOCK)):
            if block == round(12 / BLOCK):
                tracemalloc.start()
            path.step(arrivals(block, noise))
            while path.backlog.behind:
                path.step([])
            if block in (round(15 / BLOCK), round(45 / BLOCK) - 1):
                gc.collect()
                elsewhere = tracemalloc.Filter(False, "*sample_keeper.py")
                looks.append(tracemalloc.take_snapshot().filter_traces([elsewhere]))
        tracemalloc.stop()
    assert path.backlog.estimated > 43.0
    grown = looks[1].compare_to(looks[0], "lineno")
    assert sum(entry.size_diff for entry in grown) < 100 * 1024, grown[:10]
