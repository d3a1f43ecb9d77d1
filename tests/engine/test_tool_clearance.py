"""A tool above its tip against a surface: distances known in closed form, and what a motion is refused for."""

import math

import numpy as np
import pytest
from palpate import ConfigurationError, Setpoint, Surface, SurfacePoints
from palpate_engine.safety import SafetySettings, check_setpoints
from palpate_engine.safety.tool_clearance import ToolBody, tool_clearance
from palpate_surfaces.plane import Plane

TOOL = ToolBody(radius=0.035, begin=0.085, end=0.18)
BOWL = 0.12  # [m]
KNOWN_PLANE = Plane(height_uncertainty=0.0, tilt_uncertainty=0.0)


class Bowl(Surface):
    """The inside of a sphere whose lowest point is the origin."""

    uncertainty: float = 0.0
    rim: float = math.inf  # [m] from its axis

    def nearest(self, places):
        """On the radius, inwards."""
        centre = np.array([0.0, 0.0, BOWL])
        away = places - centre
        distance = np.linalg.norm(away, axis=1)
        normal = -away / np.maximum(distance, 1e-12)[:, None]
        position, ones, zero = centre - BOWL * normal, np.ones(len(places)), np.zeros((len(places), 2))
        std = self.uncertainty * ones
        beyond = np.flatnonzero(np.hypot(*position[:, :2].T) > self.rim)
        unknown = {int(row): "beyond the rim" for row in beyond}
        return SurfacePoints(position, normal, BOWL - distance, zero, std, 0.0 * ones, zero, unknown)

    def uppermost(self, lateral):
        """Not needed."""
        raise NotImplementedError


def still(place, rotation=(0.0, 0.0, 0.0), count=5):
    times = 0.002 * np.arange(count)
    rest = np.zeros((count, 3))
    return times, Setpoint(np.tile(place, (count, 1)), rest, np.ones(count, bool), np.tile(rotation, (count, 1)), rest)


@pytest.mark.parametrize("begin", [0.04, 0.06, 0.0999])
def test_an_upright_tool_in_a_bowl_is_as_near_as_its_upper_end(begin):
    tool = ToolBody(radius=0.03, begin=begin, end=0.1)
    clear = tool_clearance(tool, *still((0.0, 0.0, 0.0)), Bowl())
    assert clear.distance == math.inf  # 40 mm at least from the bottom, as much from the wall
    tool = ToolBody(radius=0.03, begin=begin, end=2 * BOWL - 0.02)
    clear = tool_clearance(tool, *still((0.0, 0.0, 0.0)), Bowl())
    assert clear.distance == pytest.approx(0.02 - 0.03, abs=1e-3)  # by less than a millimetre on the safe side
    assert clear.distance <= 0.02 - 0.03


def test_a_place_beside_the_bottom_brings_the_tool_to_the_wall():
    aside = 0.1
    place = (aside, 0.0, BOWL - math.sqrt(BOWL**2 - aside**2))
    times, setpoint = still(place)  # upright, on a wall that is 56 degrees steep
    clear = tool_clearance(TOOL, times, setpoint, Bowl())
    truth = BOWL - math.hypot(aside, place[2] + TOOL.end - BOWL) - TOOL.radius
    assert truth - 2e-3 < clear.distance <= truth < 0.0
    assert clear.place[2] > BOWL
    assert clear.time in times


@pytest.mark.parametrize(("end", "clear"), [(0.09, True), (0.25, False)])
def test_the_uncertainty_of_the_surface_counts_twice(end, clear):
    tool = ToolBody(radius=0.03, begin=0.08, end=end)
    room = BOWL - abs(end - BOWL) - 0.03 if end > BOWL else 0.05
    for uncertainty, kept in ((0.4 * max(room, 0.0), True), (0.6 * max(room, 0.0), False)):
        distance = tool_clearance(tool, *still((0.0, 0.0, 0.0)), Bowl(uncertainty=uncertainty)).distance
        assert (distance == math.inf) == (clear and kept)


def test_a_tool_that_lies_over_a_plane_is_seen_between_the_places_that_are_asked_about():
    tilt = math.radians(80.0)
    tool = ToolBody(radius=0.02, begin=0.05, end=0.15)
    for margin, clear in ((0.004, True), (-0.001, False)):
        height = 0.02 - 0.05 * math.cos(tilt) + margin
        distance = tool_clearance(tool, *still((0.0, 0.0, height), (tilt, 0.0, 0.0)), KNOWN_PLANE).distance
        assert (distance == math.inf) is clear


def test_no_place_of_a_motion_is_passed_over():
    times = 0.002 * np.arange(2001)
    aside = 0.1 * np.sin(np.pi * times / times[-1]) ** 40  # at the wall for a moment, in the middle
    place = np.column_stack([aside, 0 * times, BOWL - np.sqrt(BOWL**2 - aside**2)])
    setpoint = Setpoint(place, np.gradient(place, times, axis=0), np.ones(len(times), bool))
    clear = tool_clearance(TOOL, times, setpoint, Bowl())
    assert clear.time == pytest.approx(2.0, abs=0.05)
    assert clear.distance < 0.0


LIMITS = {"low": (-0.2,) * 3, "high": (0.2,) * 3, "force": 20.0, "stop_force": 12.0, "stiffness": 3e3, "depth": 0.01}


def test_a_motion_is_refused_by_where_and_by_how_much():
    setpoint = still((0.1, 0.0, BOWL - math.sqrt(BOWL**2 - 0.01)))
    free = SafetySettings(**LIMITS, orientation=0.5)
    (tilt,) = check_setpoints(*setpoint, free, Bowl()).problems
    assert "off the surface's normal" in tilt
    _, problem = check_setpoints(*setpoint, free.model_copy(update={"tool": TOOL}), Bowl()).problems
    assert "0.00 s after the start the tool above the tip comes" in problem
    assert "67.9 mm too near to the surface (x 79.3, y 0.0, z 210.1 mm)" in problem
    assert "[safety] tool" in problem


def test_where_the_surface_is_not_known_a_tool_is_not_known_to_be_clear():
    with pytest.raises(ConfigurationError, match=r"\[safety\] tool: whether it is clear .* beyond the rim"):
        tool_clearance(TOOL, *still((0.05, 0.0, 0.01)), Bowl(rim=0.04))


def test_a_capsule_that_ends_before_it_begins_is_refused():
    with pytest.raises(ConfigurationError, match="the end, 50 mm, is not above the begin, 60 mm"):
        ToolBody(radius="35 mm", begin="60 mm", end="50 mm")
