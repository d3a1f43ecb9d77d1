"""Records without air: the zero of the force and the height of the surface are two unknowns."""

import json

import numpy as np
import pytest
from palpate import Problem, Samples
from palpate_engine import AlignmentSettings
from palpate_fits import CasadiFit
from palpate_models import DimensionalityReduction, Paraboloid

HERTZ = 16 / 9  # F = 16/9 E sqrt(R) d^1.5 of a paraboloid, nu 0.5


def touch_depth(force, elasticity, radius):
    """Depth [m] at which a paraboloid feels a force [N]."""
    return (force / (HERTZ * elasticity * np.sqrt(radius))) ** (2 / 3)


def at_a_trigger(seed, elasticity=50e3, radius=3e-3, trigger=0.1, noise=2e-3):
    """Time [s], way [m] and force [N] from a trigger on, at which both were zeroed; 1 mm/s, 100 Hz."""
    time = np.arange(127) / 100
    depth = touch_depth(trigger, elasticity, radius) + 1e-3 * time
    force = HERTZ * elasticity * np.sqrt(radius) * depth**1.5 - trigger
    return time, 1e-3 * time, force + noise * np.random.default_rng(seed).standard_normal(127)


def in_contact(seed, elasticity=500e3, radius=5e-3, begin=1.454e-3, noise=34e-3):
    """The same of a ramp of 2 mm/s and a hold, zeroed 1.5 mm deep; 125 Hz."""
    time = np.arange(218) / 125
    way = np.minimum(2e-3 * time, 1.496e-3)
    force = HERTZ * elasticity * np.sqrt(radius) * ((begin + way) ** 1.5 - begin**1.5)
    return time, way, force + noise * np.random.default_rng(seed).standard_normal(218)


def samples_of(time, way, force, touch):
    """Samples whose contact was detected at a row."""
    stamp = np.rint(1e9 * time).astype(np.int64)
    contact = np.arange(len(time)) >= touch
    interval = np.concatenate([[0.0], np.diff(time)])
    return Samples(stamp, time, interval, force, -way, -np.gradient(way, time), contact, contact)


def fit_of(samples, radius, zero):
    model = DimensionalityReduction(indenter=Paraboloid(curvature_radius=radius))
    return CasadiFit(profile=False).start(Problem(model, 0.0, force_zero=zero)).run(samples)


@pytest.mark.parametrize(("record", "radius", "truth"), [(at_a_trigger, 3e-3, 50e3), (in_contact, 5e-3, 500e3)])
def test_the_zero_of_the_force_is_found_with_the_surface(record, radius, truth):
    found = fit_of(samples_of(*record(1), touch=40), radius, "open").details["unknowns"]
    elasticity = found["elasticity"]
    assert found["bias"]["free"]
    assert abs(elasticity["value"] - truth) < 2 * np.hypot(elasticity["std"], 0.005 * truth)


def test_a_zero_that_is_stated_stays():
    found = fit_of(samples_of(*at_a_trigger(1), touch=40), 3e-3, "stated").details["unknowns"]
    assert not found["bias"]["free"]


@pytest.mark.parametrize("zero", ["open", "stated", "air"])
def test_nothing_moves_where_there_is_air(zero):
    """0.3 s of air before a press: the same bits whatever is stated of the zero."""
    time = np.arange(400) / 100
    way = 0.5e-3 * (time - 0.3)
    force = HERTZ * 50e3 * np.sqrt(3e-3) * np.maximum(way, 0.0) ** 1.5
    samples = samples_of(time, way, force + 2e-3 * np.random.default_rng(3).standard_normal(400), touch=45)
    found, usual = fit_of(samples, 3e-3, zero), fit_of(samples, 3e-3, "air")
    assert np.array_equal(found.values, usual.values, equal_nan=True)
    assert not found.details["unknowns"]["bias"]["free"]


@pytest.mark.slow
@pytest.mark.parametrize(("record", "tip", "truth"), [(at_a_trigger, 3, 50e3), (in_contact, 5, 500e3)])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_file_that_was_zeroed_in_contact_has_the_right_value_and_says_where_the_zero_is(
    palpate, tmp_path, record, tip, truth, seed
):
    """They were 56.9 +- 2.2 kPa for 50, and 756 +- 63 for 500."""
    time, way, force = record(seed)
    rows, head = np.column_stack([time, 1e3 * way, force]), "Time (s),Extension (mm),Force (N)"
    np.savetxt(tmp_path / "curve.csv", rows, delimiter=",", header=head, comments="", fmt="%.5f")
    done = palpate("fit", "curve.csv", "--tip", f"paraboloid {tip} mm", "--out", "out")
    assert "not determined" in done.stdout  # the viscosity
    done = palpate("fit", "curve.csv", "--pipeline", "out/pipeline.toml", "--json", "--out", "one")
    track = next(iter(json.loads(done.stdout)["logs"]["curve"]["tracks"].values()))
    value = track["parameters"]["elasticity"]
    assert value["verdict"] == "good"
    assert abs(value["value"] - truth) < 2 * value["combined"]
    assert track["parameters"]["viscosity"]["verdict"] == "not determined"
    if record is at_a_trigger:  # the other's zero is known to what does not matter
        # A condition is left out where twice its uncertainty, which is part of that of the fit, moves E by less than u.
        messages = {condition["fact"]: condition["message"] for condition in track["conditions"]}
        assert "found with the surface" in messages.get("tare", "") or 2 * value["std"] < value["combined"]


@pytest.mark.parametrize(
    ("zero", "source"),
    [
        ({"tare": "free-air"}, "air"),
        ({"tare": "none"}, "open"),
        ({"tare": "none", "tare_uncertainty": "50 mN"}, "stated"),  # zeroed before the record begins
        ({"tare": "0 N"}, "stated"),
    ],
)
def test_a_zero_is_stated_by_its_value_or_by_its_uncertainty(zero, source):
    assert AlignmentSettings(force="log.f", position="log.z", **zero).force_zero == source
