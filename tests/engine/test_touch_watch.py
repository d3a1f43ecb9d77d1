"""The force against the place of the tip: the watch alone, on readings of 800 Hz and looks each 2.5 ms."""

from dataclasses import replace

import numpy as np
import pytest
from palpate_engine import RiseWatch, SoundForce, TouchWatch, touch_outlier_text

STEP, NOISE = 1 / 400, 0.02  # [s] between two looks, two readings each; [N]
HIGH = 3e-3  # [m] of travel
RNG = np.random.default_rng(0)
STANDSTILL = NOISE * RNG.standard_normal(800)
SOUND = replace(
    SoundForce.of("f", STANDSTILL, 2e-6 * RNG.standard_normal(500), 1e-3, 0.02),
    stiffness=3e3,
    drift=1.5 / 3600,
    zero_std=NOISE / 800**0.5,
)
TRAVEL = np.full(400, HIGH)


def descent(depth=1e-3, speed=4e-3):
    """Heights (n,) [m] on the way down to a depth and back up to that of travel."""
    down = np.arange(HIGH, -depth, -speed * STEP)
    return np.concatenate([down, down[::-1]])


def press(stiffness, place=1.5):
    """The force [N] of a tip at a height [m] in a material whose force rises with a power, as stiff at 1 mm."""
    return lambda height, time: stiffness * 1e-3 * (1e3 * max(-height, 0.0)) ** place


def watch_motion(heights, force_of, sound=SOUND, sideways=0.0, zero_time=0.0):
    """Why the motion is stopped, its height [m] and force [N] then; None where it is not. And the touches."""
    rise = RiseWatch(sound)
    watch, rng = TouchWatch(sound, rise.contact, zero_time), np.random.default_rng(1)
    for k, height in enumerate(heights.tolist()):
        push = force_of(height, k * STEP)
        readings = push + NOISE * rng.standard_normal(2)
        place = (sideways * k * STEP, 0.0, height)
        rise.add(k * STEP, readings, -height, place)
        if (text := watch.fault(k * STEP, readings, -height, place, height >= 0.8 * HIGH)) is not None:
            return text, height, push, watch.slopes
    return None, None, None, watch.slopes


@pytest.mark.parametrize("stiffness", [10.0, 500.0, 2e3])
def test_sound_touches_of_what_is_softer_than_stated_go_on(stiffness):
    heights = np.concatenate([TRAVEL, descent(), TRAVEL, descent(2e-3), TRAVEL])
    assert watch_motion(heights, press(stiffness))[0] is None


@pytest.mark.parametrize("gap", [0.05, 0.1])
def test_a_sound_touch_whose_first_readings_are_missing_goes_on(gap):
    """The force is as stiff as stated, and a busy machine hands over a lump of readings from within the material."""
    heights = np.concatenate([TRAVEL, descent()])
    rise, rng, missed = RiseWatch(SOUND), np.random.default_rng(1), []
    watch = TouchWatch(SOUND, rise.contact, 0.0)
    touch_time = (len(TRAVEL) + HIGH / (4e-3 * STEP)) * STEP
    for k, height in enumerate(heights.tolist()):
        missed.append(press(2.9e3, 1.0)(height, k * STEP) + NOISE * rng.standard_normal(2))
        if touch_time - 0.01 < k * STEP < touch_time + gap:
            continue
        readings, place = np.concatenate(missed), (0.0, 0.0, height)
        missed.clear()
        assert rise.add(k * STEP, readings, -height, place) is None
        assert watch.fault(k * STEP, readings, -height, place, height >= 0.8 * HIGH) is None


@pytest.mark.parametrize(("stiffness", "most"), [(9e3, 2.0), (30e3, 2.0), (200e3, 8.0)])
def test_what_is_stiffer_than_stated_stops_long_before_the_force_that_stops(stiffness, most):
    text, height, force, _ = watch_motion(np.concatenate([TRAVEL, descent(3e-3)]), press(stiffness))
    assert "the stiffest material gives" in text
    assert "[safety] stiffness = 3 N/mm" in text
    assert height < 0.0
    assert force < most


def test_a_way_along_a_skin_that_rises_counts_as_depth():
    """The tip stays at its height, 0.5 mm deep, and the skin rises below it by 30 deg."""
    heights = np.concatenate([TRAVEL, descent(0.5e-3)[: len(descent(0.5e-3)) // 2], np.full(400, -0.5e-3)])
    began = (len(TRAVEL) + len(descent(0.5e-3)) // 2) * STEP
    rises = lambda height, time: press(2e3, 1.0)(height - max(time - began, 0.0) * 4e-3 * 0.5, time)  # noqa: E731
    assert watch_motion(heights, rises)[0] is not None  # the same force without the way
    assert watch_motion(heights, rises, sideways=4e-3)[0] is None


def pulled(start, pull):
    """A press of a soft material with a cable that pulls from a time [s] on, by so much [N]."""
    return lambda height, time: press(500.0)(height, time) + pull * (time >= start)


@pytest.mark.parametrize(
    ("force_of", "words"),
    [
        (pulled(0.5, -8.0), "before a contact was felt: is something pulling at the cable"),
        (pulled(0.5, 8.0), "the stiffest material gives"),
        (pulled(0.5, 0.1), "in free air, "),
        (lambda height, time: -press(2e3)(height, time), "count the other way round"),
        (lambda height, time: press(500.0)(height, time) - 0.1 * (time > 1.3 + 0.7), "in free air, "),
    ],
    ids=["cable", "push", "shift of 5 u", "sign", "after a touch"],
)
def test_what_is_no_force_of_the_material_stops_before_or_in_the_touch(force_of, words):
    heights = np.concatenate([TRAVEL, descent(), TRAVEL])
    assert words in watch_motion(heights, force_of)[0]


@pytest.mark.parametrize(("zero_time", "stops"), [(-2.0, False), (0.0, True)])
def test_a_stated_drift_counts_from_the_standstill(zero_time, stops):
    """The zero drifts for two seconds before the first reading that is judged."""
    rate = 0.15  # [N/s]
    drifting = lambda height, time: press(500.0)(height, time) + rate * (time + 2.0)  # noqa: E731
    sound = replace(SOUND, drift=1.01 * rate)
    assert (watch_motion(TRAVEL, drifting, sound, zero_time=zero_time)[0] is not None) == stops


@pytest.mark.parametrize(("rate", "stops"), [(1.5 / 3600, False), (15.0 / 3600, False), (0.02, True)])
def test_a_drift_that_is_stated_or_seen_from_touch_to_touch_is_no_shift(rate, stops):
    """Half a minute; that of 0.02 N/s passes half a newton."""
    heights = np.concatenate([np.concatenate([TRAVEL, descent()]) for _ in range(14)])
    drifting = lambda height, time: press(500.0)(height, time) + rate * time  # noqa: E731
    assert (watch_motion(heights, drifting)[0] is not None) == stops


@pytest.mark.parametrize("seconds", [0.3, 0.5])
def test_values_that_are_old_show_on_the_first_way_out(seconds):
    heights = np.concatenate([TRAVEL, descent(), TRAVEL])
    back = round(seconds / STEP)
    old = lambda height, time: press(500.0)(heights[max(round(time / STEP) - back, 0)], time)  # noqa: E731
    text, height, _, _ = watch_motion(heights, old)
    assert "too late" in text or "come late" in text
    assert height > -0.5e-3


def touches(lump=None, count=12, seed=3):
    """Touches of one map, whose stiffness scatters by 10 %; one of them is on a lump of so many times that."""
    rng = np.random.default_rng(seed)
    slopes = []
    for number in range(count):
        stiffness = 1e3 * (1.0 + 0.1 * rng.standard_normal()) * (lump if number == 4 and lump else 1.0)
        slopes += watch_motion(np.concatenate([TRAVEL, descent()]), press(stiffness))[3]
    return [replace(slope, place=(1e-3 * number, 0.0, 0.0)) for number, slope in enumerate(slopes)]


def test_a_touch_unlike_the_others_is_a_note_with_its_place():
    assert len(touches()) == 12
    assert touch_outlier_text(touches()) is None
    text = touch_outlier_text(touches(5.0))
    assert text.startswith("of 12 touches that at (4.0, 0.0) mm the force rises otherwise over its first 0.3 mm")
    assert touch_outlier_text(touches(5.0)[:7]) is None  # too few to know how they scatter


def test_one_percent_of_sound_maps_get_a_note():
    """Of 400 maps of 8 to 30 touches that scatter by 10 %."""
    rng, base = np.random.default_rng(5), touches(count=1)[0]
    found = 0
    for _ in range(400):
        scatter = 1.0 + 0.1 * rng.standard_normal((int(rng.integers(8, 31)), 2))
        found += (
            touch_outlier_text([replace(base, slope=base.slope * a, shape=base.shape * b) for a, b in scatter])
            is not None
        )
    assert found <= 12
