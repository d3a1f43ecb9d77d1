"""Tracks of what is not live run beside each other in threads: the same numbers, and what they raise is heard."""

import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from palpate import ConfigurationError, Samples
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_engine.pipeline.tracks import Tracks, start_tracks

SHORT = ("trajectory.press.duration=3 s",)


class Kept:
    """Keeps the blocks of samples."""

    def __init__(self):
        self.blocks = []

    def batch(self, device, batch):
        pass

    def samples(self, samples):
        self.blocks.append(samples)

    def estimates(self, track, estimates):
        pass


@pytest.fixture
def recorded(point_pipeline, tmp_path):
    pipeline, kept = load_pipeline(point_pipeline, SHORT), Kept()
    run_pipeline(pipeline, tmp_path / "out", observer=kept)
    return pipeline, kept.blocks


def test_numbers_are_those_of_one_after_the_other(recorded):
    pipeline, blocks = recorded
    with ThreadPoolExecutor(2) as beside:
        threads, alone = Tracks(start_tracks(pipeline), beside), Tracks(start_tracks(pipeline))
        assert len(threads.online) > 1
        for block in blocks:
            found, expected = threads.estimate(block), alone.estimate(block)
            assert list(found) == list(expected)
            for track, one in found.items():
                for name in ("values", "std", "surface", "force", "nis", "status", "innovation"):
                    np.testing.assert_array_equal(getattr(one, name), getattr(expected[track], name))


@pytest.mark.slow
@pytest.mark.parametrize("which", [0, 1])
def test_what_a_track_raises_on_purpose_is_heard_when_all_are_done(recorded, monkeypatch, which):
    pipeline, blocks = recorded
    block, done = Samples.joined(blocks), []
    with ThreadPoolExecutor(2) as beside:
        tracks = Tracks(start_tracks(pipeline), beside)
        for i, track in enumerate(tracks.online):

            def run(samples, i=i, track=track, before=track.tracker.run):
                if i == which:
                    raise ConfigurationError("this cannot be estimated")
                found = before(samples)
                done.append((i, threading.current_thread()))
                return found

            monkeypatch.setattr(track.tracker, "run", run)
        with pytest.raises(ConfigurationError, match="cannot be estimated"):
            tracks.estimate(block)
        assert {i for i, _ in done} == set(range(len(tracks.online))) - {which}
