"""What a result takes for exact: by the powers of the law of a tip, by refits, and by what a declaration takes away."""

import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from palpate.evidence.track_tail import Tail
from palpate_engine import UncertainValue
from palpate_engine.alignment import AlignmentSettings
from palpate_models import DimensionalityReduction, Flat, KelvinVoigt, Sphere, StandardLinearSolid
from palpate_uncertainty.assumption_line import assumption_lines
from palpate_uncertainty.assumptions import assumptions
from palpate_uncertainty.open_facts import open_facts
from scipy.optimize import least_squares

spec = importlib.util.spec_from_file_location("palpations", Path(__file__).with_name("palpations.py"))
palpations = importlib.util.module_from_spec(spec)
spec.loader.exec_module(palpations)
TRACK = palpations.evidence(palpations.SINE, 0.0, 1)


def table_of(track):
    return assumptions([track])[track.name].table


def declared(track, uncertainties=None, **settings):
    """The track as a pipeline would have it that declares more."""
    alignment = AlignmentSettings.model_validate({**track.ending.settings.model_dump(exclude_none=True), **settings})
    return replace(track, ending=replace(track.ending, uncertainties=uncertainties or {}, settings=alignment))


def with_model(model, values):
    """The track, had another model found these values on the same motion."""
    tails = {}
    for name in ("tail", "last"):
        tail = getattr(TRACK.ending, name)
        columns = {key: getattr(tail, key) for key in tail.__dataclass_fields__}
        columns["values"] = np.tile(values, (len(tail.time), 1))
        tails[name] = Tail(**columns)
    return replace(TRACK, model=model, values=np.array(values), ending=replace(TRACK.ending, **tails))


def test_a_sphere_answers_by_the_powers_of_hertz():
    """E is as F, d^-1.5, R^-0.5 and 1 - nu^2; eta as F, (d^0.5 d')^-1, R^-0.5 and 1 - nu."""
    percent = table_of(TRACK)["percent"]
    wanted = {
        "force_scale": (1.0, 1.0),
        "position_scale": (-1.5, -1.5),
        "indenter.radius": (-0.5, -0.5),
        "poisson": (-2 / 3, -1.0),
    }
    assert percent.keys() == wanted.keys()
    for name, (elasticity, viscosity) in wanted.items():
        assert percent[name]["elasticity"] == pytest.approx(elasticity, rel=1e-3)
        assert percent[name]["viscosity"] == pytest.approx(viscosity, rel=1e-3)


def test_the_modulus_under_a_flat_tip_answers_to_what_its_stiffness_does_not():
    """K is F/d whatever the tip; E = K (1 - nu^2)/(2 R)."""
    model = KelvinVoigt(indenter=Flat(radius=5e-3), poisson=0.5)
    percent = table_of(with_model(model, [3000.0, 20.0]))["percent"]
    assert percent["position_scale"]["stiffness"] == pytest.approx(-1.0, rel=1e-6)
    assert percent["indenter.radius"] == pytest.approx(
        {"stiffness": 0.0, "damping": 0.0, "elasticity": -1.0, "viscosity": -1.0}, abs=1e-6
    )
    assert percent["poisson"]["elasticity"] == pytest.approx(-2 / 3, rel=1e-6)


@pytest.mark.slow
def test_a_material_with_memory_answers_to_the_height_by_the_same_power():
    model = StandardLinearSolid(indenter=Sphere(radius=5e-3))
    percent = table_of(with_model(model, [100e3, 60e3, 0.05]))["percent"]
    assert percent["position_scale"]["elasticity"] == pytest.approx(-1.5, abs=0.02)
    assert percent["force_scale"]["elasticity"] == pytest.approx(1.0, abs=1e-3)


def test_a_mount_of_the_stiffness_that_is_named_moves_the_elasticity_by_1_percent():
    """By least squares on a record whose tip gives way by F/k, with E, eta and surface unknown."""
    stiffness = table_of(TRACK)["rigid_above"]["elasticity"]
    time = TRACK.ending.last.time
    depth, rate, _ = palpations.motion(palpations.SINE, time)

    def force(theta, depth, rate):
        deep = depth + 1e-3 * theta[2]
        return (
            theta[0] * 16 / 9 * np.sqrt(5e-3) * 112.5e3 * deep**1.5 + theta[1] * 8 * 362 * np.sqrt(5e-3 * deep) * rate
        )

    at, going = depth, rate
    for _ in range(50):
        pushed = force([1, 1, 0], at, going)
        at = depth - pushed / stiffness
        going = np.gradient(at, time)
    found = least_squares(lambda theta: force(theta, depth, rate) - pushed, [1.0, 1.0, 0.0], xtol=1e-14)
    assert found.x[0] == pytest.approx(0.99, abs=1.5e-3)


def test_what_is_declared_is_not_on_trust():
    stated = declared(TRACK, {"radius": "20 um", "force_scale": 0.005}, series_stiffness="100 N/mm")
    table = table_of(stated)
    assert table["percent"].keys() == {"position_scale", "poisson"}
    assert "rigid_above" not in table
    layer = {"law": "dimitriadis", "height": "22 mm", "bonded": False}
    model = DimensionalityReduction.model_validate({"indenter": Sphere(radius=5e-3), "thickness": layer})
    table = table_of(replace(TRACK, model=model))
    assert "half_space_above" not in table
    assert table["percent"]["thickness.height"]["elasticity"] > 0.1


def test_an_undeclared_thickness_is_in_the_line_alone_where_it_moves_less_than_the_uncertainty():
    thin = DimensionalityReduction(indenter=Sphere(radius=5e-3))
    known, vague = (replace(TRACK, model=thin, combined=share * np.abs(TRACK.values)) for share in (0.01, 0.5))
    for track, matters in ((known, True), (vague, False)):
        (thick,) = [one for one in open_facts([track])["t"].conditions if one.fact == "thickness"]
        values = {"elasticity": UncertainValue(float(track.values[0]), float(track.combined[0]), "Pa")}
        assert thick.matters(values) == matters
    assert table_of(vague)["half_space_above"] == pytest.approx(1.133 * np.sqrt(20e-6) / 0.05, rel=0.01)


@pytest.fixture(scope="module")
def ran(tmp_path_factory, root):
    """A short run with two tracks."""
    from palpate_engine.config import load_pipeline
    from palpate_engine.pipeline import run_pipeline

    pipeline = load_pipeline(root / "pipelines" / "filters.toml", ["trajectory.press.duration=3 s"])
    return run_pipeline(pipeline, tmp_path_factory.mktemp("ran") / "run")


@pytest.mark.slow
def test_a_run_says_it_once_in_one_line(ran):
    (line,) = assumption_lines(ran)
    assert line == (
        "assumed exact; a 1 % error changes elasticity/viscosity by: height 1.5 %, Poisson's ratio 0.7/1.0 %, force "
        "1.0 %, tip radius 0.5 %; rigid mount (210 N/mm: 1 %), level skin (5.1 deg: 1 %), flat skin "
        "(radius 250 mm: 1 %), thick specimen (100 mm: 5 %), 2 Hz only"
    )
    document = json.loads((ran.folder / "result.json").read_text())
    assert all("assumptions" in track["diagnoses"] for track in document["tracks"].values())


@pytest.mark.slow
def test_the_terminal_and_the_page_have_the_line_once(ran, palpate, tmp_path):
    done = palpate("report", ran.folder, "--out", tmp_path / "page.html")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "page.html").read_text().count("a 1 % error changes elasticity/viscosity by: ") == 1
    done = palpate("replay", ran.folder, "--details", "--out", tmp_path / "again")
    assert done.stdout.count("a 1 % error changes elasticity/viscosity by: ") == 1
