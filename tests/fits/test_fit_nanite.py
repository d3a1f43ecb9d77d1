"""The same atomic-force curve, fitted here and by nanite."""

import importlib.util

import numpy as np
import pytest
from palpate import Problem, Samples
from palpate_fits import CasadiFit
from palpate_models import DimensionalityReduction, Sphere

if importlib.util.find_spec("nanite") is None:  # it takes seconds to import, in every worker
    pytest.skip("nanite is not installed", allow_module_level=True)

RADIUS, CONTACT, BASELINE = 5e-6, 2e-7, 3e-11


@pytest.mark.parametrize("elasticity", [800.0, 3e3, 40e3])
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_paraboloid_contact_point_and_baseline_agree(elasticity, seed):
    import lmfit
    from nanite.model import models_available

    model = models_available["hertz_para"]
    tip = np.linspace(2e-6, -1e-6, 4000)
    parameters = model.get_parameter_defaults()
    for name, value in {
        "E": elasticity,
        "R": RADIUS,
        "contact_point": CONTACT,
        "baseline": BASELINE,
        "nu": 0.5,
    }.items():
        parameters[name].value = value
    clean = model.model(parameters, tip)
    force = clean + 0.01 * clean.max() * np.random.default_rng(seed).standard_normal(len(tip))
    for name in ("E", "contact_point", "baseline"):
        parameters[name].vary = True
    theirs = lmfit.minimize(
        model.residual, parameters, args=(tip, force), kws={"weight_cp": 0}, ftol=1e-14, xtol=1e-14
    ).params
    n = len(tip)
    time = np.arange(n) / 4000
    contact = tip < CONTACT
    samples = Samples(
        np.arange(n, dtype=np.int64) * 250_000, time, np.concatenate([[0.0], np.diff(time)]), force, tip,
        np.full(n, (tip[1] - tip[0]) * 4000), contact, contact,
    )  # fmt: skip
    fit = CasadiFit(segment="all", fixed={"viscosity": 0.0}, unknowns=("bias",))
    ours = fit.start(Problem(DimensionalityReduction(indenter=Sphere(radius=RADIUS)), None)).run(samples)
    assert ours.values[0, 0] == pytest.approx(theirs["E"].value, rel=1e-4)
    assert ours.surface[0] == pytest.approx(theirs["contact_point"].value, abs=1e-4 * 1e-6)
    assert abs(ours.values[0, 0] - elasticity) < 4 * ours.std[0, 0]
