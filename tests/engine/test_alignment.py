"""Alignment: streams of their own rates, delays and faults become samples."""

from dataclasses import replace

import numpy as np
import pytest
from palpate import Batch, Channel, LogError, Stream
from palpate.estimation import Samples
from palpate.stream_health import Health
from palpate_engine.alignment import Aligner, AlignmentSettings, Ports

FORCE = Stream("wrench", (Channel("z", "N", (-50.0, 50.0)),), 800.0)
MOTION = Stream("tip", (Channel("z", "m"), Channel("vz", "m/s")), 500.0)
RIG = {"rig": (FORCE, MOTION)}


def settings(**changes):
    table = {"force": "rig.wrench.z", "position": "rig.tip.z", "velocity": "rig.tip.vz", "tare": "none"}
    return AlignmentSettings.model_validate({**table, **changes})


def aligner_of(streams, **changes):
    made = settings(**changes)
    return Aligner(made, Ports.of(made, streams))


def stamps(rate, duration, offset=0.0):
    return np.rint((np.arange(round(rate * duration)) / rate + offset) * 1e9).astype(np.int64)


def batch(stream, time, *columns):
    return Batch(stream, time, time, np.column_stack(columns))


def force_of(time):
    return 2.0 + np.sin(2 * np.pi * 2.0 * time / 1e9)


def height_of(time):
    return -0.004 - 0.001 * np.sin(2 * np.pi * 2.0 * time / 1e9)


def speed_of(time):
    return -0.001 * 2 * np.pi * 2.0 * np.cos(2 * np.pi * 2.0 * time / 1e9)


def record(duration=2.0, force_late=0.0, motion_late=0.0):
    """Batches of an exact motion; lateness is in the stamps, as a late stream has it."""
    force, motion = stamps(800.0, duration), stamps(500.0, duration)
    late = round(force_late * 1e9), round(motion_late * 1e9)
    return [
        batch("wrench", force + late[0], force_of(force)),
        batch("tip", motion + late[1], height_of(motion), speed_of(motion)),
    ]


def aligned(batches, **changes):
    aligner = aligner_of(RIG, **changes)
    for item in batches:
        aligner.feed("rig", item)
    return aligner.samples(final=True), aligner.report


def test_samples_stand_at_the_position_stream_with_interpolated_force():
    samples, report = aligned(record())
    assert len(samples) == 1000
    assert samples.force == pytest.approx(force_of(samples.stamp), abs=4e-5)
    np.testing.assert_array_equal(samples.position, height_of(samples.stamp))
    np.testing.assert_array_equal(samples.velocity, speed_of(samples.stamp))
    assert samples.interval[0] == 0
    np.testing.assert_allclose(samples.interval[1:], 0.002)
    assert report.streams["rig.wrench"].rate == pytest.approx(800.0)
    assert report.streams["rig.tip"].rate == pytest.approx(500.0)


@pytest.mark.parametrize(("force_late", "motion_late"), [(0.0, 0.022), (0.012, 0.0), (0.0033, 0.0017)])
def test_declared_delays_are_taken_back(force_late, motion_late):
    samples, _ = aligned(
        record(force_late=force_late, motion_late=motion_late),
        force={"channel": "rig.wrench.z", "delay": force_late},
        position={"channel": "rig.tip.z", "delay": motion_late},
        velocity={"channel": "rig.tip.vz", "delay": motion_late},
    )
    assert samples.force == pytest.approx(force_of(samples.stamp), abs=4e-5)
    assert samples.position == pytest.approx(height_of(samples.stamp), abs=1e-12)


def test_a_delay_that_is_not_declared_shows():
    samples, _ = aligned(record(motion_late=0.022))
    wrong = np.abs(samples.force - force_of(samples.stamp - 22_000_000)).max()
    assert wrong > 0.2


@pytest.mark.parametrize("size", [1, 7, 100, 1601])
def test_samples_do_not_depend_on_how_the_record_is_cut(size):
    changes = {"tare": "free-air", "tare_duration": 0.2, "touch_force": 1.9}
    force, motion = record()
    quiet = [Batch("wrench", force.time, force.time, force.values * (force.time > 5e8)[:, None]), motion]
    whole, _ = aligned(quiet, **changes)
    aligner = aligner_of(RIG, **changes)
    blocks = []
    longest = max(len(b.time) for b in quiet)
    for start in range(0, longest, size):
        for b in quiet:
            rows = slice(start, start + size)
            aligner.feed("rig", Batch(b.stream, b.time[rows], b.received[rows], b.values[rows]))
            blocks.append(aligner.samples())
    blocks.append(aligner.samples(final=True))
    joined = Samples.joined(blocks)
    for name in Samples.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(joined, name), getattr(whole, name), err_msg=name)


def test_velocity_without_a_channel_has_no_delay():
    samples, report = aligned(record(), velocity=None)
    inner = slice(1, -1)
    assert samples.velocity[inner] == pytest.approx(speed_of(samples.stamp[inner]), abs=5e-6)
    assert np.isnan(samples.velocity[[0, -1]]).all()
    assert report.missing_velocity == 2


def test_velocity_of_an_uneven_position_stream():
    motion = stamps(500.0, 2.0) + np.random.default_rng(1).integers(-500_000, 500_000, 1000)
    force = stamps(800.0, 2.0)
    samples, _ = aligned(
        [batch("wrench", force, force_of(force)), batch("tip", motion, height_of(motion), speed_of(motion))],
        velocity=None,
    )
    assert samples.velocity[1:-1] == pytest.approx(speed_of(samples.stamp[1:-1]), abs=1e-5)


def test_the_sign_turns_a_channel_round():
    samples, _ = aligned(record(), velocity={"channel": "rig.tip.vz", "sign": -1})
    np.testing.assert_array_equal(samples.velocity, -speed_of(samples.stamp))


def pressed(noise=0.02, offset=-3.0, seed=0, begin=1.0, duration=3.0):
    """A record that rests in air until `begin`, then presses with 2 N."""
    random = np.random.default_rng(seed)
    force, motion = stamps(800.0, duration), stamps(500.0, duration)
    reading = offset + np.where(force >= begin * 1e9, 2.0, 0.0) + noise * random.standard_normal(len(force))
    return [batch("wrench", force, reading), batch("tip", motion, height_of(motion), speed_of(motion))]


def test_tare_touch_and_noise_come_from_the_free_air():
    samples, report = aligned(pressed(), tare="free-air")
    assert report.tare.offset == pytest.approx(-3.0, abs=5 * report.tare.offset_std)
    assert 0.01 < report.tare.noise < 0.025
    assert report.touch_force == pytest.approx(5 * report.tare.noise)
    assert report.first_touch[0] == pytest.approx(1.0, abs=0.008)
    assert samples.contact[samples.time > 1.01].all()
    assert not samples.contact[samples.time < 0.999].any()
    assert samples.force[samples.time > 1.1].mean() == pytest.approx(2.0, abs=0.01)


def test_a_given_tare_and_the_weight_of_the_tip():
    samples, _ = aligned(pressed(noise=0.0, offset=-3.0), tare="-3 N")
    assert samples.force[-1] == pytest.approx(2.0)
    hung, _ = aligned(pressed(noise=0.0, offset=-0.14 * 9.80665), tare="none", weight="removed", tip_mass="140 g")
    assert hung.force[-1] == pytest.approx(2.0)


def test_a_record_that_begins_in_contact_gives_no_tare():
    with pytest.raises(LogError, match="not at rest in free air"):
        aligned(record(), tare="free-air")


def test_lift_off_and_a_second_touch_are_noticed():
    force, motion = stamps(800.0, 4.0), stamps(500.0, 4.0)
    reading = np.where((force // 1_000_000_000) % 2 == 1, 2.0, 0.0)
    samples, report = aligned(
        [batch("wrench", force, reading), batch("tip", motion, height_of(motion), speed_of(motion))]
    )
    assert report.touches == 2
    seconds = samples.time.astype(int)
    late = samples.time - seconds > 0.01
    assert (samples.contact[late] == (seconds[late] % 2 == 1)).all()


def test_gaps_are_not_interpolated_over():
    force, motion = record()
    keep = (force.time < 5e8) | (force.time > 7e8)
    samples, report = aligned([Batch("wrench", force.time[keep], force.time[keep], force.values[keep]), motion])
    hole = (samples.time > 0.502) & (samples.time < 0.698)
    assert np.isnan(samples.force[hole]).all()
    assert np.isfinite(samples.force[(samples.time < 0.49) | (samples.time > 0.71)]).all()
    assert report.streams["rig.wrench"].gaps == 1
    assert report.missing_force == pytest.approx(100, abs=2)


def test_a_gap_of_the_position_stream_shows_in_the_interval():
    force, motion = record()
    keep = (motion.time < 5e8) | (motion.time >= 7e8)
    samples, report = aligned([force, Batch("tip", motion.time[keep], motion.time[keep], motion.values[keep])])
    assert samples.interval.max() == pytest.approx(0.202)
    assert report.streams["rig.tip"].gaps == 1


def test_duplicates_and_time_going_backwards_are_counted_and_left_out():
    force, motion = record()
    order = np.concatenate([np.arange(800), [799, 799], np.arange(700, 1600)])
    samples, report = aligned([Batch("wrench", force.time[order], force.time[order], force.values[order]), motion])
    health = report.streams["rig.wrench"]
    assert (health.duplicates, health.backwards) == (3, 99)
    clean, _ = aligned(record())
    np.testing.assert_array_equal(samples.force, clean.force)


def test_invalid_and_saturated_readings_are_counted_and_not_used():
    force, motion = record()
    values = force.values.copy()
    values[400:403] = np.nan
    values[800:808] = 50.0
    samples, report = aligned([Batch("wrench", force.time, force.time, values), motion])
    health = report.streams["rig.wrench"]
    assert (health.invalid, health.saturated) == (3, 8)
    assert report.missing_force > 3
    known = np.isfinite(samples.force)
    assert samples.force[known] == pytest.approx(force_of(samples.stamp[known]), abs=3e-4)


def test_a_stuck_sensor_is_noticed():
    force, motion = record()
    values = force.values.copy()
    values[400:800] = values[400]
    _, report = aligned([Batch("wrench", force.time, force.time, values), motion])
    assert report.streams["rig.wrench"].longest_repeat == 400


@pytest.mark.parametrize("pieces", [1, 7, 300])
@pytest.mark.parametrize(
    ("kind", "longest"), [("coarse", 0), ("stuck", 400), ("stuck until the end", 1200), ("none", 1600)]
)
def test_coarse_readings_are_no_stuck_sensor(kind, longest, pieces):
    """They repeat for as long, and go on by one step."""
    force, motion = record()
    values = 3e-3 * np.random.default_rng(2).standard_normal(force.values.shape)
    if kind == "coarse":
        values = np.round(values, 2)
    elif kind == "stuck":
        values[400:800] = values[400]
    elif kind == "stuck until the end":
        values[400:] = values[400]
    else:
        values[:] = 0.0
    cuts = np.array_split(np.arange(len(values)), pieces)
    batches = [Batch("wrench", force.time[rows], force.time[rows], values[rows]) for rows in cuts]
    _, report = aligned([*batches, motion])
    health = report.streams["rig.wrench"]
    assert health.longest_repeat == health.longest_stand == longest


@pytest.mark.parametrize("pieces", [1, 7, 300])
@pytest.mark.parametrize("step", [0.0, 1e-6, 3e-4])
@pytest.mark.parametrize(("fault", "longest"), [("", 0), ("stuck in a ramp", 240), ("stuck until the end", 700)])
def test_a_force_without_noise_stands_where_the_tip_does(fault, longest, step, pieces):
    """Air, a ramp, a hold and a way back: equal readings go on by a usual change, and those of a fault by a leap."""
    force, motion = record()
    depth = np.interp(np.arange(len(force.time)), [0, 300, 800, 1200, len(force.time) - 1], [0.0, 0.0, 1.0, 1.0, 0.2])
    values = np.repeat(0.5 * depth[:, None] ** 1.5, force.values.shape[1], axis=1)
    values = np.round(values / step) * step if step else values
    if fault == "stuck in a ramp":
        values[500:740] = values[500]
    elif fault == "stuck until the end":
        values[len(values) - 700 :] = values[500]
    cuts = np.array_split(np.arange(len(values)), pieces)
    batches = [Batch("wrench", force.time[rows], force.time[rows], values[rows]) for rows in cuts]
    health = aligned([*batches, motion])[1].streams["rig.wrench"]
    assert abs(health.longest_stand - longest) <= (3 if step == 3e-4 else 0)
    assert health.longest_repeat >= longest


def test_host_arrival_can_serve_as_time():
    force, motion = record()
    skewed = Batch("wrench", force.time + 10**15, force.time, force.values)
    samples, _ = aligned([skewed, motion], force={"channel": "rig.wrench.z", "time": "received"})
    assert len(samples) == 1000


def test_no_readings_no_samples():
    samples, report = aligned([])
    assert len(samples) == 0
    assert report.duration == 0


def noisy_record(late=0.0, average=1, duration=10.0):
    """A palpation with the paper's velocity noise and the robot's repeatability of position."""
    random = np.random.default_rng(5)
    force, motion = stamps(800.0, duration), stamps(500.0, duration)
    speed = speed_of(motion - round(late * 1e9)) + 0.67e-3 * random.standard_normal(len(motion))
    if average > 1:
        speed = np.convolve(
            np.concatenate([np.full(average - 1, speed[0]), speed]), np.ones(average) / average, "valid"
        )
    height = height_of(motion) + 5e-6 * random.standard_normal(len(motion))
    return [batch("wrench", force, force_of(force)), batch("tip", motion, height, speed)]


@pytest.mark.parametrize(
    ("late", "average", "expected"), [(0.0, 1, 0.0), (0.005, 1, 0.005), (0.0, 21, 0.020), (-0.003, 1, -0.003)]
)
def test_a_hidden_delay_of_the_velocity_is_found(late, average, expected):
    _, report = aligned(noisy_record(late, average))
    found, uncertainty = report.velocity_delay
    assert uncertainty < 0.3e-3
    assert found == pytest.approx(expected, abs=max(4 * uncertainty, 0.02 * abs(expected)))


@pytest.mark.parametrize("late", [0.0, 0.03])
@pytest.mark.parametrize("factor", [1.0, 3.0, 1e3, -1.0, 0.0])
def test_a_velocity_that_is_not_how_the_position_changes_is_found(factor, late):
    wrench, tip = noisy_record(late)
    values = tip.values.copy()
    values[:, 1] *= factor
    share = aligned([wrench, replace(tip, values=values)])[1].velocity_share
    assert share == pytest.approx(factor, rel=0.1, abs=0.01)


def test_noise_of_a_tip_at_rest_is_no_velocity():
    random, force, motion = np.random.default_rng(2), stamps(800.0, 4.0), stamps(500.0, 4.0)
    noise = random.standard_normal((2, len(motion)))
    given = [batch("wrench", force, force_of(force)), batch("tip", motion, 5e-6 * noise[0], 6e-4 * noise[1])]
    assert aligned(given)[1].velocity_share is None


def test_no_delay_is_told_without_motion_or_without_a_channel():
    force, motion = stamps(800.0, 2.0), stamps(500.0, 2.0)
    still = [batch("wrench", force, force_of(force)), batch("tip", motion, motion * 0.0, motion * 0.0)]
    assert aligned(still)[1].velocity_delay is None
    assert aligned(record(), velocity=None)[1].velocity_delay is None


def test_a_force_that_is_not_zero_in_air_is_reported():
    _, report = aligned(pressed(offset=-0.7), tare="none")
    assert report.air_force == pytest.approx(-0.7, abs=0.01)
    assert aligned(pressed(offset=-0.7), tare="free-air")[1].air_force == pytest.approx(0.0, abs=0.01)
    assert aligned(record(), tare="none")[1].air_force is None


def test_the_tips_place_comes_along_or_is_unknown():
    """A stream of its own and slower, in front of the motion's."""
    place = Stream("place", (Channel("x", "m"), Channel("y", "m")), 100.0)
    time = stamps(100.0, 2.0)
    aligner = aligner_of({"rig": (*RIG["rig"], place)}, lateral_y="rig.place.y")
    for item in [batch("place", time, time / 1e9, 0.004 * time / 1e9), *record()]:
        aligner.feed("rig", item)
    samples = aligner.samples(final=True)
    assert len(samples) > 980
    assert samples.lateral[:, 1] == pytest.approx(0.004 * samples.stamp / 1e9, abs=1e-12)
    assert (samples.lateral[:, 0] == 0.0).all()  # of a line one coordinate is enough
    assert samples[10:20].lateral.shape == (10, 2)
    plain, _ = aligned(record())
    assert plain.lateral.shape == (len(plain), 2)
    assert np.isnan(plain.lateral).all()


@pytest.mark.slow
def test_readings_that_no_instant_can_need_are_forgotten():
    """A minute in blocks of 50 ms: what is held does not grow."""
    aligner, count = aligner_of(RIG), 0
    for second in np.arange(0.0, 60.0, 0.05):
        force, motion = stamps(800.0, 0.05, second), stamps(500.0, 0.05, second)
        aligner.feed("rig", batch("wrench", force, force_of(force)))
        aligner.feed("rig", batch("tip", motion, height_of(motion), speed_of(motion)))
        count += len(aligner.samples())
        assert all(len(series.stamps) <= 3 for series in aligner._roles.values())
    assert count > 59 * 500


def test_no_delay_is_told_by_a_slow_position_or_by_few_readings_of_velocity():
    """Ten positions at 100 Hz blur the motion; 0.15 s of velocity are seven stretches."""
    late = 5_000_000
    for rate, until, told in ((500.0, 2.0, True), (100.0, 8.0, False), (500.0, 0.15, False)):
        force, motion = stamps(800.0, 8.0), stamps(rate, 8.0)
        speed = np.where(motion < until * 1e9, speed_of(motion - late), np.nan)
        given = [batch("wrench", force, force_of(force)), batch("tip", motion, height_of(motion), speed)]
        assert (aligned(given)[1].velocity_delay is not None) == told


def test_drift_of_a_clock_is_told_from_the_fifths_at_both_ends():
    """Late by 1 ms more each second: of six, the first two and the last two are four seconds apart."""
    health = Health(Stream("tip", MOTION.channels, 500.0, clock="log"))
    for second in range(6):
        at = np.arange(second * 10**9, (second + 1) * 10**9, 10**8)
        health.arrived(at, at + 50_000_000 + second * 1_000_000)
        health.in_order(at, 10**10)
        assert (health.gained is None) == (second < 3)
    assert health.gained == pytest.approx(-4e-3, rel=1e-12)
