"""The age of readings, by their stamps and arrivals alone."""

import re
from pathlib import Path

import numpy as np
import pytest
from palpate import DeviceError
from palpate_engine import ReadingAge
from palpate_engine.safety.reading_age import StampAge

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


@pytest.mark.parametrize(
    ("ppm", "seen"), [(0.0, False), (190.0, False), (-500.0, False), (450.0, True), (1500.0, True)]
)
def test_a_clock_that_runs_apart_by_200_ppm_is_followed(ppm, seen):
    """Over two minutes 190 ppm make 23 ms, and 450 ppm 30 ms more than 200."""
    _, over = ages(np.random.default_rng(0).uniform(0, MS, 60_000), ppm=ppm)
    assert over.any() == seen


def test_what_was_late_from_the_start_leaves_no_trace_and_what_set_in_remains():
    late = np.full(40_000, 500 * MS)
    assert not ages(late)[1].any()
    late[:5000] = 0
    age, over = ages(late)
    assert age[2000] == pytest.approx(0.5, abs=0.01)
    assert age[-1] > 0.48  # 70 s later
    assert over[1252:].all()


MINUTES = 600.0  # s
TIMES = np.arange(0.0, MINUTES, 0.01)


def first_told(lateness, ppm=0.0):
    """When [s] a lateness (n,) [s] at 100 Hz is told first, of a clock that is slow; None where it never is."""
    jitter = np.random.default_rng(0).exponential(0.3e-3, len(lateness))
    over = np.flatnonzero(ages(1e9 * (lateness + jitter), 10 * MS, ppm, batch=2)[1])
    return None if len(over) == 0 else 0.02 * over[0]


@pytest.mark.parametrize(
    ("lateness", "most"),
    [
        (800e-6 * TIMES, 0.030),  # 0.48 s after ten minutes
        (19e-3 * np.floor(TIMES / 31.0), 0.058),
        (19e-3 * np.floor(np.maximum(TIMES - 100.0, 0.0) / 31.0), 0.039),
        (100e-6 * np.maximum(TIMES - 60.0, 0.0), 0.030),
    ],
    ids=["800 ppm", "steps of 19 ms", "steps that set in", "100 ppm that set in"],
)
@pytest.mark.parametrize("ppm", [0.0, 50.0])
def test_a_lateness_that_grows_is_told_while_it_is_small(lateness, most, ppm):
    when = first_told(lateness, ppm)
    assert lateness[round(100 * when)] < most


def largest_unseen(begin):
    """The largest lateness [s] after ten minutes that is never told, where it grows evenly from a time [s] on."""
    low, high = 0.0, 1e-3
    while high - low > 2e-6:
        rate = (low + high) / 2
        low, high = (rate, high) if first_told(rate * np.maximum(TIMES - begin, 0.0)) is None else (low, rate)
    return low * (MINUTES - begin)


@pytest.mark.slow
@pytest.mark.parametrize(("begin", "most"), [(0.0, 0.14), (60.0, 0.031)])
def test_the_safety_case_states_what_stays_unseen_after_ten_minutes(begin, most):
    page = (Path(__file__).parents[2] / "docs" / "safety-case.md").read_text()
    assert largest_unseen(begin) == pytest.approx(most, abs=2e-3)
    assert f"{1e3 * most:.0f} ms" in page


@pytest.mark.parametrize("ppm", [-150.0, -20.0, 20.0, 150.0])
def test_a_sound_sensor_is_not_late_in_ten_minutes(ppm):
    """Prompt, with a slow start of the link and hold-ups of up to 15 ms, of a quartz that drifts by 10 ppm more."""
    random, warm = np.random.default_rng(1), 10e-6 / MINUTES / 2 * TIMES**2
    slow_start = np.maximum(50e-3 - 10e-3 * TIMES, 0.0)
    hold_ups = np.where(random.random(len(TIMES)) < 0.02, random.uniform(0, 15e-3, len(TIMES)), 0.0)
    assert first_told(slow_start + warm + hold_ups, ppm) is None


def test_a_stamp_of_the_hosts_clock_is_an_age():
    age = StampAge()
    for late, told in ((0.03, False), (0.03, True), (0.01, False), (0.03, False), (0.03, True)):
        age.add(10**18, 10**18 + round(1e9 * late))
        assert (age.complaint("readings of s.z", 0.002, 0.02) is not None) == told


@pytest.mark.parametrize("behind", [1.0, -0.3], ids=["all by 1 s", "the force by 0.3 s"])
def test_stamps_of_the_hosts_clock_that_are_old_stop_the_arm_before_it_presses(run_live, stage, behind):
    with pytest.raises(DeviceError) as caught:
        run_live(f"device.rig.behind={behind}", "safety.reading_age=100 ms", "safety.latency=10 ms")
    age = float(re.search(r"readings of rig.wrench.z are (\d+) ms old by their time-stamps", str(caught.value))[1])
    assert age >= 1e3 * abs(behind)
    assert stage.LINKS[0].stops[0][1] == "retract"


def test_batches_may_be_cut_anywhere():
    late = np.random.default_rng(1).uniform(0, 30 * MS, 4000)
    whole, _ = ages(late, batch=40)
    single, _ = ages(late, batch=1)
    assert whole == pytest.approx(single[39::40], abs=1e-12)
