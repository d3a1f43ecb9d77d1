"""One residual, one null: right records of all rigs are good, and what is wrong is told with its cause."""

import sys
from pathlib import Path

import numpy as np
import pytest
from palpate import Samples
from palpate_kit.numerics.tip_travel import rate_kernels, zero_phase_motion
from palpate_uncertainty import residual_null
from palpate_uncertainty.force_noise import ForceNoise, upper_band
from palpate_uncertainty.residual_null import ResidualNull

RIGS = (
    "afm",
    "beam",
    "texture",
    "cone",
    "instron",
    "press",
    "robot-speed",
    "robot",
    "robot-ramp",
    "ros-125",
    "ros-500",
    "dma",
    "low-pass",
    "rounded",  # in steps of three times the noise
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
            name = "cut" if wrong and wrong.place == "cut" else "record"
            path = files.write(tmp_path_factory.mktemp("record") / name, specimen.rig, found, random)
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
def test_a_material_with_memory_under_a_small_tip_has_the_discrepancy_of_a_large_one(judged):
    """Values of 1e4 Pa beside a surface of 1e-7 m: the shifts of one are no rounding of the other."""
    found, specimen = judged("afm", "a power law", 50)
    assert 0.005 < found["elasticity"]["combined"] / specimen.elasticity < 0.05
    assert "can move elasticity" in found["words"]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [5, 6])
def test_a_force_that_is_held_for_five_rows_has_no_spikes(judged, seed):
    """It may be late: each reading stands for four rows after it."""
    found, _ = judged("held", seed=seed)
    assert not {"outliers", "lack-of-fit"} & {*found["findings"]}


@pytest.mark.slow
@pytest.mark.parametrize("rig", ["press", "texture"])
def test_single_readings_are_found_beside_a_steep_ramp(judged, rig):
    found, _ = judged(rig, "single readings off", 50)
    assert "outliers" in found["findings"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rig", "kind", "cause"),
    [
        ("press", "another exponent", "tip"),
        ("robot", "relaxing in 0.3 s", "memory"),
        ("texture", "weaker on the way back", "unloading that is softer"),
        ("robot", "a cable", "cable"),
        ("robot-ramp", "friction in a guide", "friction"),
        ("press", "the zero drifts", "drift"),  # by less than the drift that a sensor may have: the air shows it
        ("robot", "the log is the command", "command"),
        ("texture", "drying", "stiffness that changes"),
        ("robot-speed", "another mass", "mass"),
        ("robot", "the zero drifts", "drift"),
        ("robot", "a base that gives", "a mount that gives way"),
    ],
)
def test_what_is_wrong_by_twelve_standard_deviations_is_told_with_its_cause(judged, rig, kind, cause):
    found, _ = judged(rig, kind, 12)
    assert {"lack-of-fit", "model-discrepancy"} & {*found["findings"], *found["immaterial"]}
    assert cause in found["words"]


@pytest.mark.slow
def test_a_force_that_was_zeroed_in_contact_has_its_zero_as_an_unknown(judged):
    """Without air before it."""
    found, specimen = judged("texture", "zeroed in contact", 12)
    assert abs(found["elasticity"]["value"] - specimen.elasticity) < 2 * found["elasticity"]["combined"]


@pytest.mark.parametrize("n", [200, 600, 4000])
def test_a_flat_upper_band_tells_the_noise_and_a_filtered_one_does_not(n):
    found, filtered = [], []
    for seed in range(50):
        random = np.random.default_rng(seed)
        left, noise = np.linspace(0.0, 0.05, n), 0.02 * random.standard_normal(n)
        found.append(upper_band(left + noise, noise))
        filtered.append(upper_band(left + np.convolve(noise, np.full(9, 1 / 9), "same"), noise))
        held = np.repeat((left + noise)[::5], 5)
        assert upper_band(held, held) is None
        assert upper_band(left + noise, np.round(noise, 1)) is None  # in steps of five times the noise
    assert filtered == [None] * 50
    told = [noise.std for noise in found if noise is not None]
    assert len(told) >= 44
    assert np.median(told) == pytest.approx(0.02, rel=0.25 if n < 4000 else 0.1)
    assert min(told) > 0.017  # hardly ever below what it is


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


@pytest.mark.parametrize("coefficients", [(), (0.8,)], ids=["white", "coloured"])
@pytest.mark.parametrize("channel", [False, True], ids=["heights", "heights-and-speeds"])
def test_the_motion_noise_of_a_long_record_is_summed_over_blocks(monkeypatch, channel, coefficients):
    """Sums over patterns of a motion of 2 Hz that begins at once, and over bins of its speed, of 30 s at 500 Hz."""
    step, n = 2e-3, 15_000
    phase = 2.0 * np.pi * 2.0 * step * np.arange(n)
    kernels = rate_kernels((5e-6, 0.67e-3 if channel else 1e-3), 9e-3, step, channel)
    force = ForceNoise(1e-4, np.array(coefficients), 1000)
    null = ResidualNull(
        force, 1.8e4 * np.sqrt(4.0 + np.sin(phase)), np.full(n, 30.0), 0.14, 5e-6, 0.67e-3 * channel, kernels
    )
    bins = [(np.cos(phase) > low) & (np.cos(phase) <= low + 0.2) for low in (-1.0, -0.5, 0.0, 0.5)]
    patterns = [np.sin(phase), np.sign(np.cos(phase)), np.sin(3.0 * phase), np.linspace(-1.0, 1.0, n), *bins]
    weights = np.column_stack(patterns) - np.mean(patterns, axis=1)
    lengths = []
    convolve = residual_null._back

    def counted(columns, kernel):
        lengths.append(columns.shape[1])
        return convolve(columns, kernel)

    monkeypatch.setattr(residual_null, "_back", counted)
    in_blocks = null.covariance(weights)
    assert max(lengths) <= n // 5
    monkeypatch.setattr(residual_null, "LONG", n + 1)
    of_samples = null.covariance(weights)
    # In every combination of the sums, and not of each alone.
    powers = np.linalg.eigvals(np.linalg.solve(of_samples, in_blocks)).real
    assert powers.min() > 0.97
    assert powers.max() < 1.03
