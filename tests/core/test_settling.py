"""What a track says of its way to rest: nothing of a random walk, nothing on a sweep, all of a slow approach."""

import numpy as np
from palpate.alignment import AlignmentReport
from palpate.alignment.tare import Tare
from palpate.estimation import Estimates, Samples
from palpate.result import TrackRecord
from palpate.result.flags import alignment_flags, track_flags
from palpate.result.record import Tail
from palpate_models import KelvinVoigt

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


def record(values, lateral=None, scale=1.0):
    n = len(TIME)
    force = scale * (2.0 + np.sin(12.0 * TIME))
    ones, contact = np.ones(n), np.ones(n, bool)
    place = np.full((n, 2), np.nan) if lateral is None else np.column_stack([lateral, 0 * lateral])
    stamp = np.rint(TIME * 1e9).astype(np.int64)
    samples = Samples(stamp, TIME, np.diff(TIME, prepend=0.0), force, -1e-3 * ones, 0 * ones, contact, contact, place)
    table = np.column_stack([values, values])
    found = Estimates(TIME, table, 1e-6 * table, 0 * ones, 1e-6 * ones, force, ones, np.zeros(n, np.uint32))
    made = TrackRecord(3.0)
    made.add(samples, found, 0.0)
    return made


def codes(made, touch_force=0.25, tare=None):
    report = AlignmentReport({}, tare, touch_force, None, 1, None, 1500, 0, 0, 3.0, None)
    return {flag.code for flag in track_flags(made, KelvinVoigt(), report, 1.0)}


def test_a_sweep_over_a_lump_is_not_unconverged():
    values = 100.0 * (1 + 0.1 * TIME)
    assert "not-converged" in codes(record(values))
    assert "not-converged" not in codes(record(values, lateral=4e-3 * TIME))


def test_data_in_nanonewtons_are_judged_by_their_own_noise():
    assert "not-identifiable" not in codes(record(100.0 + 0 * TIME, scale=1e-9), touch_force=1e-10)


def test_an_offset_in_air_is_judged_by_the_force_that_counts_as_touch():
    def untared(air, touch):
        report = AlignmentReport({}, Tare(0.0, 0.001, touch / 5), touch, None, 1, air, 1500, 0, 0, 3.0, None)
        from palpate.alignment import AlignmentSettings

        settings = AlignmentSettings.model_validate({"force": "a.f", "position": "a.z"})
        return "untared" in {flag.code for flag in alignment_flags(report, settings)}

    assert untared(0.06, 0.25)
    assert not untared(0.04, 0.25)
    assert untared(1e-9, 1e-9)
    assert not untared(0.5, 5.0)
