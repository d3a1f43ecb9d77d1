"""The plane, and what the core asks of any surface."""

import math
from pathlib import Path

import numpy as np
import pytest
from palpate import ConfigurationError, Floats, PluginError, Settings, Surface, SurfacePoints, surface_points
from palpate.registry import load
from palpate_engine.config import load_pipeline
from palpate_engine.config.part_builder import Builder
from palpate_engine.config.pipeline_source import Source
from palpate_engine.config.resolved_pipeline import resolved_text
from palpate_surfaces import Plane
from palpate_testing import check_surface
from palpate_trajectories.nominal_height import NominalHeight

INCLINED = Plane(height=0.002, tilt_x=math.radians(20.0), tilt_y=math.radians(-5.0))


def test_it_passes_the_checks_of_every_surface():
    check_surface(INCLINED, np.array([[0.0, 0.0], [0.03, -0.01], [-0.02, 0.04]]))


def test_height_is_along_the_normal():
    flat = surface_points(Plane(height=0.001), np.array([[0.03, 0.04, 0.006]]))
    np.testing.assert_allclose(flat.position, [[0.03, 0.04, 0.001]])
    assert flat.height == pytest.approx([0.005])
    tilted = surface_points(Plane(tilt_x=math.radians(30.0)), np.array([[0.0, 0.0, 0.01]]))
    assert tilted.height == pytest.approx([0.01 * math.cos(math.radians(30.0))])
    np.testing.assert_allclose(tilted.normal, [[-0.5, 0.0, math.sqrt(0.75)]])


def test_uncertainty_grows_with_the_distance_from_the_origin():
    plane = Plane(height_uncertainty=3e-4, tilt_uncertainty=0.01)
    points = surface_points(plane, np.array([[0.0, 0.0], [0.04, 0.0]]))
    assert points.position_std == pytest.approx([3e-4, 5e-4])
    assert points.normal_std == pytest.approx([0.01, 0.01])


class Odd(Surface):
    """Answers what it is given."""

    answer: object = None

    def nearest(self, places: Floats) -> SurfacePoints:
        return self.answer(Plane().nearest(places))

    uppermost = nearest


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda points: None, "Odd: it returns NoneType"),
        (lambda points: {}["no"], r"surface Odd failed: KeyError: 'no' \(test_plane.py, line \d+"),
        (lambda points: SurfacePoints(**{**vars(points), "height": points.normal}), r"height for 2 places .* \(2,\)"),
        (lambda points: SurfacePoints(**{**vars(points), "curvature": points.curvature / [1, 0]}), "at place 1"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_a_wrong_surface_is_named(answer, words):
    with pytest.raises(PluginError, match=words):
        surface_points(Odd(answer=answer), np.zeros((2, 3)))


def test_what_is_not_known_is_refused_by_its_place():
    hole = Odd(answer=lambda points: SurfacePoints(**{**vars(points), "unknown": {1: "in a hole"}}))
    with pytest.raises(ConfigurationError, match=r"^place 2 of 3 \(x 0.0, y 40.0, z 0.0 mm\): in a hole$"):
        surface_points(hole, np.array([[0.0, 0.0, 0.0], [0.0, 0.04, 0.0], [0.1, 0.0, 0.0]]))


def test_rows_without_knowledge_are_not_a_number():
    points = Plane().nearest(np.zeros((3, 3))).without({1: "in a hole"}).without({2: "beside it"})
    assert np.isnan(points.height).tolist() == [False, True, True]
    assert np.isnan(points.normal).all(axis=1).tolist() == [False, True, True]
    assert points.unknown == {1: "in a hole", 2: "beside it"}


@pytest.mark.slow
def test_a_pipeline_has_it_by_name(point_pipeline, tmp_path):
    table = 'surface.skin={type = "plane", tilt_x = "10 deg", height = "2 mm"}'
    pipeline = load_pipeline(point_pipeline, [table])
    assert pipeline.surfaces["skin"] == Plane(height=0.002, tilt_x=math.radians(10.0))
    again = tmp_path / "again.toml"
    again.write_text(resolved_text(pipeline))
    assert load_pipeline(again).surfaces == pipeline.surfaces
    with pytest.raises(ConfigurationError, match=r"\[surface.skin\] tilt_x: .*less than or equal"):
        load_pipeline(point_pipeline, [table.replace("10 deg", "80 deg")])


class Motion(Settings):
    """A surface by its name or in place, or a nominal height."""

    surface: Surface | NominalHeight


@pytest.mark.parametrize(
    ("value", "answer"),
    [
        ("skin", Plane(height=0.002)),
        ({"type": "plane"}, Plane()),
        ({"height": "3 mm"}, NominalHeight(height=0.003)),
        ("skim", "no [surface.skim]; did you mean 'skin'?"),
        ({"type": "plan"}, "no surface 'plan'; did you mean 'plane'?"),
        ({"hight": 1.0}, "unknown key 'hight'; did you mean 'height'?"),
    ],
)
def test_a_field_may_name_a_surface_or_be_a_table_without_a_type(value, answer):
    source = Source("", Path("motion.toml"))
    source.tables = {"motion": {"surface": value}, "surface": {"skin": {"type": "plane", "height": "2 mm"}}}
    builder = Builder(source, load())
    motion = builder.settings(Motion, ("motion",))
    if isinstance(answer, str):
        assert answer in " ".join(mistake.problem for mistake in builder.mistakes)
    else:
        assert motion.surface == answer
