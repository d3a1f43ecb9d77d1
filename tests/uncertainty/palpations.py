"""Palpations written out by hand, and what a diagnosis is given of them."""

import numpy as np
from palpate import Problem, Samples, TrackEnd, TrackEvidence
from palpate.alignment_report import Tare
from palpate_engine.alignment import AlignmentReport, AlignmentSettings
from palpate_engine.result.track_record import TrackRecord
from palpate_filters import KinematicFilter
from palpate_models import DimensionalityReduction, Sphere

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
    ending = TrackEnd(tail, last, settings, report, {}, frozenset(), included, 1.0, 10.0, n, False)
    values, std = last.values.mean(axis=0), last.std[-1]
    kept, air = record.keeper.kept, record.keeper.air
    return TrackEvidence("t", MODEL, estimator, MASS, kept, *air, values, std, std, 0.0, None, {}, ending)
