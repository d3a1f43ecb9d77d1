"""Arms that may change places come out from the fastest, whichever the fit found first."""

import numpy as np
import pytest
from palpate import Problem
from palpate_fits import CasadiFit
from palpate_fits.arm_order import in_order, places_in_order
from palpate_fits.residual import Residual
from palpate_fits.solvers import Solution
from palpate_fits.unknowns import unknowns_of
from palpate_models import Burgers, GeneralisedMaxwell2, GeneralisedMaxwell3, Sphere

TIP = Sphere(radius=5e-3)
THREE = GeneralisedMaxwell3(indenter=TIP)


def solution(model, values):
    """A minimum at parameter values, all else 0."""
    return Solution(np.array([*values, 0.0, 0.0, 0.0, 0.0, 0.0]), 1.0, 1, True)


def test_arms_are_ordered_by_their_times_with_their_strengths():
    found = in_order(THREE, unknowns_of(THREE, (), {}, {}, {}), solution(THREE, (9.0, 1.0, 30.0, 2.0, 0.1, 3.0, 5.0)))
    assert found.x[:7].tolist() == [9.0, 2.0, 0.1, 3.0, 5.0, 1.0, 30.0]
    assert places_in_order(Burgers(indenter=TIP), np.array([4.0, 3.0, 2.0, 1.0])) == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("fixed", "bounds", "guesses"),
    [
        ({"arm_time_1": "30 s"}, {}, {}),
        ({}, {"arm_time_1": ("1 s", "100 s")}, {}),
        ({}, {}, {"arm_elasticity_2": "5 kPa"}),
    ],
)
def test_what_a_user_names_keeps_its_place(fixed, bounds, guesses):
    values = (9.0, 1.0, 30.0, 2.0, 0.1, 3.0, 5.0)
    found = in_order(THREE, unknowns_of(THREE, (), fixed, guesses, bounds), solution(THREE, values))
    assert found.x[:7].tolist() == list(values)


def test_places_do_not_change_the_force():
    """The order is a name only: the residual of a record is the same to rounding."""
    from palpate_fits.record_arrays import make_record

    time = np.arange(0, 1.0, 2e-3)
    depth = 2e-3 * np.minimum(time / 0.3, 1.0)
    columns = (-depth, np.gradient(depth, time), 0 * time, 0 * time, time, np.ones(len(time)))
    model = GeneralisedMaxwell2(indenter=TIP)
    record, residual = make_record(columns, 2e-3), Residual(model, tuple(range(6)))
    one = solution(model, (1e5, 2e4, 3.0, 4e4, 0.1)).x
    other = in_order(model, unknowns_of(model, (), {}, {}, {}), solution(model, one[:5])).x
    assert other[2] == 0.1
    forces = [np.concatenate([v[:, 0] for _, v in residual.blocks(record, x)]) for x in (one, other)]
    assert forces[0] == pytest.approx(forces[1], rel=1e-10)


@pytest.mark.slow
def test_a_fit_tells_the_fast_arm_first(hold_record):
    model, samples = hold_record
    found = CasadiFit(profile=False, segment="contact").start(Problem(model, 0.0)).run(samples)
    values = found.values[np.flatnonzero(np.isfinite(found.values).all(axis=1))[0]]
    assert values[2] == pytest.approx(0.05, rel=0.5)
    assert values[4] == pytest.approx(0.6, rel=0.5)


@pytest.fixture
def hold_record():
    """A press and a hold of a solid with two times, coarse and clean."""
    from palpate import Samples, force_over_time

    model, theta = GeneralisedMaxwell2(indenter=TIP), (100e3, 60e3, 0.05, 60e3, 0.6)
    time = np.arange(0, 2.5, 5e-3)
    depth = np.interp(time, [0.0, 0.3, 0.4, 3.0], [-1e-3, 0.0, 3e-3, 3e-3])
    random = np.random.default_rng(2)
    force = force_over_time(model, time, depth, np.gradient(depth, time), theta, pulls=False)
    force = force + 0.01 * random.standard_normal(len(time))
    contact, stamp = depth > 0, np.rint(1e9 * time).astype(np.int64)
    steps = np.diff(time, prepend=0.0)
    return model, Samples(stamp, time, steps, force, -depth, -np.gradient(depth, time), contact, contact)
