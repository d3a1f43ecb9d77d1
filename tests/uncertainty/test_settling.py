"""What a track says of its way to rest: nothing of a random walk, nothing on a sweep, all of a slow approach."""

import numpy as np
from palpate.alignment_report import Tare
from palpate.estimation import Estimates, Samples
from palpate.evidence.track_evidence import TrackEnd
from palpate.evidence.track_tail import Tail
from palpate_engine.alignment import AlignmentReport, AlignmentSettings
from palpate_engine.result import TrackRecord
from palpate_models import KelvinVoigt
from palpate_uncertainty.plausibility import ending_flags
from palpate_uncertainty.reading_faults import air_force_flags

TIME = np.arange(0.0, 3.0, 0.002)


def tail(values):
    nothing = np.zeros(len(values))
    return Tail(TIME, nothing, nothing, nothing, values[:, None], nothing[:, None], *[nothing] * 5)


def test_a_random_walk_is_not_on_its_way():
    """A surface that wanders by 6.6 um in a second, after an hour."""
    ways = []
    for seed in range(200):
        steps = 6.6e-6 * np.sqrt(0.002) * np.random.default_rng(seed).standard_normal(len(TIME))
        ways.append(float(tail(np.cumsum(steps)).unsettled(np.cumsum(steps)[:, None], 3524.0)[0]))
    assert np.mean(np.array(ways) > 0) < 0.05


def test_what_dies_away_as_a_power_of_time_is():
    for power in (0.5, 1.0, 2.0):
        values = 100.0 * (1 + 0.5 / (TIME + 7.0) ** power)
        left = values[-1] - 100.0
        assert 0.5 * power * left < tail(values).unsettled(values[:, None], 10.0)[0] < 3.0 * power * left + 1e-9


def record(values, lateral=None, scale=1.0, std=None, swing=2.0):
    n = len(TIME)
    force = scale * (2.0 + swing / 2 * np.sin(12.0 * TIME))
    ones, contact = np.ones(n), np.ones(n, bool)
    place = np.full((n, 2), np.nan) if lateral is None else np.column_stack([lateral, 0 * lateral])
    stamp = np.rint(TIME * 1e9).astype(np.int64)
    samples = Samples(stamp, TIME, np.diff(TIME, prepend=0.0), force, -1e-3 * ones, 0 * ones, contact, contact, place)
    table = np.column_stack([values, values])
    doubt = 1e-6 * table if std is None else np.column_stack([std, std])
    found = Estimates(TIME, table, doubt, 0 * ones, 1e-6 * ones, force, ones, np.zeros(n, np.uint32))
    made = TrackRecord(3.0)
    made.add(samples, found, 0.0)
    return made


def ending(made, report):
    settings = AlignmentSettings.model_validate({"force": "a.f", "position": "a.z"})
    whole = 1.0, made.tracked, made.samples, made.is_sweep
    return TrackEnd(*made.ends(1.0), settings, report, {}, made.held, frozenset(), *whole)


def codes(made, touch_force=0.25, tare=None):
    end = ending(made, AlignmentReport({}, tare, touch_force, None, 1, None, 1500, 0, 0, 3.0, None))
    return {flag.code for flag in ending_flags(end, made.keeper.kept, KelvinVoigt(), online=True, fitted=False)}


def test_a_sweep_over_a_lump_is_not_unconverged():
    values = 100.0 * (1 + 0.1 * TIME)
    assert "not-converged" in codes(record(values))
    assert "not-converged" not in codes(record(values, lateral=4e-3 * TIME))


def test_data_in_nanonewtons_are_judged_by_their_own_noise():
    assert "not-identifiable" not in codes(record(100.0 + 0 * TIME, scale=1e-9), touch_force=1e-10)


def test_an_offset_in_air_is_judged_by_the_force_that_counts_as_touch():
    def untared(air, touch):
        report = AlignmentReport({}, Tare(0.0, 0.001, touch / 5), touch, None, 1, air, 1500, 0, 0, 3.0, None)
        return bool(list(air_force_flags(KelvinVoigt(), ending(record(100.0 + 0 * TIME), report), None)))

    assert untared(0.06, 0.25)
    assert not untared(0.04, 0.25)
    assert untared(1e-9, 1e-9)
    assert not untared(0.5, 5.0)


def test_the_walk_of_an_optimal_estimate_is_not_its_way():
    """The mean of all readings so far, 7 to 10 s after it began: its std stands beside it."""
    flagged = []
    for seed in range(100):
        readings = 100.0 + 500.0 * np.random.default_rng(seed).standard_normal(5000)
        count = np.arange(1, 5001)
        mean, std = np.cumsum(readings) / count, 500.0 / np.sqrt(count)
        made = record(mean[-len(TIME) :], std=std[-len(TIME) :])
        made.nanoseconds = 10**10
        flagged.append("not-converged" in codes(made))
    assert sum(flagged) <= 1
    made = record(100.0 * (1 + 0.5 / (TIME + 7.0)), std=10.0 / np.sqrt(TIME + 7.0) / 30)
    made.nanoseconds = 10**10
    assert "not-converged" in codes(made)


def weak(swing, noise=0.05, count=5000):
    """Flags of a spring (100 N/m) and a dashpot (0.7 N s/m) whose force swings by so many times its noise."""
    n, size = len(TIME), swing * noise / 2 / np.hypot(100.0, 0.7 * 12.0)
    depth, rate = 4e-3 + size * np.sin(12.0 * TIME), 12.0 * size * np.cos(12.0 * TIME)
    force, contact = 100.0 * depth + 0.7 * rate, np.ones(n, bool)
    stamp = np.rint(TIME * 1e9).astype(np.int64)
    samples = Samples(stamp, TIME, np.diff(TIME, prepend=0.0), force, -depth, -rate, contact, contact)
    table = np.column_stack([np.full(n, 100.0), np.full(n, 0.7)])
    found = Estimates(
        TIME, table, 0.05 * table, 0 * TIME, 1e-6 + 0 * TIME, force, contact + 0.0, np.zeros(n, np.uint32)
    )
    made = TrackRecord(3.0)
    made.add(samples, found, 0.0)
    made.nanoseconds, made.samples = 10**10, count
    return codes(made, tare=Tare(0.0, 0.001, noise))


def test_a_weak_force_is_judged_by_what_the_record_can_tell():
    """With 5000 samples the damping's bound is 0.05 N/sqrt(5000) over the RMS of its force: 12 % at 4, 22 % at 2.2."""
    assert "not-identifiable" not in weak(4.0)
    assert "not-identifiable" in weak(2.2)
    assert "not-identifiable" in weak(1.0)
    assert "not-identifiable" not in weak(1.0, count=50_000)


def test_a_number_that_is_known_has_no_way_to_rest_and_keeps_its_digits():
    """0.3 mm over and over summed to 0.29999999999999989 mm, with a slope that was rounding."""
    known = np.full(len(TIME), 0.3e-3)
    assert tail(known).unsettled(known[:, None], 10.0)[0] == 0.0
    assert float(Tail.mean(known)) == 0.3e-3
    moving = known + np.linspace(0.0, 1e-6, len(TIME))
    assert tail(moving).unsettled(moving[:, None], 10.0)[0] > 0.0
