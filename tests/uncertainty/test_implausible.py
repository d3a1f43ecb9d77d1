"""Values that no soft material has are told, and so is a depth at which a paraboloid is no sphere."""

import numpy as np
import palpate
import pytest
from palpate_models import ExactSphere, Sphere


def pressed(times=1.0, radius=5e-3, deepest=5e-3):
    """A press of a sphere; heights are wrong by a factor."""
    time = np.arange(0.0, 4.0, 0.002)
    phase = 2 * np.pi * time
    depth, rate = deepest * (0.6 - 0.4 * np.cos(phase)), deepest * 0.8 * np.pi * np.sin(phase)
    force = np.sqrt(radius) * (16 / 9 * 112e3 * depth**1.5 + 8 * 362 * depth**0.5 * rate)
    force += np.random.default_rng(1).normal(0.0, 0.02, len(time))
    return palpate.record(
        time=time, force=force, height=-depth * times, velocity=-rate * times, timing="0.3 ms", tip_mass=0, tare="0 N"
    )


@pytest.mark.slow
@pytest.mark.parametrize(("times", "flagged"), [(1e3, True), (1.0, False), (1e-3, True)])
def test_millimetres_as_metres_and_metres_as_millimetres(times, flagged):
    """3.5 Pa and 3.5 GPa where 112 kPa is true."""
    fit = palpate.fit(pressed(times), tip=Sphere(radius="5 mm"), model="dr")
    assert ("implausible" in {flag.code for flag in fit.flags}) == flagged


@pytest.mark.slow
@pytest.mark.parametrize(("tip", "flagged"), [(Sphere, True), (ExactSphere, False)])
def test_a_paraboloid_far_beyond_its_radius(tip, flagged):
    fit = palpate.fit(pressed(radius=2e-3), tip=tip(radius="2 mm"), model="dr")
    assert ("beyond-model-range" in {flag.code for flag in fit.flags}) == flagged


@pytest.mark.slow
def test_innovations_as_large_as_they_should_be_are_not_flagged(run_point):
    tracks = run_point("trajectory.press.duration=4 s", 'run.tracks=["*/kinematic"]').tracks
    assert "inconsistent" not in {flag.code for flag in tracks["dr/kinematic"].flags}


@pytest.mark.parametrize(("viscosity", "told"), [(-629471.0, True), (-3.0, False), (5.0, False)])
def test_a_viscosity_below_nothing_by_more_than_its_std_is_no_value(viscosity, told):
    """-3 +- 20 Pa s is none at all, as far as is known; -629471 +- 20 is no material."""
    from types import SimpleNamespace

    from palpate.registry import load
    from palpate_models import Maxwell
    from palpate_uncertainty.plausibility import _bound_flags

    last = SimpleNamespace(values=np.array([[1e5, viscosity]]), std=np.array([[1e3, 20.0]]))
    flags = load().judged(_bound_flags(last, Maxwell(indenter=Sphere(radius="5 mm")), set()))
    assert [(flag.code, flag.severity) for flag in flags] == ([("implausible", "doubtful")] if told else [])
