"""Values that no soft material has are told, and so is a depth at which a paraboloid is no sphere."""

import csv
import json
import shutil

import numpy as np
import palpate as python
import pytest
from palpate_models import ExactSphere, Sphere


def press(radius=5e-3, deepest=5e-3):
    """Time [s], force [N], height [m] and velocity [m/s] of a press of a sphere."""
    time = np.arange(0.0, 4.0, 0.002)
    phase = 2 * np.pi * time
    depth, rate = deepest * (0.6 - 0.4 * np.cos(phase)), deepest * 0.8 * np.pi * np.sin(phase)
    force = np.sqrt(radius) * (16 / 9 * 112e3 * depth**1.5 + 8 * 362 * depth**0.5 * rate)
    force += np.random.default_rng(1).normal(0.0, 0.02, len(time))
    return time, force, -depth, -rate


def pressed(times=1.0, radius=5e-3):
    """The record of a press; heights are wrong by a factor."""
    time, force, height, velocity = press(radius)
    return python.record(
        time=time,
        force=force,
        height=height * times,
        velocity=velocity * times,
        timing="0.3 ms",
        tip_mass=0,
        tare="0 N",
    )


@pytest.mark.slow
@pytest.mark.parametrize(("times", "flagged"), [(1e3, True), (1.0, False), (1e-3, True)])
def test_millimetres_as_metres_and_metres_as_millimetres(times, flagged):
    """3.5 Pa and 3.5 GPa where 112 kPa is true."""
    fit = python.fit(pressed(times), tip=Sphere(radius="5 mm"), model="dr")
    assert ("implausible" in {flag.code for flag in fit.flags}) == flagged


@pytest.mark.slow
@pytest.mark.parametrize(("tip", "flagged"), [(Sphere, True), (ExactSphere, False)])
def test_a_paraboloid_far_beyond_its_radius(tip, flagged):
    fit = python.fit(pressed(radius=2e-3), tip=tip(radius="2 mm"), model="dr")
    assert ("beyond-model-range" in {flag.code for flag in fit.flags}) == flagged


@pytest.mark.slow
def test_innovations_as_large_as_they_should_be_are_not_flagged(run_point):
    tracks = run_point("trajectory.press.duration=4 s", 'run.tracks=["*/kinematic"]').tracks
    assert "inconsistent" not in {flag.code for flag in tracks["dr/kinematic"].flags}


@pytest.mark.parametrize(("elasticity", "none"), [(0.6, True), (3e9, True), (1e5, False)])
def test_an_elasticity_of_nothing_soft_is_no_value(elasticity, none):
    """What else the record says is in doubt then."""
    from types import SimpleNamespace

    from palpate.evidence.uncertain_value import UncertainValue
    from palpate.registry import load
    from palpate_engine.result.materiality import weigh
    from palpate_models import DimensionalityReduction
    from palpate_uncertainty.plausibility import _unit_flags

    numbers = {"elasticity": elasticity, "viscosity": 300.0}
    last = SimpleNamespace(values=np.array([[*numbers.values()]]), std=np.array([[1e-3, 1.0]]))
    flags = [*_unit_flags(last, DimensionalityReduction(indenter=Sphere(radius="5 mm")))]
    values = {name: UncertainValue(value, 1e-3, "Pa") for name, value in numbers.items()}
    expected = ("invalid", "doubtful") if none else ("good", "good")
    assert tuple(weigh(flags, values, load()).by_value.values()) == expected


@pytest.mark.slow
def test_an_implausible_value_is_in_no_mean(tmp_path, palpate):
    """The heights of one file of four are named as metres, and are millimetres: 3 Pa."""
    for number in range(4):
        time, force, height, _ = press(deepest=5e-3 - 1e-4 * number)
        columns = np.column_stack([time, force, 1e3 * height])[:1000]
        header = f"time_s,force_N,height_{'m' if number == 3 else 'mm'}"
        np.savetxt(tmp_path / f"{number}.csv", columns, delimiter=",", header=header, comments="")
    done = palpate("fit", ".", "--tip", "paraboloid 5 mm", "--out", "out")
    assert done.returncode == 1, done.stderr  # a file has no value
    with (tmp_path / "out" / "fits.csv").open(newline="") as file:
        rows = {row["curve"]: row for row in csv.DictReader(file)}
    assert "implausible" in rows["3.csv"]["flags"]
    assert [bool(rows[f"{number}.csv"]["elasticity"]) for number in range(4)] == [True, True, True, False]
    group = json.loads(palpate("repeat", "out", "--json").stdout)["groups"]["runs"]
    assert group["values"] == [float(rows[f"{number}.csv"]["elasticity"]) for number in range(3)]


@pytest.mark.slow
def test_an_implausible_value_of_a_run_is_in_no_mean(tmp_path, run_point, palpate):
    good = run_point("trajectory.press.duration=2 s", 'run.tracks=["*/kinematic"]', name="good").folder
    bad = shutil.copytree(good, tmp_path / "bad")
    document = json.loads((bad / "result.json").read_text())
    document["tracks"]["dr/kinematic"]["parameters"]["elasticity"] |= {"value": 0.6, "verdict": "invalid"}
    (bad / "result.json").write_text(json.dumps(document))
    group = json.loads(palpate("repeat", good, bad, "--track", "dr/kinematic", "--json").stdout)["groups"]["runs"]
    assert len(group["values"]) == 1
    assert group["values"][0] > 1e4


@pytest.mark.parametrize(
    ("viscosity", "expected"),
    [
        (-629471.0, [("implausible", "doubtful")]),
        (-500.0, [("undetermined", "note")]),  # one of 160 records of a material without viscosity
        (-300.0, []),  # within two of its uncertainties: not determined as any other value
        (5.0, []),
    ],
)
def test_a_viscosity_below_none_by_more_than_its_uncertainty_is_no_value(viscosity, expected):
    """-500 +- 200 Pa s is none at all, as far as is known; -629471 +- 200 is no material."""
    from types import SimpleNamespace

    from palpate.registry import load
    from palpate_models import Maxwell
    from palpate_uncertainty.possible_values import impossible_values

    model = Maxwell(indenter=Sphere(radius="5 mm"))
    track = SimpleNamespace(
        model=model, values=np.array([1e5, viscosity]), combined=np.array([1e3, 200.0]), ending=None
    )
    flags = load().judged(impossible_values(track))
    assert [(flag.code, flag.severity) for flag in flags] == expected
