"""Motions over surfaces: depth along the normal, the tool along it, and no way through the body."""

import math
from dataclasses import replace

import numpy as np
import pytest
from palpate import ConfigurationError, Surface, SurfacePoints, surface_points
from palpate_engine.safety import SafetySettings, check_motion
from palpate_kit.kinematics.turns_to_normals import rotation_rate, rotation_to
from palpate_surfaces.plane import Plane
from palpate_testing import check_trajectory
from palpate_trajectories.grid_points import GridPoints
from palpate_trajectories.line_sweep import LineSweep
from palpate_trajectories.point import Point
from palpate_trajectories.ramp_hold import RampHold
from palpate_trajectories.raster import Raster
from palpate_trajectories.translation import TranslatedTrajectory

RADIUS = 0.05


class Dome(Surface):
    """The upper half of a sphere of 50 mm whose top is the origin."""

    def nearest(self, places):
        """On the radius."""
        out = places + np.array([0.0, 0.0, RADIUS])
        distance = np.linalg.norm(out, axis=1)
        normal, zero = out / distance[:, None], np.zeros(len(places))
        position, curvature = RADIUS * normal - [0.0, 0.0, RADIUS], np.full((len(places), 2), 1.0 / RADIUS)
        flat = np.zeros((len(places), 2))
        return SurfacePoints(position, normal, distance - RADIUS, curvature, zero, zero, flat)

    def uppermost(self, lateral):
        """Above x and y."""
        square = RADIUS**2 - (lateral**2).sum(axis=1)
        points = self.nearest(np.column_stack([lateral, np.sqrt(np.maximum(square, 0.0)) - RADIUS]))
        return SurfacePoints(**{**vars(points), "unknown": {int(i): "beside it" for i in np.flatnonzero(square < 0)}})


PRESS = {"bias": 0.002, "amplitude": 0.0005, "clearance": 0.003}
LIMITS = SafetySettings(
    low=(-0.06,) * 3, high=(0.06,) * 3, speed=0.06, force=20.0, stop_force=12.0, stiffness=3e3, depth=0.0026,
    orientation=math.radians(0.1), latency=0.05,
)  # fmt: skip


def motions(surface):
    sweep = {"surface": surface, "press": PRESS, "settle": 0.5}
    return {
        "point": Point(surface=surface, place=(0.02, -0.01), duration=1.0, **PRESS),
        "moved": TranslatedTrajectory(of=Point(duration=1.0, **PRESS), by=(0.02, -0.01), surface=surface),
        "grid-points": GridPoints(places=((0.02, 0.0), (-0.02, 0.01), (0.0, 0.03)), surface=surface, press=PRESS),
        "line-sweep": LineSweep(start=(-0.02, 0.005), end=(0.025, 0.0), speed=0.005, **sweep),
        "raster": Raster(size=(0.04, 0.01), pitch=0.005, speed=0.005, **sweep),
        "one way": Raster(size=(0.03, 0.01), pitch=0.01, speed=0.005, return_speed=0.006, boustrophedon=False, **sweep),
    }


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize("name", motions(Dome()))
def test_the_tool_goes_along_the_normals_of_a_dome_within_every_limit(name):
    motion = motions(Dome())[name]
    check_trajectory(motion)
    assert check_motion(motion, LIMITS).problems == ()
    setpoint = motion.at(np.arange(0.0, motion.total_duration, 0.01))
    points = surface_points(Dome(), setpoint.position)
    assert (-points.height).max() == pytest.approx(0.0025, abs=3e-6)
    assert points.height.max() == pytest.approx(0.003, abs=3e-6)  # also on the way
    tilt = np.degrees(np.arccos((setpoint.axes[:, 2]).clip(-1.0, 1.0)))
    assert tilt.max() > 18.0
    pressed = setpoint.measuring
    assert (points.height[pressed] < -0.0014).all()
    times = np.arange(0.0, motion.total_duration, 0.001)
    fine = motion.at(times)
    assert np.allclose(np.gradient(fine.position, times, axis=0)[1:-1], fine.velocity[1:-1], atol=2e-4)


def test_the_speed_of_a_sweep_is_that_along_the_surface():
    sweep = motions(Dome())["line-sweep"]
    setpoint = sweep.at(np.arange(0.0, sweep.total_duration, 0.01))
    points = surface_points(Dome(), setpoint.position)
    pace = np.linalg.norm(np.diff(points.position, axis=0), axis=1) / 0.01
    steady = pace[(pace > 0.0049)]
    assert len(steady) > 0.8 * 0.045 / 0.005 / 0.01
    assert steady.max() == pytest.approx(0.005, rel=2e-3)


@pytest.mark.parametrize("name", motions(Plane()))
def test_a_level_plane_gives_the_motion_of_the_work_frame(name):
    over = motions(Plane())[name]
    if name == "moved":
        flat = TranslatedTrajectory(of=Point(duration=1.0, **PRESS), by=(0.02, -0.01))
    else:
        flat = type(over).model_validate({key: getattr(over, key) for key in over.model_fields_set - {"surface"}})
    times = np.arange(0.0, over.total_duration, 0.01)
    if name != "grid-points":  # whose ways in the air are of another form
        assert over.total_duration == pytest.approx(flat.total_duration, abs=1e-9)
        for key in ("position", "velocity"):
            assert np.allclose(getattr(over.at(times), key), getattr(flat.at(times), key), atol=1e-9)
    assert not over.at(times).rotation.any()


def test_any_press_is_one_in_the_frame_of_its_place():
    hold = RampHold(depths=(0.002,), hold=0.5)
    there = TranslatedTrajectory(of=hold, by=(0.02, 0.0), surface=Dome())
    times = np.linspace(0.0, hold.total_duration, 50)
    assert surface_points(Dome(), there.at(times).position).height == pytest.approx(hold.at(times).position[:, 2])
    with pytest.raises(ConfigurationError, match="follows one already"):
        TranslatedTrajectory(of=there, by=(0.0, 0.0), surface=Dome())
    with pytest.raises(ConfigurationError, match="moved by its own places"):
        TranslatedTrajectory(of=there, by=(0.01, 0.0))


def test_a_place_beside_the_body_is_named():
    grid = GridPoints(places=((0.0, 0.0), (0.06, 0.0)), surface=Dome(), press=PRESS)
    with pytest.raises(ConfigurationError, match=r"place 2 of 2 \(x 60.0, y 0.0 mm\): beside it"):
        _ = grid.total_duration


class Liar(Point):
    """A motion whose setpoints are not what it says."""

    def at(self, time):
        """Turned by 10 degrees against the normal, or otherwise than it states."""
        found = super().at(time)
        turned = found.rotation + np.radians([10.0, 0.0, 0.0])
        if self.frequency == 2.5:
            return replace(found, angular_velocity=found.angular_velocity + 0.1)
        if self.frequency == 3.0:
            return replace(found, rotation=found.rotation * (1.0 + 0.01 * time[:, None]))
        return replace(found, rotation=turned)


@pytest.mark.parametrize(
    ("frequency", "words"),
    [
        (2.0, "deg off the surface's normal, over the limit of 5.0 deg"),
        (2.5, "otherwise than its stated"),
        (3.0, "otherwise than its stated"),
    ],
)
def test_no_setpoint_is_believed(frequency, words):
    motion = Liar(surface=Dome(), place=(0.03, 0.0), duration=1.0, frequency=frequency, **PRESS)
    limits = LIMITS.model_copy(update={"orientation": math.radians(5.0)})
    assert any(words in problem for problem in check_motion(motion, limits).problems)


def test_a_surface_needs_a_largest_depth_and_keeps_it():
    motion = motions(Dome())["point"]
    no_depth = check_motion(motion, LIMITS.model_copy(update={"depth": None})).problems
    assert no_depth == ("a motion over a surface needs [safety] depth, the largest depth below it",)
    (problem,) = check_motion(motion, LIMITS.model_copy(update={"depth": 0.002})).problems
    assert problem.startswith("the tip goes 2.50 mm below the surface, over the limit of 2.00 mm")


@pytest.mark.parametrize("angle", [0.0, 1e-5, 1e-3, 0.3, 1.4])
def test_the_shortest_turn_to_a_normal_and_its_rate(angle):
    def normal(t):
        a, b = angle * np.cos(t), angle * np.sin(2 * t)
        size = np.hypot(a, b)
        scale = np.sinc(size / np.pi)
        return np.column_stack([scale * a, scale * b, np.cos(size)])

    t, step = np.linspace(0.0, 1.0, 7), 1e-6
    rate = (normal(t + step) - normal(t - step)) / (2 * step)
    found = (rotation_to(normal(t + step)) - rotation_to(normal(t - step))) / (2 * step)
    assert np.allclose(rotation_rate(normal(t), rate), found, atol=1e-4 * max(angle, 1e-4) + 1e-9)
