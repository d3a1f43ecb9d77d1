"""Elasticity over depth: the slope of a press in thirds of its depth, printed where the law does not describe it."""

import numpy as np
import pytest
from palpate_engine import registry
from palpate_uncertainty.stiffness_over_depth import slope_of

from tests.fits.test_two_tips import RIG, write


def test_the_slope_and_its_scatter_are_those_of_least_squares():
    random = np.random.default_rng(3)
    unit_force = np.linspace(0.0, 1e-5, 400)
    slopes = [slope_of(unit_force, 5e4 * unit_force + 0.2 + 0.01 * random.standard_normal(400)) for _ in range(200)]
    values = [slope.value for slope in slopes]
    assert np.mean(values) == pytest.approx(5e4, abs=4 * np.std(values) / np.sqrt(200))
    assert np.mean([slope.std for slope in slopes]) == pytest.approx(np.std(values), rel=0.2)


@pytest.mark.parametrize(("unit_force", "count"), [(np.linspace(0.0, 1.0, 19), 19), (np.ones(50), 50)])
def test_too_few_samples_have_no_slope(unit_force, count):
    assert slope_of(unit_force, np.ones(count)) is None


def press(path, softening):
    """A press of a flat of 5 mm on 50 kPa that softens to a half beyond 0.7 mm, or does not; noise 1 mN."""
    time = np.arange(800) / 200.0
    depth = np.interp(time, [0.0, 0.5, 2.5, 4.0], [-0.4e-3, -0.1e-3, 2e-3, -0.4e-3])
    contact = np.maximum(depth, 0.0)
    force = 8 / 3 * 50e3 * 5e-3 * (np.minimum(contact, 0.7e-3) + np.maximum(contact - 0.7e-3, 0.0) * softening)
    write(path, np.column_stack([time, force + 1e-3 * np.random.default_rng(1).standard_normal(800), -1e3 * depth]))


@pytest.mark.slow
@pytest.mark.parametrize(("softening", "is_shown"), [(0.5, True), (1.0, False)])
def test_a_press_that_softens_says_so_and_one_of_its_law_does_not(palpate, tmp_path, softening, is_shown):
    press(tmp_path / "press.csv", softening)
    (tmp_path / "rig.toml").write_text(RIG.replace("paraboloid 6 mm", "flat 5 mm") + 'thickness = "half-space"\n')
    palpate("fit", tmp_path / "press.csv", "-o", tmp_path / "fits")
    words = ("--pipeline", tmp_path / "fits" / "pipeline.toml", "--no-pictures", "--details", "-o", tmp_path / "page")
    done = palpate("fit", tmp_path / "press.csv", *words)
    lines = [line for line in done.stdout.splitlines() if line.startswith("elasticity ") and " kPa over " in line]
    assert len(lines) == is_shown
    if is_shown:
        values = [float(text.split(" ± ")[0]) for text in lines[0].removeprefix("elasticity ").split(", ")[:3]]
        assert values[0] == pytest.approx(50.0, rel=0.01)
        assert values[2] == pytest.approx(25.0, rel=0.01)
        page = palpate("report", tmp_path / "page" / "press")
        assert page.returncode == 0
        assert lines[0] in (tmp_path / "page" / "press" / "report.html").read_text()


def test_the_line_is_one_of_the_sections_of_a_page():
    assert "stiffness" in registry.load().report_sections
