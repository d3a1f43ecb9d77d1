"""Palpation along the normals of a dome, on the twins in simulated time: what the arm truly did, at each tick."""

import numpy as np
import pytest
from palpate.errors import ConfigurationError, DeviceError
from palpate_trajectories.stations import rotation_to

from tests.devices.simulated_bench import PIPELINE

RADIUS, HEIGHT = 0.05, 0.3e-3  # [m] of the dome; it is higher than was thought
DOME = '''
import numpy as np
from palpate import Depth, Surface, SurfacePoints, plugin
from pydantic import Field

class Dome(Surface):
    """The upper half of a sphere whose top is the origin."""

    radius: Depth = Field(gt=0, description="radius")

    def nearest(self, places):
        out = places + [0.0, 0.0, self.radius]
        distance = np.sqrt((out**2).sum(axis=1))
        normal, one = out / distance[:, None], np.ones(len(places))
        return SurfacePoints(
            position=self.radius * normal - [0.0, 0.0, self.radius], normal=normal, height=distance - self.radius,
            curvature=np.full((len(places), 2), 1 / self.radius), position_std=1e-4 * one, normal_std=0.01 * one,
            curvature_std=np.zeros((len(places), 2)),
            unknown={int(i): "below the equator" for i in np.flatnonzero(normal[:, 2] < 0)},
        )

    def uppermost(self, lateral):
        square = self.radius**2 - (lateral**2).sum(axis=1)
        points = self.nearest(np.column_stack([lateral, np.sqrt(np.maximum(square, 0.0)) - self.radius]))
        return SurfacePoints(**{**vars(points), "unknown": {int(i): "beside it" for i in np.flatnonzero(square < 0)}})

@plugin
def palpate_surfaces():
    return {"dome": Dome}
'''
PLACES = [(-0.006, 0.004), (0.008, 0.004)]
TABLES = """
[surface.skin]
type = "dome"
radius = "50 mm"

[safety]
low = ["-15 mm", "-15 mm", "-12 mm"]
high = ["15 mm", "15 mm", "30 mm"]
speed = "60 mm/s"
acceleration = "0.6 m/s^2"
stop_force = "12 N"
force = "20 N"
stiffness = "3 N/mm"
latency = "60 ms"
depth = "4 mm"
standstill = "0.2 s"

[trajectory.press]
type = "grid-points"
surface = "skin"
places = [["-6 mm", "4 mm"], ["8 mm", "4 mm"]]
duration = "0.6 s"
settle = "0 s"
press = { bias = "2 mm", amplitude = "0.5 mm", clearance = "3 mm", standstill = "0 s" }

"""


def normal_at(place, radius=RADIUS):
    return np.array([*place, np.sqrt(radius**2 - place[0] ** 2 - place[1] ** 2)]) / radius


@pytest.fixture
def dome(tmp_path, simulated):
    """A function that starts the twins over a dome, the tool as a person has turned it; every tick is recorded."""
    (tmp_path / "dome.py").write_text(DOME)
    text = PIPELINE.read_text().replace('origin = ["-300 mm"', 'origin = ["-220 mm"')
    begin, end = text.index("[safety]"), text.index("[alignment]")
    oriented = '[alignment]\nsurface = "skin"\nweight = "turning"\nlateral_x = "arm.tip.x"\nlateral_y = "arm.tip.y"'
    text = text[:begin] + TABLES + text[end:].replace("[alignment]", oriented, 1)

    def make(*overrides, changes=(), place=PLACES[0], radius=RADIUS, askew=(1.0, -1.0, 0.0)):
        first = normal_at(place, radius)
        start = radius * first - [0.0, 0.0, radius] + 0.004 * first
        body = text.replace("seed = 1", 'seed = 1\nplugins = ["dome.py"]')
        for old, new in changes:
            assert old in body, old
            body = body.replace(old, new)
        file = tmp_path / "dome.toml"
        file.write_text(body)
        turn = np.degrees(rotation_to(first[None])[0]) * [1.0, -1.0, -1.0] + np.array(askew)
        twin = simulated(
            "device.sensor.settle=0.1 s",
            "alignment.tare_duration=0.15 s",
            f"twin.bench.place={start[:2].tolist()}",
            f"twin.bench.height={start[2]}",
            "twin.bench.tool_rotation=[" + ", ".join(f'"{x} deg"' for x in turn) + "]",
            f"twin.bench.specimen.relief={{ radius_x = {radius}, radius_y = {radius} }}",
            f"twin.bench.specimen.surface={HEIGHT}",
            *overrides,
            pipeline=file,
        )
        world, ticks = twin.world, []
        tick = world._tick

        def recorded():
            tick()
            out = -(world._rotation @ world._pose[:3, :3])[:, 2]
            ticks.append((*world.position, *out, world._turning, *world.velocity, world._force))

        world._tick = recorded
        return twin, ticks

    return make


def columns(ticks, radius=RADIUS):
    """Height over the dome [m], angle to its normal [rad], speed of turning [rad/s], place, velocity, force."""
    rows = np.array(ticks)
    away = rows[:, :3] + [0.0, 0.0, radius]
    distance = np.linalg.norm(away, axis=1)
    off = np.arccos(np.clip((away * rows[:, 3:6]).sum(axis=1) / distance, -1.0, 1.0))
    return distance - radius, off, rows[:, 6], rows[:, :3], rows[:, 7:10], rows[:, 10]


@pytest.mark.slow
def test_the_arm_presses_along_the_normals_and_keeps_every_limit_at_every_tick(dome):
    twin, ticks = dome()
    result = twin.run()
    height, off, turning, place, velocity, force = columns(ticks)
    limits = twin.pipeline().safety
    assert height.min() == pytest.approx(-0.0025, abs=0.3e-3)  # the planned depth
    assert height.min() > -limits.depth
    assert np.degrees(off.max()) < np.degrees(limits.orientation)
    assert turning.max() < limits.angular_speed
    assert np.linalg.norm(velocity, axis=1).max() < limits.speed
    assert (place > np.array(limits.low)).all()
    assert (place < np.array(limits.high)).all()
    assert force.max() < limits.stop_force
    pressed = height < -1e-3
    assert np.degrees(off[pressed].max()) < 0.2
    for points, where in zip((place[pressed & (place[:, 0] * side > 0)] for side in (-1, 1)), PLACES, strict=True):
        normal = normal_at(where)
        foot = RADIUS * normal - [0.0, 0.0, RADIUS]
        aside = (points - foot) - np.outer((points - foot) @ normal, normal)
        assert np.linalg.norm(aside, axis=1).max() < 0.3e-3
    between = (np.abs(place[:, 0] - 0.001) < 0.004) & (height > 0)
    assert height[between].min() > 0.0028  # a clearance of 3 mm, and no shortcut through the dome
    found = result.tracks["dr/kinematic"].parameters["elasticity"]
    assert found.value / 112.5e3 == pytest.approx(1.0, abs=0.03)
    assert abs(found.value - 112.5e3) < 2.0 * found.combined
    flags = {flag.code for flag in result.tracks["dr/kinematic"].flags}
    assert not {"turned-weight", "turned-tool", "inclined-skin"} & flags


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_the_limits_hold_at_every_tick_over_domes_drawn_at_random(dome, seed):
    """Radius, places, where the person has left the tool, and the sine.

    Up to 20 s each, for two presses on a dome in simulated time: what is drawn is what no other test has thought of.
    """
    random = np.random.default_rng(400 + seed)
    radius = random.uniform(0.035, 0.09)
    places = random.uniform(-0.3, 0.3, (2, 2)) * min(radius, 0.04)
    sine = random.uniform(0.3e-3, 0.8e-3), random.uniform(1.0, 3.0)
    listed = ", ".join(f'["{1e3 * x:.3f} mm", "{1e3 * y:.3f} mm"]' for x, y in places)
    changes = [
        ('places = [["-6 mm", "4 mm"], ["8 mm", "4 mm"]]', f"places = [{listed}]"),
        ('radius = "50 mm"', f"radius = {radius}"),
        ('amplitude = "0.5 mm"', f"amplitude = {sine[0]}, frequency = {sine[1]}"),
    ]
    twin, ticks = dome(changes=changes, place=places[0], radius=radius, askew=random.uniform(-2.5, 2.5, 3))
    twin.run()
    height, off, turning, place, velocity, force = columns(ticks, radius)
    limits = twin.pipeline().safety
    assert -height.min() == pytest.approx(0.002 + sine[0], abs=0.3e-3)
    assert -height.min() < limits.depth
    assert off.max() < limits.orientation
    assert turning.max() < limits.angular_speed
    assert np.linalg.norm(velocity, axis=1).max() < limits.speed
    assert ((place > np.array(limits.low)) & (place < np.array(limits.high))).all()
    assert force.max() < limits.stop_force
    assert np.degrees(off[height < -1e-3].max()) < 0.3


@pytest.mark.gate
@pytest.mark.slow
def test_a_force_lets_the_arm_leave_along_the_normal_of_its_station(dome):
    twin, ticks = dome("safety.stop_force=1 N")
    with pytest.raises(DeviceError, match="over the limit of 1 N"):
        twin.run()
    height, off, _, place, *_ = columns(ticks)
    deepest = int(np.argmin(height))
    leaving = place[deepest:] - place[deepest]
    normal = normal_at(PLACES[0])
    assert leaving[-1] @ normal > 0.002
    assert np.linalg.norm(leaving - np.outer(leaving @ normal, normal), axis=1).max() < 0.3e-3
    assert np.degrees(off[deepest:].max()) < 0.5


def quiet(ticks):
    """How far the tip went [m]."""
    place = np.array(ticks)[:, :3]
    return np.linalg.norm(place - place[0], axis=1).max()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            [('"-220 mm"', '"-310 mm"'), ('["8 mm", "4 mm"]', '["-14 mm", "4 mm"]')],
            "elbow_joint would turn at .* deg/s, over 90 deg/s",
        ),
        ([('["8 mm", "4 mm"]', '["8 mm", "60 mm"]')], r"place 2 of 2 \(x 8.0, y 60.0 mm\): beside it"),
        ([('depth = "4 mm"', 'depth = "2 mm"')], r"2.50 mm below the surface, over the limit of 2.00 mm"),
        ([('depth = "4 mm"\n', "")], r"needs \[safety\] depth"),
        ([("settle =", 'turn_speed = "30 deg/s"\nsettle =')], "the tool turns at .* over the limit of 10.0 deg/s"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_moves(dome, changes, words):
    twin, ticks = dome(changes=changes)
    with pytest.raises((ConfigurationError, DeviceError), match=words):
        twin.run()
    assert not ticks or quiet(ticks) < 1e-4


@pytest.mark.slow
def test_a_tool_that_is_not_along_the_first_normal_is_refused(dome):
    twin, ticks = dome("twin.bench.tool_rotation=[0, 0, 0]", "safety.orientation=3 deg")
    with pytest.raises(DeviceError, match=r"turned by 8\.3 deg from the normal of the first place, more than"):
        twin.run()
    assert quiet(ticks) < 1e-4
