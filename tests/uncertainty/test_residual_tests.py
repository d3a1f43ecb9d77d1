"""One residual, one null: right records of all rigs are good, and what is wrong is told with its cause."""

import sys
from pathlib import Path

import numpy as np
import pytest
from palpate import Samples
from palpate_kit.numerics.tip_travel import rate_kernels, zero_phase_motion
from palpate_uncertainty.residual_null import ForceNoise, ResidualNull

RIGS = (
    "afm",
    "texture",
    "cone",
    "instron",
    "press",
    "robot-speed",
    "robot",
    "robot-ramp",
    "ros-500",
    "dma",
    "hum",
)


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    """What is said of a record of the benchmark: right, or wrong by so many standard deviations."""
    sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
    try:
        from verdict_records import files, judgement, sizes, wrongs

        kinds = {kind.name: kind for kind in wrongs.WRONGS}

        def judge(rig, kind="", sigma=0, stated=True, seed=5):
            random = files.random_of(seed, rig, kind)
            specimen = files.drawn(rig, random)
            wrong = kinds.get(kind)
            size = sizes.size_of(specimen, wrong, sigma) if wrong else 0.0
            found = sizes.readings(specimen, wrong, size)
            path = files.write(tmp_path_factory.mktemp("record") / "record", specimen.rig, found, random)
            return judgement.judged(path, specimen.rig, stated), specimen

        yield judge
    finally:
        sys.path.pop(0)


@pytest.mark.slow
@pytest.mark.parametrize("rig", RIGS)
def test_a_right_record_with_everything_stated_is_good(judged, rig):
    found, specimen = judged(rig)
    assert found["verdict"] == "good"
    assert not found["findings"]
    assert abs(found["elasticity"]["value"] - specimen.elasticity) < 2 * found["elasticity"]["combined"]
    assert found["elasticity"]["combined"] < 0.03 * specimen.elasticity


@pytest.mark.slow
@pytest.mark.parametrize("rig", ["texture", "robot", "robot-ramp", "dma", "press"])
def test_with_nothing_stated_elasticity_is_good_and_viscosity_needs_the_delay(judged, rig):
    found, _ = judged(rig, stated=False)
    assert found["verdict"] == "good"
    assert not found["findings"]
    assert found["viscosity"]["verdict"] in ("needs delay", "not determined")
    assert {"thickness", "delay"} <= set(found["conditions"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rig", "kind", "cause"),
    [
        ("press", "another exponent", "tip"),
        ("robot", "relaxing in 0.3 s", "memory"),
        ("texture", "weaker on the way back", "surface moved"),
        ("robot-speed", "another mass", "mass"),
        ("robot", "the zero drifts", "drift"),
        ("robot", "a base that gives", "compliance"),
    ],
)
def test_what_is_wrong_by_twelve_standard_deviations_is_told_with_its_cause(judged, rig, kind, cause):
    found, _ = judged(rig, kind, 12)
    assert "lack-of-fit" in (*found["findings"], *found["immaterial"])
    assert cause in found["words"]


@pytest.mark.parametrize("width", [0, 9])
def test_the_kernels_are_what_a_fit_makes_of_noise(width):
    """The rate and acceleration of a motion of noise alone, by its kernels."""
    random, step, n = np.random.default_rng(3), 2e-3, 4000
    time = np.arange(n) * step
    noise = 1e-6 * random.standard_normal(n)
    height = -1e-3 * np.sin(4 * np.pi * time) + noise
    velocity = np.gradient(height, step)
    stamp = np.round(time * 1e9).astype(np.int64)
    whole = np.ones(n, bool)
    samples = Samples(stamp, time, np.diff(time, prepend=-step), 0 * time, height, velocity, whole, whole)
    motion = zero_phase_motion(samples, None)
    clean = -np.gradient(height - noise, step)
    speed = float(np.sqrt(np.mean(velocity**2)))
    by_height, by_speed, bend, _ = rate_kernels(
        (1e-6, float(np.std(velocity - np.gradient(height - noise, step)))), speed, step, False
    )
    assert not by_speed.any()
    left = (motion.rate - clean)[100:-100]
    assert np.std(left) == pytest.approx(1e-6 * np.linalg.norm(by_height), rel=0.15)
    assert len(bend) > len(by_height)


def test_the_variance_of_a_weighted_sum_is_that_of_many_draws():
    """Coloured noise of the force, and noise of the height by slope and rate."""
    random, n = np.random.default_rng(4), 256
    kernel = np.array([0.5, 0.0, -0.5])
    weights = np.sin(np.arange(n) / 7.0) / n
    by_depth, by_rate = np.full(n, 3.0), np.linspace(1.0, 2.0, n)
    nothing = np.zeros(1)
    null = ResidualNull(
        ForceNoise(0.5, np.array([0.8]), 1000), by_depth, by_rate, 0.0, 0.1, 0.0, (kernel, nothing, nothing, nothing)
    )
    draws = 4000
    white = random.standard_normal((draws, n + 200)) * 0.5 * np.sqrt(1 - 0.8**2)
    force = np.zeros_like(white)
    for i in range(1, n + 200):
        force[:, i] = 0.8 * force[:, i - 1] + white[:, i]
    height = 0.1 * random.standard_normal((draws, n))
    rate = np.array([np.convolve(row, kernel, "same") for row in height])
    sums = (force[:, 200:] + by_depth * height + by_rate * rate) @ weights
    assert float(null.covariance(weights[:, None])[0, 0]) == pytest.approx(float(np.var(sums)), rel=0.1)
