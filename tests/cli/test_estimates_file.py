"""The table of estimates as text: a thread of its own writes that of a replay, the same bytes as without."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from palpate import Estimates, OutputError, Parameter, Samples
from palpate_kit.runs import estimates_file as module
from palpate_kit.runs.estimates_file import estimates_file

TRACKS = {"dr/ekf": (Parameter("elasticity", "", "Pa", ""),)}


def block(begin, count):
    time = begin + np.arange(count) / 500
    random = np.random.default_rng(round(begin * 1000))
    interval, force, position, velocity = random.normal(size=(4, count))
    marks = np.ones(count, bool)
    samples = Samples(np.rint(time * 1e9).astype(np.int64), time, interval, force, position, velocity, marks, marks)
    values, std = random.normal(size=(2, count, 1))
    surface, spread, model, nis, innovation = random.normal(size=(5, count))
    status = np.zeros(count, np.uint32)
    estimates = Estimates(time, values, std, surface, spread, model, nis, status, innovation=innovation)
    return samples, {"dr/ekf": estimates}


def opened(folder, live, interval=0.01):
    folder.mkdir()
    run = SimpleNamespace(estimates_interval=interval)
    pipeline: Any = SimpleNamespace(devices={"rig": SimpleNamespace(live=live)}, tables={}, run=run)
    return estimates_file(folder, TRACKS, pipeline, offline=False)


def fill(folder, blocks, end=None):
    """A table of blocks of a second, which ends by what is raised."""
    with opened(folder, live=False) as table:
        for i in range(blocks):
            table.write(*block(i * 1.0, 500))
        if end is not None:
            raise end


@pytest.mark.parametrize("interval", [0.0, 0.01])
@pytest.mark.parametrize("count", [1, 700, 12_000])
def test_a_thread_writes_the_same_bytes(tmp_path, count, interval):
    for live in (True, False):
        with opened(tmp_path / f"{live}", live, interval) as table:
            for i in range(10):
                table.write(*block(i * count / 500, count))
    live, replayed = ((tmp_path / f"{live}" / "estimates.csv").read_bytes() for live in (True, False))
    assert live == replayed
    assert live.count(b"\n") > 2


def test_what_the_thread_meets_is_raised_and_nothing_follows_the_gap(tmp_path, monkeypatch):
    append, begins = module.EstimatesFile.append, []

    def failing(self, numbers):
        begins.append(numbers[0, 0])
        if len(begins) == 3:
            raise OSError(28, "No space left on device")
        append(self, numbers)

    monkeypatch.setattr(module.EstimatesFile, "append", failing)
    with pytest.raises(OutputError, match=r"estimates\.csv: cannot write: No space left"):
        fill(tmp_path / "out", 20)
    assert begins == [0.0, 1.0, 2.0]
    lines = (tmp_path / "out" / "estimates.csv").read_text().splitlines()
    assert len(lines) == 1 + 2 * 100


def test_a_run_that_is_stopped_has_its_rows(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        fill(tmp_path / "out", 3, KeyboardInterrupt())
    assert len((tmp_path / "out" / "estimates.csv").read_text().splitlines()) == 1 + 3 * 100
