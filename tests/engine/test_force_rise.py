"""A force that does not rise on the way in: the detector alone, on readings."""

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from palpate_engine import RiseWatch, SoundForce

RATE, STEP = 800.0, 1 / 400  # [Hz], [s] between two looks, two readings each
RNG = np.random.default_rng(0)
SOUND = SoundForce.of("f", 0.02 * RNG.standard_normal(800), 2e-6 * RNG.standard_normal(500), 0.2e-3, 0.0)


@pytest.fixture(scope="module")
def rigs():
    """``benchmarks/force_rise.py``."""
    path = Path(__file__).parents[2] / "benchmarks" / "force_rise.py"
    spec = importlib.util.spec_from_file_location("force_rise_rigs", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["force_rise_rigs"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["force_rise_rigs"]


def fed(ways, force_of, sound=SOUND, sideways=None, noise=0.02):
    """What stops a tip on its ways (n,) [m] inwards, one each 2.5 ms, and at which; contact begins at 0."""
    watch, rng = RiseWatch(sound), np.random.default_rng(1)
    for k, way in enumerate(ways):
        readings = force_of(way) + noise * rng.standard_normal(2)
        place = (0.0 if sideways is None else float(sideways[k]), 0.0, -way)
        if (text := watch.add(k * STEP, readings, way + 2e-6 * rng.standard_normal(), place)) is not None:
            return text, way
    return None, None


def linear(level=np.inf):
    """1 N/mm, up to a level [N]: the least rise that a contact law gives."""
    return lambda way: min(1e3 * max(way, 0.0), level)


STEADY = np.arange(-1e-3, 6e-3, 4e-3 * STEP)  # 4 mm/s


def test_windows_are_those_that_the_pose_can_tell():
    position = np.random.default_rng(2).standard_normal(500)
    force = 0.02 * np.random.default_rng(2).standard_normal(800)
    assert SoundForce.of("f", force, 5e-6 * position, 0.2e-3, 0.0).windows == (0.2e-3, 1e-3)
    assert SoundForce.of("f", force, 50e-6 * position, 0.2e-3, 0.0).windows == (1e-3,)
    assert SoundForce.of("f", force, 500e-6 * position, 0.2e-3, 0.0).windows == ()
    assert SoundForce.of("f", force, 5e-6 * position, 3e-3, 0.0).windows == (1e-3,)


def test_noise_that_hangs_together_counts_as_that():
    white = np.random.default_rng(3).standard_normal(8000)
    filtered = np.convolve(white, np.full(8, 1 / 8), "same")
    of = lambda force: SoundForce.of("f", force, np.zeros(9), 1e-3, 0.0).correlation  # noqa: E731
    assert of(white) == pytest.approx(1.0, abs=0.4)
    assert of(filtered) == pytest.approx(8.0, rel=0.4)


@pytest.mark.parametrize(("noise", "most"), [(0.005, 0.3e-3), (0.02, 0.3e-3), (0.05, 1.1e-3)])
def test_a_sensor_that_saturates_with_noise_on_top_is_seen_within_its_window(noise, most):
    """Of 0.2 mm, where that tells it from noise, else of 1 mm."""
    sound = replace(SOUND, std=noise, roughness=noise * 6**0.5)
    assert fed(STEADY, linear(), sound, noise=noise) == (None, None)
    text, way = fed(STEADY, linear(3.0), sound, noise=noise)
    assert "while the tip goes" in text
    assert 3e-3 < way < 3e-3 + most


def test_a_law_that_rises_less_than_linearly_is_no_contact():
    assert fed(STEADY, lambda way: 2.0 * (way > 0) + 0.1 * 1e3 * max(way, 0.0))[0] is not None


@pytest.mark.parametrize(
    ("ways", "sideways"),
    [
        (np.concatenate([np.arange(-1e-3, 2e-3, 1e-5), np.arange(2e-3, 0.5e-3, -1e-5)]), None),  # out again
        (np.concatenate([np.arange(-1e-3, 2e-3, 1e-5), np.full(800, 2e-3)]), None),  # stands
        (
            np.concatenate([np.arange(-1e-3, 2e-3, 1e-5), 2e-3 + np.arange(300) * 1e-6]),
            np.concatenate([np.zeros(300), np.arange(300) * 2e-5]),
        ),  # along the skin, a little deeper
    ],
)
def test_what_goes_out_or_stands_or_goes_sideways_is_not_judged(ways, sideways):
    assert fed(ways, linear(2.0), sideways=sideways)[0] is None


def test_a_tip_that_slows_down_is_not_judged_for_a_part_of_the_force_goes_with_speed():
    """At 1 N/mm and 0.4 N for 4 mm/s, with a stop from full speed within 0.4 mm."""
    time = np.arange(0.0, 1.2, STEP)
    speed = np.interp(time, [0.0, 0.6, 0.8], [4e-3, 4e-3, 0.0])
    ways = np.cumsum(speed) * STEP - 1e-3
    rate = dict(zip(ways.tolist(), speed.tolist(), strict=True))
    assert fed(ways, lambda way: linear()(way) + 100.0 * rate[float(way)] * (way > 0))[0] is None


@pytest.mark.parametrize(("level", "seen"), [(2.0, False), (1.0, True)])
def test_a_law_that_holds_a_force_is_not_judged_at_it_but_below_it(level, seen):
    creeping = np.concatenate([np.arange(-1e-3, 1e-3, 1e-5), np.arange(1e-3, 3e-3, 2e-6)])
    found = fed(creeping, linear(level), replace(SOUND, set_force=2.0))[0]
    assert (found is not None) == seen


@pytest.mark.parametrize(("noise", "seen"), [(0.02, False), (0.01, False), (0.002, True)])
def test_noise_in_contact_far_below_that_at_standstill_is_the_same_stop(noise, seen):
    ways = np.concatenate([np.arange(-1e-3, 1e-3, 1e-5), np.full(400, 1e-3)])
    text, _ = fed(ways, linear(), noise=noise)
    assert (text is not None) == seen
    assert text is None or "the noise of f in contact is" in text


def test_coarse_readings_may_be_as_quiet_as_they_like():
    force = np.rint(0.01 * np.random.default_rng(4).standard_normal(800) / 0.05) * 0.05
    assert SoundForce.of("f", force, np.zeros(9), 1e-3, 0.0).roughness == 0.0


def test_some_sound_rigs_are_not_stopped(rigs):
    assert [seed for seed in range(6) if rigs.stopped(rigs.drawn(seed))] == []


@pytest.mark.slow
def test_of_a_thousand_sound_rigs_one_is_stopped_at_most(rigs):
    """40 CPU s: the rate of false stops is the figure that this detector stands or falls with."""
    stopped = [(seed, text) for seed in range(1000) if (text := rigs.stopped(rigs.drawn(seed))) is not None]
    assert len(stopped) <= 1, stopped
