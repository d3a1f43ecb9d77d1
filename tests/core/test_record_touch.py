"""Touch by the noise of the record: presses from 43 mN to 20 nN, and air that moves, hums, drifts."""

import numpy as np
import pytest
from palpate import Batch, Channel, Stream
from palpate.estimation import Samples
from palpate_engine.alignment import Aligner, AlignmentSettings, Ports

STREAM = Stream("", (Channel("force", "N"), Channel("height", "m")), None)


def aligned(time, force, height, size=None, most_mass=1.0, **changes):
    """Samples and report of a record that states nothing, cut into pieces of `size` readings."""
    table = {"force": "log.force", "position": "log.height", "touch_force": "noise", **changes}
    settings = AlignmentSettings.model_validate(table)
    aligner = Aligner(settings, Ports.of(settings, {"log": (STREAM,)}), most_mass=most_mass)
    stamp, values = np.round(1e9 * time).astype(np.int64), np.column_stack([force, height])
    blocks = []
    for begin in range(0, len(time), size or len(time)):
        rows = slice(begin, begin + (size or len(time)))
        aligner.feed("log", Batch("", stamp[rows], stamp[rows], values[rows]))
        blocks.append(aligner.samples())
    blocks.append(aligner.samples(final=True))
    return Samples.joined(blocks), aligner.report


def press(peak, ratio, seed, rate=200.0, air=1.0, lasts=2.0, deep=3e-3, offset=0.0):
    """Rest, way down and press of `peak` [N] by a sphere with white noise of peak/ratio; the surface is at 0."""
    random = np.random.default_rng(seed)
    time = np.arange(round((air + 1.6 * lasts) * rate)) / rate
    height = 0.3 * deep - deep / lasts * np.clip(time - air, 0.0, 1.3 * lasts)
    force = offset + peak * (np.maximum(-height, 0.0) / deep) ** 1.5 + peak / ratio * random.standard_normal(len(time))
    return time, force, height + 1e-4 * deep * random.standard_normal(len(time))


@pytest.mark.parametrize("ratio", [140, 400])
@pytest.mark.parametrize("peak", [43e-3, 1e-3, 1e-6, 20e-9])
def test_a_small_press_is_found_with_nothing_stated(peak, ratio):
    """The threshold would be 0.05 N or 0.25 N."""
    deep = 3e-3 if peak > 1e-4 else 3e-6
    for seed in range(3):
        samples, report = aligned(*press(peak, ratio, seed, deep=deep, offset=2 * peak))
        assert report.touches == 1
        assert abs(report.first_touch[1]) < 0.04 * deep
        assert abs(samples.position[int(np.argmax(samples.contact))]) < 0.04 * deep
        assert report.tare.offset == pytest.approx(2 * peak, abs=0.01 * peak)
        assert samples.contact[-1]


def test_a_slow_small_press_is_no_drift():
    """1 mN in 280 s after 10 s of air, ten readings a second."""
    record = press(1e-3, 400, 0, rate=10.0, air=10.0, lasts=280.0, deep=1e-4)
    _, report = aligned(*record)
    assert abs(report.first_touch[1]) < 0.04 * 1e-4


def test_a_press_of_a_heavy_tip_is_found_where_it_is():
    """10 mN of contact behind 60 mN by which 300 g are set in motion."""
    rate, push = 500.0, 0.2
    time = np.arange(2000) / rate
    acceleration = -push * ((time >= 1.0) & (time < 1.05))
    height = 5e-3 + np.cumsum(np.cumsum(acceleration)) / rate**2
    contact = 10e-3 * (np.maximum(-height, 0.0) / -height.min()) ** 1.5
    force = contact - 0.3 * acceleration + 5e-5 * np.random.default_rng(0).standard_normal(len(time))
    _, report = aligned(time, force, height)
    assert report.touches == 1
    assert abs(report.first_touch[1]) < 1e-3
    _, light = aligned(time, force, height, most_mass=0.0)
    assert light.first_touch is None or light.first_touch[1] > 1e-3


def test_a_robot_keeps_its_threshold():
    """Nothing stated, and no word of noise: 50 mN, as in every live run."""
    time, force, height = press(43e-3, 400, 0)
    _, report = aligned(time, force, height, touch_force=None)
    assert report.first_touch is None
    assert report.touch_force == pytest.approx(0.05)


@pytest.mark.parametrize("size", [7, 333])
def test_how_a_record_is_cut_changes_nothing(size):
    record = press(10e-3, 200, 2)
    whole, told = aligned(*record)
    cut, report = aligned(*record, size)
    for name in Samples.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(cut, name), getattr(whole, name), err_msg=name)
    assert (report.tare, report.first_touch) == (told.tare, told.first_touch)


NOISE = 1e-3


def way(random, rate):
    """Time [s], height [m] and acceleration [m/s2] of a way in air: a trapezoid of the speed, or a sine."""
    time = np.arange(round(6.0 * rate)) / rate
    since = np.maximum(time - random.uniform(0.4, 1.5), 0.0)
    if random.random() < 0.5:
        turn = 2 * np.pi * random.uniform(0.3, 2.0)
        size = random.uniform(0.5e-3, 4e-3)
        return time, 0.05 - size * (1 - np.cos(turn * since)), -size * turn**2 * np.cos(turn * since) * (since > 0)
    speed, ramp, until = random.uniform(2e-3, 2e-2), random.uniform(0.03, 0.2), random.uniform(2.0, 3.5)
    push = speed / ramp
    acceleration = -push * ((since > 0) & (since < ramp)) + push * ((since > until) & (since < until + ramp))
    return time, 0.05 + np.cumsum(np.cumsum(acceleration)) / rate**2, acceleration


def air_of(kind, seed):
    random = np.random.default_rng(seed)
    rate = float(random.choice([100.0, 250.0, 500.0]))
    time, height, acceleration = way(random, rate)
    force = NOISE * random.standard_normal(len(time))
    match kind:
        case "hum":
            force += random.uniform(0.5, 5) * NOISE * np.sin(2 * np.pi * 50.03 * time)
        case "inertia":
            force -= random.uniform(0.0, 0.5) * acceleration
        case "drift":
            force += random.uniform(-40, 40) * NOISE * time / time[-1]
        case "cable":
            force += random.uniform(-2.0, 2.0) * (height - height[0])
        case "low-pass":
            width = round(random.uniform(0.01, 0.1) * rate)
            force = np.convolve(force, np.ones(width) / np.sqrt(width), "same")
        case "rounding":
            step = random.uniform(0.5, 8) * NOISE
            force = step * np.round((force + random.uniform(-20, 20) * NOISE * time / time[-1]) / step)
    return time, force, height + random.choice([1e-7, 1e-6, 5e-6]) * random.standard_normal(len(time))


KINDS = ["white", "hum", "inertia", "drift", "cable", "low-pass", "rounding"]


@pytest.mark.parametrize("kind", KINDS)
def test_air_is_no_touch(kind):
    assert aligned(*air_of(kind, 0))[1].first_touch is None


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_air_is_no_touch_however_it_moves(kind):
    assert not [seed for seed in range(1, 40) if aligned(*air_of(kind, seed))[1].first_touch is not None]


def slow_way(random, time):
    """Height [m] of a way that lasts as long as a wave of hum that is sampled too slowly."""
    since = np.maximum(time - random.uniform(0.4, 1.5), 0.0)
    half = random.uniform(2.0, 6.0)
    match random.integers(4):
        case 0:
            return 0.05 - random.uniform(5e-4, 4e-3) * (1 - np.cos(2 * np.pi * random.uniform(0.05, 2.0) * since))
        case 1:
            return 0.05 - random.uniform(1e-4, 1e-2) * since
        case 2:
            return 0.05 - np.minimum(random.uniform(1e-4, 1e-2) * since, random.uniform(1e-3, 2e-2))
    return 0.05 - random.uniform(5e-4, 5e-3) * np.clip(np.minimum(since / half, 2 - since / half), 0.0, 1.0)


def aliased(seed, line, rates):
    """Air with hum of a line [Hz] at rates [1/s] that make a wave of many seconds of it; eight standard deviations."""
    random = np.random.default_rng(seed)
    rate = float(random.choice(rates))
    time = np.arange(round(random.uniform(7.0, 20.0) * rate)) / rate
    height = slow_way(random, time) + 1e-6 * random.standard_normal(len(time))
    hum = random.uniform(0.5, 8.0) * np.sin(2 * np.pi * line * time + random.uniform(0, 2 * np.pi))
    return time, NOISE * (hum + random.standard_normal(len(time))), height


SEEDS = {50.07: (1, 2), 49.9: (2, 8), 60.05: (0, 2)}  # of records that were touched before
LINES = [(50.07, (10.0, 50.0)), (49.9, (10.0, 25.0, 50.0)), (60.05, (10.0, 20.0, 30.0, 60.0))]


@pytest.mark.parametrize(("line", "rates"), LINES)
def test_hum_that_is_sampled_too_slowly_is_no_touch(line, rates):
    """It looks like a force that rises along the way, once."""
    assert not [seed for seed in SEEDS[line] if aligned(*aliased(seed, line, rates))[1].first_touch is not None]


@pytest.mark.slow
@pytest.mark.parametrize(("line", "rates"), LINES)
def test_hum_that_is_sampled_too_slowly_is_no_touch_however_the_tip_moves(line, rates):
    assert not [seed for seed in range(80) if aligned(*aliased(seed, line, rates))[1].first_touch is not None]


@pytest.mark.parametrize("rate", [10.0, 50.0])
def test_a_press_under_hum_that_is_sampled_too_slowly_is_found(rate):
    """A wave of two standard deviations of the noise, which a press is not."""
    time, force, height = press(43e-3, 140, 0, rate=rate, air=3.0, lasts=10.0)
    _, report = aligned(time, force + 2 * 43e-3 / 140 * np.sin(2 * np.pi * 50.07 * time), height)
    assert abs(report.first_touch[1]) < 0.08 * 3e-3


def microscope(seed, contact=True):
    """A curve over 1 to 3 um of air, 0.25 to 6 s: a baseline of one or two slow waves of 0.1 to 0.4 % of the press.

    Times [s], force [N] and height [m].
    """
    random = np.random.default_rng(seed)
    count = int(random.integers(500, 1500))
    depth = np.linspace(-random.uniform(1.0, 3.0), random.uniform(0.5, 1.5), count)
    force = (np.maximum(depth, 0.0) / depth[-1]) ** 1.5 if contact else np.zeros(count)
    force += 10 ** random.uniform(-4.0, -2.7) * random.standard_normal(count)
    size = random.uniform(1e-3, 4e-3)
    for _ in range(1 + seed % 2):
        force += size * np.sin(2 * np.pi * depth / random.uniform(2.0, 6.0) + random.uniform(0.0, 2 * np.pi))
    force += random.uniform(-0.2, 0.2) + random.uniform(-3e-3, 3e-3) * depth
    return random.uniform(0.5e-3, 4e-3) * np.arange(count), 100e-9 * force, -1e-6 * depth


@pytest.mark.parametrize("seed", range(8))
def test_a_press_under_a_baseline_that_bends_is_found(seed):
    """The line of an optical lever in air: its bend was a touch, far above the surface."""
    _, report = aligned(*microscope(seed), most_mass=0.0)
    assert abs(report.first_touch[1]) < 0.1e-6
    assert aligned(*microscope(seed, contact=False), most_mass=0.0)[1].first_touch is None


@pytest.mark.slow
def test_presses_and_air_under_many_baselines():
    touches = [aligned(*microscope(seed), most_mass=0.0)[1].first_touch for seed in range(8, 80)]
    assert not [touch for touch in touches if touch is None or abs(touch[1]) > 0.1e-6]
    air = [aligned(*microscope(seed, contact=False), most_mass=0.0)[1].first_touch for seed in range(8, 80)]
    assert not [touch for touch in air if touch is not None]


@pytest.mark.parametrize("noise", [1e-12, 1e-11, 1e-10])
def test_a_curve_that_begins_in_contact_is_touched_from_its_first_reading(noise):
    """As averages that are exported from the contact on, in N and m: there is no air that shows the noise."""
    depth = np.linspace(0.0, 3e-6, 3000)
    force = 1e-7 * (depth / 3e-6) ** 1.5 + noise * np.random.default_rng(5).standard_normal(3000)
    samples, report = aligned(np.arange(3000) / 1e3, force, -depth, most_mass=0.0, tare="none")
    assert report.touches == 1
    assert np.argmax(samples.contact) < 300
    assert samples.contact[-1]


@pytest.mark.parametrize("word", ["nois", "0 N", "-1 N", 1e6])
def test_what_is_no_force_of_touch_is_refused(word):
    with pytest.raises(ValueError, match="touch_force"):
        AlignmentSettings.model_validate({"force": "a.b", "position": "a.c", "touch_force": word})
