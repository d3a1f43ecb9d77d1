"""Specimens of the simulated rig: material, relief, inclusions."""

import numpy as np
import pytest
from palpate import ConfigurationError, contact_force
from palpate_models import DimensionalityReduction, KelvinVoigt, Sphere
from palpate_simulation.inclusions import Inclusion
from palpate_simulation.simulated_rig import SimulatedRig
from palpate_simulation.skin_under_tip import SkinUnderTip
from palpate_simulation.specimen import Specimen
from palpate_simulation.specimen_layers import Layer, flat_factor, layered_factors
from palpate_simulation.surface_relief import Relief
from palpate_trajectories.approach import PressShape
from palpate_trajectories.line_sweep import LineSweep
from pydantic import ValidationError

MODEL = DimensionalityReduction(indenter=Sphere(radius=0.005))
# On-axis contrast in % by finite elements: {radius [mm]: {depth of the top [mm]: contrast}}.
COMPUTED = {5: {2: 63, 4: 32.5, 6: 17, 8: 9.8, 11: 4.5}, 2.5: {2: 15, 4: 8.1, 6: 4.2, 8: 2.3, 11: 1.1}}


def specimen(**settings):
    return Specimen.model_validate({"model": MODEL, "elasticity": 112e3, "viscosity": 362.0, **settings})


@pytest.mark.parametrize(
    ("radius", "depth", "percent"), [(r, d, c) for r, row in COMPUTED.items() for d, c in row.items()]
)
def test_contrast_above_a_sphere_is_that_of_finite_elements(radius, depth, percent):
    sphere = Inclusion(shape="sphere", radius=radius * 1e-3, depth=depth * 1e-3, stiffness_ratio=5.3)
    assert 100 * sphere.contrast_above == pytest.approx(percent, rel=0.05)


def test_contrast_grows_with_stiffness_and_vanishes_without():
    ratios = [1.0, 2.0, 5.3, 50.0]
    peaks = [Inclusion(shape="sphere", stiffness_ratio=ratio).contrast_above for ratio in ratios]
    assert peaks[0] == 0.0
    assert (np.diff(peaks) > 0).all()


def test_contrast_is_broader_for_deeper_inclusions_and_broader_contacts():
    x, zero = np.array([0.008]), np.zeros(1)

    def share(depth, contact):
        return float(Inclusion(shape="sphere", depth=depth, peak=1.0).contrast(x, zero, contact)[0])

    assert share(0.002, 0.003) < share(0.006, 0.003)
    assert share(0.002, 0.001) < share(0.002, 0.006)


@pytest.mark.parametrize("shape", ["sphere", "cylinder", "horseshoe"])
def test_the_outline_goes_round_the_body(shape):
    body = Inclusion(shape=shape, place=(0.01, -0.02), angle=0.7, peak=0.3)
    outline = body.outline
    assert outline[0] == pytest.approx(outline[-1])
    reach = np.min(np.linalg.norm(outline[:, None] - body.line[None], axis=2), axis=1)
    assert reach.max() <= body.radius + 1e-9
    on_line = body.contrast(body.line[:, 0], body.line[:, 1], 0.0)
    assert on_line == pytest.approx(0.3)


def test_an_image_is_read_and_blurred(tmp_path):
    path = tmp_path / "image.csv"
    image = np.zeros((21, 31))
    image[10, 20] = 0.5
    np.savetxt(path, image, delimiter=",")
    sharp = Inclusion(shape="image", file=path, depth=0.0, pixel=0.001)
    x, y = np.array([0.005, 0.0]), np.array([0.0, 0.0])
    assert sharp.contrast(x, y, 0.0) == pytest.approx([0.5, 0.0])
    blurred = Inclusion(shape="image", file=path, depth=0.005, pixel=0.001).contrast(x, y, 0.0)
    assert 0.0 < blurred[0] < 0.05
    with pytest.raises(ConfigurationError, match="file"):
        Inclusion(shape="image")


@pytest.mark.slow
def test_relief_has_the_slopes_and_the_roughness_that_it_says():
    relief = Relief(roughness=1e-4, length=0.01, tilt_x=0.02, tilt_y=-0.01, seed=5)
    dice = np.random.default_rng(0)
    x, y = dice.uniform(-0.3, 0.3, (2, 4000))
    height, slopes, step = relief.height_at(x, y), relief.slopes_at(x, y), 1e-7
    for slope, tilt, (dx, dy) in zip(slopes, (0.02, -0.01), ((step, 0.0), (0.0, step)), strict=True):
        rise = relief.height_at(x + dx, y + dy) - relief.height_at(x - dx, y - dy)
        assert slope + np.tan(tilt) == pytest.approx(rise / (2 * step), abs=1e-6)
    rough = height - np.tan(0.02) * x - np.tan(-0.01) * y
    assert rough.std() == pytest.approx(1e-4, rel=0.1)
    np.testing.assert_array_equal(height, relief.model_copy().height_at(x, y))
    assert not np.allclose(height, Relief(**{**relief.model_dump(), "seed": 6}).height_at(x, y))


def test_depth_is_measured_from_the_true_skin():
    tilted = specimen(surface=0.001, relief={"tilt_x": 0.1})
    under = SkinUnderTip(tilted, np.array([[0.02, 0.0, -0.002]]))
    ahead = 5e-3 * (1 / np.cos(0.1) - 1)  # the sphere touches beside its lowest point
    assert under.depth == pytest.approx((0.001 + np.tan(0.1) * 0.02 + 0.002 + ahead) * np.cos(0.1))
    rate = under.rate(np.array([[0.004, 0.0, -0.001]]))
    assert rate == pytest.approx((np.tan(0.1) * 0.004 + 0.001) * np.cos(0.1))


def test_the_rig_feels_the_inclusion_under_the_tip():
    sweep = LineSweep(start=(-0.02, 0.0), end=(0.02, 0.0), settle=0.5, press=PressShape(bias=0.004))
    quiet = {"position_std": 0.0, "velocity_std": 0.0, "force_std": 0.0, "bias": 0.0, "drift": 0.0, "tip_mass": 1e-6}
    lump = {"shape": "sphere", "place": (0.005, 0.0), "peak": 0.5}
    rig = SimulatedRig.model_validate({**quiet, "sensor_rate": 500.0, "specimen": specimen(inclusions=(lump,))})
    with rig.connect(0) as link:
        link.follow(sweep)
        batches = list(link.batches())
    streams = {
        name: np.concatenate([batch.values for batch in batches if batch.stream == name])
        for name in ("wrench", "tip", "twist")
    }
    x, z, rate = streams["tip"][:, 0], streams["tip"][:, 2], -streams["twist"][:, 2]
    plain = contact_force(MODEL, -z, rate, (112e3, 362.0), pulls=False)
    pressed = plain > 1.0
    ratio = streams["wrench"][pressed, 2] / plain[pressed]
    above = np.abs(x[pressed] - 0.005) < 5e-4
    away = np.abs(x[pressed] - 0.005) > 0.02
    assert ratio[above] == pytest.approx(1.5, abs=0.01)
    assert ratio[away] == pytest.approx(1.0, abs=0.03)


def test_friction_opposes_sliding():
    sliding = np.array([[0.01, 0.0, 0.0], [0.0, 0.0, 0.0], [0.01, 0.0, 0.0]])
    force = Specimen.model_validate(specimen(friction=0.5)).with_friction(np.array([4.0, 4.0, 0.0]), sliding)
    assert force == pytest.approx(np.array([[-2.0, 0.0, 4.0], [0.0, 0.0, 4.0], [0.0, 0.0, 0.0]]))


@pytest.mark.parametrize(
    ("settings", "word"),
    [
        ({"thickness": 0.003}, "thickness"),
        ({"size": (0.03, 0.03)}, "outside the specimen"),
        ({"diameter": 0.03}, "30 mm of diameter"),
    ],
)
def test_a_motion_through_or_beside_the_specimen_is_refused(settings, word):
    sweep = LineSweep(start=(-0.02, 0.0), end=(0.02, 0.0), settle=0.5, press=PressShape(bias=0.004))
    rig = SimulatedRig.model_validate({"specimen": specimen(**settings)})
    with pytest.raises(ConfigurationError, match=word):
        rig.refuse(sweep.at(np.arange(0.0, sweep.total_duration, 0.01)))


@pytest.mark.parametrize(
    ("name", "elasticity", "viscosity", "contrasts"),
    [
        ("S1", 282.1e3, 860.0, []),
        ("S2", 112.5e3, 362.0, []),
        ("S3", 112.5e3, 362.0, [0.103]),
        ("S4", 112.5e3, 362.0, [0.324]),
        ("S5", 112.5e3, 362.0, [0.324, 0.103]),
    ],
)
def test_the_papers_specimens_are_known_by_name(name, elasticity, viscosity, contrasts):
    known = Specimen.model_validate({"model": MODEL, "name": name})
    assert known.parameters == {"elasticity": elasticity, "viscosity": viscosity}
    assert [inclusion.contrast_above for inclusion in known.inclusions] == contrasts
    assert known.thickness == 0.022
    assert known.diameter == (0.08 if name == "S5" else 0.05)
    for inclusion, contrast in zip(known.inclusions, contrasts, strict=True):
        x, y = inclusion.line[len(inclusion.line) // 2]
        assert SkinUnderTip(known, np.array([[x, y, 0.0]])).theta[0] / elasticity - 1 == pytest.approx(
            contrast, abs=0.015
        )


def test_what_is_said_replaces_what_the_papers_specimen_has():
    other = Specimen.model_validate(
        {"model": MODEL, "name": "S5", "elasticity": 9e4, "inclusions": (), "thickness": 0.03}
    )
    assert other.parameters == {"elasticity": 9e4, "viscosity": 362.0}
    assert other.inclusions == ()
    assert (other.thickness, other.diameter) == (0.03, 0.08)
    again = Specimen.model_validate({key: getattr(other, key) for key in Specimen.model_fields})
    assert again == other
    with pytest.raises(ValidationError, match="S1"):
        Specimen.model_validate({"model": MODEL, "name": "S6", "elasticity": 9e4, "viscosity": 1.0})


def test_layers_are_felt_by_how_far_the_contact_reaches():
    skin = specimen(layers=({"thickness": 0.001, "stiffness_ratio": 3.0},))
    depth = np.array([1e-6, 1e-4, 1e-3, 4e-3])
    place, still = np.column_stack([0 * depth, 0 * depth, -depth]), np.zeros((4, 3))
    thin, thick = (SkinUnderTip(one, place).push(np.arange(4.0), still) for one in (skin, specimen()))
    ratio = thin / thick
    assert ratio[0] == pytest.approx(3.0, rel=0.1)
    assert (np.diff(ratio) < 0).all()
    assert 1.0 < ratio[-1] < 1.6
    like = specimen(layers=({"thickness": 0.001, "stiffness_ratio": 1.0},) * 3)
    same = SkinUnderTip(like, place).push(np.arange(4.0), still)
    assert same == pytest.approx(SkinUnderTip(specimen(), place).push(np.arange(4.0), still), rel=1e-12)


def test_a_layer_may_be_cut_in_two():
    whole = layered_factors((Layer(thickness=0.004, stiffness_ratio=2.0),), MODEL.indenter)
    halves = layered_factors((Layer(thickness=0.002, stiffness_ratio=2.0),) * 2, MODEL.indenter)
    np.testing.assert_allclose(whole, halves, rtol=1e-12)


@pytest.mark.parametrize("wide", [0.05, 0.1, 0.2, 0.35, 0.5])
def test_a_layer_on_rigid_ground_is_near_that_of_the_literature(wide):
    """Garcia and Garcia 2018, flat tip on a bonded layer, at contact radii up to half the thickness."""
    rigid = 1e9
    factor = flat_factor((Layer(thickness=0.01, stiffness_ratio=1 / rigid),), [0.01 * wide])[0] * rigid
    known = 1 + 1.133 * wide + 1.283 * wide**2 + 0.598 * wide**3 - 0.291 * wide**4
    assert factor == pytest.approx(known, rel=0.12)


def test_layers_want_a_tip():
    with pytest.raises(ValidationError, match="indenter"):
        Specimen.model_validate(
            {
                "model": KelvinVoigt(),
                "stiffness": 1e3,
                "damping": 1.0,
                "layers": ({"thickness": 0.001, "stiffness_ratio": 2.0},),
            }
        )


def felt(body, x=0.0):
    """Force [N] of a specimen 4 mm deep at a place, or (n,) at places (n,)."""
    x = np.asarray(x)
    zero = np.zeros(x.size)
    force = SkinUnderTip(body, np.column_stack([x.ravel(), zero, zero - 0.004])).push(zero, np.zeros((x.size, 3)))
    return force if x.ndim else float(force[0])


def test_scatter_is_that_of_its_std_and_length():
    body, plain = specimen(scatter={"std": 0.1, "length": "5 mm"}), felt(specimen())
    factors = felt(body, np.arange(1000) * 0.1) / plain
    assert factors.mean() == pytest.approx(1.0, abs=0.01)
    assert factors.std() == pytest.approx(0.1, rel=0.1)
    assert felt(body, 0.0002) / plain == pytest.approx(factors[0], abs=0.01)
    assert felt(specimen(scatter={"std": 0.1, "seed": 1})) != felt(specimen(scatter={"std": 0.1, "seed": 2}))


def test_the_palpated_place_softens_and_recovers():
    body = specimen(conditioning={"softening": 0.1, "palpations": 2.0, "recovery": "60 s", "reach": "3 mm"})
    fresh = felt(specimen())
    assert felt(body) == pytest.approx(fresh)
    at_once, later = ([(0.0, age)] for age in (0.0, 120.0))
    assert felt(body.conditioned(at_once)) == pytest.approx(fresh * (1 - 0.1 * (1 - np.exp(-0.5))))
    assert felt(body.conditioned(at_once)) < felt(body.conditioned(later)) < fresh
    assert felt(body.conditioned([(0.0, 0.0)] * 100)) == pytest.approx(0.9 * fresh, rel=1e-6)
    assert felt(body.conditioned([(0.05, 0.0)])) == pytest.approx(fresh)  # another place


def test_a_specimen_that_remembers_may_scatter_and_soften():
    from palpate_models import StandardLinearSolid

    plain = {"model": StandardLinearSolid(indenter=Sphere(radius=0.005)), "elasticity": 1e5, "relaxation_time": 0.1}
    plain |= {"relaxing_elasticity": 2e4}
    soft = plain | {"conditioning": {"softening": 0.2}, "palpated": 1e3, "scatter": {"std": 0.1}}
    time = np.arange(500) * 2e-3
    position, velocity = np.zeros((500, 3)), np.zeros((500, 3))
    position[:, 2], velocity[:, 2] = -0.002 * time, -0.002
    one, other = (
        SkinUnderTip(Specimen.model_validate(table), position).push(time, velocity) for table in (plain, soft)
    )
    ratio = other[10:] / one[10:]
    assert np.ptp(ratio) < 1e-12
    assert ratio[0] / Specimen.model_validate(soft).scatter.at(np.zeros(1), np.zeros(1))[0] == pytest.approx(0.8)


def test_the_papers_chicken():
    body = Specimen.model_validate({"name": "chicken", "model": MODEL})
    assert body.parameters == {"elasticity": 53.7e3, "viscosity": 623.0}
    values = felt(body, 0.1 * np.arange(1000))
    assert values.std() / values.mean() == pytest.approx(5.2 / 53.7, rel=0.1)
    lump = Specimen.model_validate({"name": "chicken-sphere", "model": MODEL})
    assert felt(lump) / felt(body) == pytest.approx(102.7 / 53.7, rel=1e-6)
