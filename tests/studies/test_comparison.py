"""What pictures and tables of many tracks show."""

import numpy as np
import pytest
from palpate_kit.figures import common_limits


def test_one_curve_far_away_does_not_flatten_the_others():
    near = [np.full(50, 100.0), np.full(50, 104.0), np.full(50, 98.0)]
    low, high = common_limits([*near, np.full(50, 1e8)])
    assert 50 < low < 98
    assert 104 < high < 160
    assert common_limits([]) is None


@pytest.mark.slow
def test_a_sweep_prints_its_best_rows(palpate, point_pipeline):
    text = point_pipeline.read_text() + '\n[sweep]\n"estimator.ekf.force_std" = ["0.05 N", "0.1 N"]\n'
    point_pipeline.write_text(text)
    short = ["--set", "trajectory.press.duration=1 s", "--set", 'run.tracks=["*/ekf"]']
    done = palpate("sweep", point_pipeline, *short, "--jobs", "1", "--out", "out")
    assert done.returncode == 0, done.stderr
    assert "best of 2 rows" in done.stdout
    assert "0.1 N" in done.stdout
