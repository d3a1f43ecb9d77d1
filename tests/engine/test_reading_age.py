"""The age of readings, by their stamps and arrivals alone."""

import numpy as np
import pytest
from palpate_engine import ReadingAge

MS = 1_000_000  # [ns]


def ages(lateness, step=2 * MS, ppm=0.0, offset=10**15, batch=4):
    """The age of each batch's newest reading [s], and whether two in a row were over 20 ms; lateness (n,) [ns]."""
    age, found = ReadingAge(), []
    now = offset + np.arange(len(lateness)) * step
    stamps = np.rint((now - now[0]) * (1.0 - ppm * 1e-6)).astype(np.int64)  # a slow clock, of another origin
    arrivals = np.maximum.accumulate(now + np.asarray(lateness)).astype(np.int64)
    for first in range(0, len(now), batch):
        part = slice(first, first + batch)
        age.add(stamps[part].tolist(), arrivals[part].tolist())
        found.append((age.latest, age.is_over(0.02)))
    return np.array([value for value, _ in found]), np.array([over for _, over in found])


def test_a_lateness_that_sets_in_is_the_age():
    late = np.zeros(2000)
    late[1000:] = 100 * MS
    age, over = ages(late)
    assert age[:250] == pytest.approx(0.0, abs=1e-9)
    assert age[250:] == pytest.approx(0.1, abs=1e-3)
    assert np.flatnonzero(over)[0] == 251  # the second batch


def test_one_late_batch_is_none():
    late = np.zeros(400)
    late[200:204] = 100 * MS
    late[204:212] = [92 * MS - 2 * MS * k for k in range(8)]
    _, over = ages(late[:204])
    assert not over.any()


def test_a_hold_up_whose_last_reading_is_fresh_is_none():
    """All that came meanwhile arrives at once, and the newest of it is as prompt as ever."""
    late = np.zeros(400)
    late[200:250] = np.arange(49, -1, -1) * 2 * MS
    _, over = ages(late, batch=50)
    assert not over.any()


@pytest.mark.parametrize(("ppm", "seen"), [(0.0, False), (190.0, False), (-500.0, False), (1500.0, True)])
def test_a_clock_that_runs_apart_by_200_ppm_is_followed(ppm, seen):
    """Over two minutes 190 ppm make 23 ms; 1500 ppm make 39 ms within the 30 s of the envelope."""
    _, over = ages(np.random.default_rng(0).uniform(0, MS, 60_000), ppm=ppm)
    assert over.any() == seen


def test_what_was_late_from_the_start_or_half_a_minute_ago_leaves_no_trace():
    late = np.full(40_000, 500 * MS)
    assert not ages(late)[1].any()
    late[:5000] = 0
    age, _ = ages(late)
    assert age[-1] < 1e-3
    assert age[2000] == pytest.approx(0.5, abs=0.01)


def test_batches_may_be_cut_anywhere():
    late = np.random.default_rng(1).uniform(0, 30 * MS, 4000)
    whole, _ = ages(late, batch=40)
    single, _ = ages(late, batch=1)
    assert whole == pytest.approx(single[39::40], abs=1e-12)
