"""Where contact begins, and what the tare is made of: slow ramps, fast approaches, drift, air of every length."""

import numpy as np
import pytest
from palpate import Batch, Channel, Stream
from palpate.estimation import Samples
from palpate_engine.alignment import Aligner, AlignmentSettings, Ports
from palpate_engine.alignment.change_point import change_point

FORCE = Stream("wrench", (Channel("z", "N", (-50.0, 50.0)),), 500.0)
MOTION = Stream("tip", (Channel("z", "m"),), 500.0)
NOISE, RATE = 0.05, 500.0


def hertz(depth, elasticity=112.5e3, radius=5e-3):
    """Force [N] of a sphere on a half-space, nu = 0.5."""
    return 16.0 / 9.0 * elasticity * np.sqrt(radius) * np.maximum(depth, 0.0) ** 1.5


def batches(height, seed=0, noise=NOISE, offset=-1.7, drift=0.0, law=hertz):
    """Readings of a motion (n,) [m] over a surface at 0."""
    random = np.random.default_rng(seed)
    stamp = np.arange(len(height), dtype=np.int64) * round(1e9 / RATE)
    force = law(-height) + offset + drift * stamp / 1e9 + noise * random.standard_normal(len(height))
    measured = height + 5e-6 * random.standard_normal(len(height))
    return [Batch("wrench", stamp, stamp, force[:, None]), Batch("tip", stamp, stamp, measured[:, None])]


def ramp(speed, rest=1.0, air=1e-3, deep=2e-3):
    """Rest, then down at constant speed."""
    down = np.arange(0.0, air + deep, speed / RATE)
    return np.concatenate([np.full(round(rest * RATE), air), air - down])


def finder(**changes):
    table = {"force": "rig.wrench.z", "position": "rig.tip.z", **changes}
    settings = AlignmentSettings.model_validate(table)
    return Aligner(settings, Ports.of(settings, {"rig": (FORCE, MOTION)}))


def aligned(given, size=None, **changes):
    """Samples and report, the record cut into pieces of `size` readings."""
    aligner = finder(**changes)
    length = len(given[0].time)
    blocks = []
    for start in range(0, length, size or length):
        rows = slice(start, start + (size or length))
        for item in given:
            aligner.feed("rig", Batch(item.stream, item.time[rows], item.received[rows], item.values[rows]))
        blocks.append(aligner.samples())
    blocks.append(aligner.samples(final=True))
    return Samples.joined(blocks), aligner.report


@pytest.mark.parametrize("speed", [50e-3 / 60, 4e-3, 20e-3])
def test_contact_begins_at_the_surface(speed):
    """5 sigma are reached 0.66 mm deep at any speed, 0.8 s after touch at 50 mm/min."""
    found = []
    for seed in range(10):
        samples, report = aligned(batches(ramp(speed), seed))
        first = int(np.argmax(samples.contact))
        assert report.by_change_point
        assert samples.contact[first:].all()
        found.append(samples.position[first])
    late = -np.mean(found) / speed
    assert abs(np.mean(found)) < 0.04e-3
    assert abs(late) < 0.04
    assert np.std(found) < 0.08e-3


def test_a_slow_ramp_is_not_untared_and_its_tare_is_that_of_the_air():
    for seed in range(10):
        _, report = aligned(batches(ramp(50e-3 / 60), seed))
        assert report.air_force == pytest.approx(0.0, abs=4 * NOISE / np.sqrt(400))


@pytest.mark.parametrize("rest", [0.0, 0.2, 0.5])
def test_contact_within_the_window_of_the_tare_shortens_it(rest):
    """The ramp passes the surface 0.36 s after the rest."""
    offsets = []
    for seed in range(20):
        _, report = aligned(batches(ramp(50e-3 / 60, rest, air=0.3e-3), seed))
        begins = rest + 0.3e-3 / (50e-3 / 60)
        assert report.tare.until == pytest.approx(min(begins, 0.9), abs=0.12)
        assert abs(report.tare.offset + 1.7) < 5 * report.tare.offset_std
        offsets.append(report.tare.offset)
    assert np.mean(offsets) == pytest.approx(-1.7, abs=0.006)


def test_a_touch_too_light_for_the_threshold_shortens_the_tare_too():
    """0.5 mm/s from 0.65 s on: 0.1 N at the end of what the tare is settled on, where 0.25 N count as touch."""
    found = [aligned(batches(ramp(0.5e-3, 0.05, air=0.3e-3, deep=0.4e-3), seed))[1].tare for seed in range(10)]
    assert np.mean([tare.until for tare in found]) == pytest.approx(0.65, abs=0.1)
    assert np.mean([tare.offset for tare in found]) == pytest.approx(-1.7, abs=0.007)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [50e-3 / 60, 4e-3])
@pytest.mark.parametrize("rest", [0.2, 1.6])
def test_it_does_not_depend_on_how_the_record_is_cut(speed, rest):
    given = batches(ramp(speed, rest, air=0.5e-3), seed=3)
    whole, told = aligned(given)
    for size in (1, 7, 100, 333):
        cut, report = aligned(given, size)
        for name in Samples.__dataclass_fields__:
            np.testing.assert_array_equal(getattr(cut, name), getattr(whole, name), err_msg=f"{name} {size}")
        assert report.first_touch == told.first_touch
        assert (report.tare, report.air_force) == (told.tare, told.air_force)


def pushed(given, at, count=6, force=0.5):
    """The same readings, with a force on some of them: the mass of a tip that is set in motion again."""
    wrench, tip = given
    values = wrench.values.copy()
    values[at : at + count] += force
    return [Batch("wrench", wrench.time, wrench.received, values), tip]


@pytest.mark.slow
@pytest.mark.parametrize("rest", [1.0, 2.0])  # within what the tare is settled on, and after it
def test_a_push_on_the_way_down_is_no_touch(rest):
    height = ramp(4e-3, rest, air=1.5e-3)
    given = pushed(batches(height, seed=2), round((rest + 0.1) * RATE))
    whole, told = aligned(given)
    assert told.touches == 1
    assert told.first_touch[1] == pytest.approx(0.0, abs=0.15e-3)
    for size in (1, 7, 100):
        cut, report = aligned(given, size)
        np.testing.assert_array_equal(cut.contact, whole.contact, err_msg=str(size))
        assert (report.first_touch, report.tare) == (told.first_touch, told.tare)


def test_a_tap_shorter_than_what_is_awaited_is_a_touch():
    way = 0.4e-3 - 1.4e-3 * np.sin(np.pi * np.arange(60) / 60)  # 0.12 s, 0.1 s of it in the material
    height = np.concatenate([np.full(1000, 0.4e-3), way, np.full(500, 0.4e-3)])
    assert aligned(batches(height))[1].first_touch[0] == pytest.approx(2.01, abs=0.02)


def test_samples_are_held_back_for_the_lag_and_no_longer():
    given = batches(ramp(4e-3, rest=3.0), seed=1)
    aligner = finder()
    length = len(given[0].time)
    for start in range(0, length, 5):
        rows = slice(start, start + 5)
        for item in given:
            aligner.feed("rig", Batch(item.stream, item.time[rows], item.received[rows], item.values[rows]))
        samples = aligner.samples()
        behind = aligner.reached - (samples.time[-1] if len(samples) else 0.0)
        if len(samples) and samples.time[-1] > 1.5:
            assert behind < (0.02 if samples.contact[-1] else 0.52)


def test_neither_drift_nor_coloured_noise_nor_inertia_is_touch():
    """Five minutes of 1.5 N/h, noise through a filter of 40 ms, and a tip of 140 g that sets off at 50 mm/s."""
    down = np.linspace(60e-3, 10e-3, round(300 * RATE))
    assert aligned(batches(down, drift=1.5 / 3600))[1].first_touch is None
    for seed in range(5):
        noise = np.convolve(np.random.default_rng(seed).standard_normal(20_000), np.ones(20) / np.sqrt(20), "same")
        given = batches(np.linspace(50e-3, 10e-3, 20_000), seed, noise=0.0)
        coloured = given[0].values + 0.02 * noise[:, None]
        given[0] = Batch("wrench", given[0].time, given[0].received, coloured)
        assert not aligned(given)[1].by_change_point
    time = np.arange(3000) / RATE
    height = 60e-3 - 50e-3 * np.clip(time - 2.0, 0.0, 1.0)
    push = 0.14 * 50e-3 / 0.1 * ((time > 2.0) & (time < 2.1))
    given = batches(height, noise=0.02, law=lambda depth: push)
    assert aligned(given)[1].first_touch is None


@pytest.mark.parametrize("power", [1.0, 2.0])
def test_other_tips_are_touched_where_they_touch(power):
    """A flat tip and a cone, of 0.25 N at 0.5 mm."""
    found = []
    for seed in range(10):
        law = lambda depth: 0.25 * np.maximum(depth / 0.5e-3, 0.0) ** power  # noqa: E731
        _, report = aligned(batches(ramp(4e-3), seed, law=law))
        found.append(report.first_touch[1])
    assert abs(np.mean(found)) < 0.25e-3  # the threshold is passed at 0.5 mm


def test_a_threshold_that_is_set_is_kept_where_nothing_is_held_back():
    samples, report = aligned(batches(ramp(4e-3), seed=2), touch_force="0.5 N", touch_lag=0)
    assert not report.by_change_point
    assert hertz(-samples.position[samples.contact][0]) == pytest.approx(0.5, abs=0.15)


def test_lift_off_after_a_doubtful_touch_is_noticed():
    """The tip only grazes the surface, too lightly for the threshold, and goes up again."""
    down = ramp(50e-3 / 60, rest=1.5, air=0.5e-3, deep=0.45e-3)
    samples, report = aligned(batches(np.concatenate([down, down[::-1]]), seed=4))
    assert report.touches == 1
    assert samples.contact.any()
    assert not samples.contact[-200:].any()


def test_noise_of_few_samples_is_not_called_too_small():
    """Offset, rise and height are fitted: three of 24 samples say nothing of the noise."""
    z = np.linspace(1e-3, -1e-3, 24)
    found = [
        change_point(z, hertz(-z) + NOISE * np.random.default_rng(seed).standard_normal(24)).rms ** 2
        for seed in range(400)
    ]
    assert np.mean(found) == pytest.approx(NOISE**2, rel=4 * np.sqrt(2 / 21 / 400))


def test_a_drift_in_free_air_is_no_touch():
    """150 N/h for 20 s, as 1.5 N/h in half an hour: 0.8 N; the contact that follows is found where it is."""
    height = ramp(4e-3, rest=20.0)
    given = batches(height, seed=3, drift=150 / 3600)
    _, deaf = aligned(given)
    assert deaf.first_touch[0] < 15.0  # 1.5 N/h is what is expected where nothing is said
    _, report = aligned(given, drift="150 N/h")
    assert report.first_touch[0] == pytest.approx(20.25, abs=0.08)
    assert report.touches == 1


def test_contact_ends_below_the_surface_where_the_force_is_gone():
    """After a touch that a rise told, and after the force has passed the threshold: the material has given way.

    That is the beginning of a block, as velocities without a channel make it.
    """
    height = np.concatenate([ramp(50e-3 / 60, rest=1.5, air=0.5e-3, deep=1.2e-3), np.full(1000, -1.2e-3)])
    given = batches(height, seed=4)
    given[0].values[-600:, 0] = -1.7 + NOISE * np.random.default_rng(9).standard_normal(600)
    samples, report = aligned(given, size=len(height) - 600 + 1)
    assert report.by_change_point
    assert samples.contact[-900:-610].all()
    assert not samples.contact[-500:].any()


@pytest.mark.parametrize(("count", "touches"), [(2, 1), (3, 2)])
def test_three_samples_in_a_row_are_a_touch(count, touches):
    """A press, a lift, and a blip after it, without noise."""
    down = np.linspace(2e-3, -1e-3, 400)
    given = batches(np.concatenate([np.full(600, 2e-3), down, down[::-1], np.full(400, 2e-3)]), noise=0.0)
    given[0].values[-200 : -200 + count, 0] += 1.0
    samples, report = aligned(given)
    assert report.touches == touches
    assert np.flatnonzero(samples.contact[-300:]).tolist() == ([102, 103, 104] if touches == 2 else [])
