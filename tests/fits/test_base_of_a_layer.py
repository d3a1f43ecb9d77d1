"""The base of a layer as a fact: a specimen that slides on it is softer than one that is glued (Dimitriadis 2002)."""

import numpy as np
import pytest

from tests.fits.test_fit_files import rows_of

MODULUS, RADIUS, HEIGHT = 50e3, 5e-3, 22e-3  # Pa, m, m
STATED = ("--tip", "paraboloid 5 mm", "--delay", "0 ms +- 0.2 ms", "--tip-mass", "0 g", "--tare", "free-air")


@pytest.fixture
def sliding_layer(tmp_path):
    """A press and hold on a layer that slides on its base, after air; noise 2 mN."""
    time = np.arange(1200) / 300.0
    depth = np.interp(time, [0.0, 0.5, 2.0, 3.0, 4.0], [-1e-3, -0.2e-3, 1.6e-3, 1.6e-3, -1e-3])
    contact = np.maximum(depth, 0.0)
    x = np.sqrt(RADIUS * contact) / HEIGHT
    layer = 1 + 0.884 * x + 0.781 * x**2 + 0.386 * x**3 + 0.0048 * x**4
    force = 16 / 9 * MODULUS * np.sqrt(RADIUS) * contact**1.5 * layer
    force += 2e-3 * np.random.default_rng(3).standard_normal(len(time))
    path = tmp_path / "press.csv"
    columns = np.column_stack([time, force, -1e3 * depth])
    np.savetxt(path, columns, delimiter=",", header="time (s),force (N),height (mm)", comments="")
    return path


def fitted(palpate, path, *words):
    out = path.parent / "out"
    done = palpate("fit", path, *STATED, "--no-pictures", "-o", out, *words)
    return done, rows_of(out)["press"] if (out / "fits.csv").exists() else None


def test_a_layer_that_slides_has_its_own_value_and_no_condition(palpate, sliding_layer):
    done, row = fitted(palpate, sliding_layer, "--thickness", "22 mm", "--base", "sliding")
    assert abs(float(row["elasticity"]) - MODULUS) < 2 * float(row["elasticity_combined"])
    assert row["elasticity_verdict"] == "good"
    assert "glued to its base" not in row["conditions"]
    assert "sliding on its base" in " ".join(done.stdout.split())


@pytest.mark.slow
def test_a_base_that_nobody_states_is_a_condition_with_the_other_as_its_alternative(palpate, sliding_layer):
    done, open_base = fitted(palpate, sliding_layer, "--thickness", "22 mm")
    _, glued = fitted(palpate, sliding_layer, "--thickness", "22 mm", "--base", "bonded")
    assert open_base["elasticity"] == glued["elasticity"]  # what is not stated is taken as glued
    assert glued["elasticity_verdict"] == "doubtful"  # and this record shows that it was not
    assert "base: specimen glued to its base: sliding makes elasticity 3.3 % higher" in open_base["conditions"]
    assert "--base VALUE" in done.stdout


@pytest.mark.slow
def test_the_base_may_stand_in_the_table_of_curves(palpate, sliding_layer):
    sliding_layer.with_name("curves.csv").write_text("curve,base\npress.csv,sliding\n")
    _, row = fitted(palpate, sliding_layer.parent, "--thickness", "22 mm")
    assert abs(float(row["elasticity"]) - MODULUS) < 2 * float(row["elasticity_combined"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--base", "sliding"), "only a specimen of a stated thickness has one"),
        (("--thickness", "half-space", "--base", "sliding"), "only a specimen of a stated thickness has one"),
        (("--thickness", "22 mm", "--base", "glued"), "'glued' is not allowed (there are: bonded, sliding)"),
        (("--thickness", "22 mm", "--base", "sliding", "--tip", "flat 5 mm"), "is known for spheres, not for a flat"),
    ],
)
def test_a_base_that_cannot_be_is_refused(palpate, sliding_layer, words, message):
    done, _ = fitted(palpate, sliding_layer, *words)
    assert done.returncode == 2
    assert message in done.stderr
