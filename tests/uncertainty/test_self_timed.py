"""A rich motion tells the delay of the force: records of three laws, written out by hand, against what is found."""

import numpy as np
import pytest
from palpate import Ending, Problem, Samples, TrackEvidence
from palpate.alignment import AlignmentReport, AlignmentSettings
from palpate.alignment.tare import Tare
from palpate.result.record import TrackRecord
from palpate_filters import CasadiFit, KinematicFilter
from palpate_models import DimensionalityReduction, Sphere
from palpate_uncertainty.self_timed import is_rich, self_timed

E, ETA, RADIUS, MASS, RATE = 112.5e3, 362.0, 5e-3, 0.14, 500.0
MODEL = DimensionalityReduction(indenter=Sphere(radius=RADIUS))
MULTI = ((0.5, 0.5e-3, 0.0), (2.0, 0.3e-3, 1.0), (5.0, 0.15e-3, 2.0))  # [Hz], [m], [rad]
SINE = ((2.0, 0.8e-3, 0.5),)


def motion(lines, time):
    depth, rate, bend = np.full(len(time), 4e-3), np.zeros(len(time)), np.zeros(len(time))
    for frequency, amplitude, phase in lines:
        omega = 2 * np.pi * frequency
        depth += amplitude * np.sin(omega * time + phase)
        rate += amplitude * omega * np.cos(omega * time + phase)
        bend -= amplitude * omega**2 * np.sin(omega * time + phase)
    return depth, rate, bend


def kelvin_voigt(lines, time):
    """16/9 E R^0.5 d^1.5 + 8 eta (R d)^0.5 d' + m d''."""
    depth, rate, bend = motion(lines, time)
    return 16 / 9 * E * RADIUS**0.5 * depth**1.5 + 8 * ETA * (RADIUS * depth) ** 0.5 * rate + MASS * bend


def branch(lines, time, share=0.6, fades=0.05):
    """The same with a Maxwell arm in place of the dashpot, from 5 s before on; its rate equation in steps of 0.2 ms."""
    fine = np.arange(time[0] - 2.0, time[-1] + 1e-3, 2e-4)
    depth, _, bend = motion(lines, fine)
    elastic = 16 / 9 * E * RADIUS**0.5 * depth**1.5
    arm, keep = np.zeros(len(fine)), np.exp(-2e-4 / fades)
    for i, step in enumerate(np.diff(elastic).tolist()):
        arm[i + 1] = keep * (arm[i] + share * step)
    return np.interp(time, fine, elastic + arm + MASS * bend)


def evidence(lines, late, seed, law=kelvin_voigt, estimator=None, declared=None):
    random, time = np.random.default_rng(seed), np.arange(5000) / RATE
    n, always = len(time), np.ones(len(time), bool)
    depth, rate, _ = motion(lines, time)
    noise = random.standard_normal((3, n))
    samples = Samples(
        np.rint(time * 1e9).astype(np.int64), time, np.diff(time, prepend=0.0),
        law(lines, time - late) + 0.05 * noise[0], -depth + 5e-6 * noise[1], -rate + 0.67e-3 * noise[2], always, always,
    )  # fmt: skip
    estimator = estimator or KinematicFilter()
    record = TrackRecord(3.0 if estimator.online else np.inf)
    record.add(samples, estimator.start(Problem(MODEL, MASS)).run(samples), 0.0)
    tail, last = record.ends(1.0 if estimator.online else np.inf)
    force = {"channel": "rig.f"} | ({"uncertainty": declared} if declared else {})
    settings = AlignmentSettings.model_validate({"force": force, "position": "rig.z", "tip_mass": MASS})
    report = AlignmentReport({}, Tare(0.0, 2e-3, 0.05, 1.0), 0.25, (0.0, 0.0), 1, None, n, 0, 0, time[-1], None, True)
    included = frozenset(["timing"] if record.timing_included else [])
    ending = Ending(tail, last, settings, report, {}, frozenset(), included, 1.0, 10.0, n, False)
    values, std = last.values.mean(axis=0), last.std[-1]
    kept, air = record.keeper.kept, record.keeper.air
    return TrackEvidence("t", MODEL, estimator, MASS, kept, *air, values, std, std, 0.0, None, {}, ending)


@pytest.mark.parametrize("late", [0.0, 3e-3])
def test_a_multi_sine_tells_the_delay_and_the_viscosity_without_it(late):
    """The bound of Cramer and Rao for this motion, surface and both parameters unknown, is 0.535 ms."""
    found = [self_timed([evidence(MULTI, late, seed)])["t"] for seed in (3, 4)]
    for one in found:
        assert one.table["law"] == "kelvin-voigt"
        assert one.table["delay"] == pytest.approx(late, abs=2 * one.table["delay_std"])
        assert one.table["laws"]["kelvin-voigt"]["std"] < 1.2 * 0.535e-3
        assert [flag.code for flag in one.flags] == ["self-timed"]
        assert "kelvin-voigt" in one.flags[0].message  # never a delay without its law


def test_the_viscosity_without_the_delay_is_that_of_the_material():
    track = evidence(MULTI, 3e-3, 5)
    bias = self_timed([track])["t"].biases["viscosity"]
    assert bias.shift < -80.0  # 3 ms hide 0.3 of 362 Pa s
    assert track.values[1] - bias.shift == pytest.approx(ETA, abs=2 * np.hypot(track.std[1], bias.std))


def test_a_fit_that_looks_for_the_delay_gets_the_spread_of_the_laws():
    track = evidence(MULTI, 3e-3, 6, estimator=CasadiFit(unknowns=("delay",), profile=False))
    found = self_timed([track])["t"]
    assert not found.biases
    assert found.table["delay"] == pytest.approx(3e-3, abs=2 * found.table["delay_std"])


def test_another_law_is_said_to_be_one_and_covers_the_delay():
    found = self_timed([evidence(MULTI, 1e-3, 7, law=branch)])["t"]
    assert [flag.code for flag in found.flags] == ["delay-by-law"]
    assert "one-branch" in found.flags[0].message
    branches = found.table["laws"]["one-branch"]
    assert branches["delay"] == pytest.approx(1e-3, abs=3 * branches["std"])


def test_a_single_sine_and_declared_timing_are_left_alone():
    assert not is_rich(evidence(SINE, 0.0, 8))
    assert not is_rich(evidence(MULTI, 0.0, 8, declared="0.1 ms"))
