"""A rich motion tells the delay of the force: records of three laws, written out by hand, against what is found."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from palpate_filters import CasadiFit
from palpate_uncertainty.self_timed import is_rich, self_timed

spec = importlib.util.spec_from_file_location("palpations", Path(__file__).with_name("palpations.py"))
palpations = importlib.util.module_from_spec(spec)
spec.loader.exec_module(palpations)
ETA, MULTI, SINE, branch, evidence = (
    getattr(palpations, name) for name in ("ETA", "MULTI", "SINE", "branch", "evidence")
)


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
    assert not found.settles  # that nobody has declared the timing stays said
    assert "one-branch" in found.flags[0].message
    branches = found.table["laws"]["one-branch"]
    assert branches["delay"] == pytest.approx(1e-3, abs=3 * branches["std"])


def test_a_single_sine_and_declared_timing_are_left_alone():
    assert not is_rich(evidence(SINE, 0.0, 8))
    assert not is_rich(evidence(MULTI, 0.0, 8, declared="0.1 ms"))
