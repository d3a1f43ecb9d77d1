"""A raster over a half ellipsoid, on the twins in simulated time: the tip's way against the plan, and each limit."""

from pathlib import Path

import numpy as np
import pytest
from palpate.clocks import clock
from palpate.trajectory import duration_of, setpoints_at

PIPELINE = Path(__file__).parents[2] / "pipelines" / "breast_ur3e.toml"
RASTER = (
    "trajectory.motion.surface=truth",
    "alignment.surface=truth",
    "trajectory.motion.size=['24 mm', '8 mm']",
    "trajectory.motion.pitch=8 mm",
    "trajectory.motion.speed=10 mm/s",
)


@pytest.mark.slow
def test_a_raster_stays_by_the_planned_depth_and_keeps_every_limit_at_every_tick(simulated):
    """Over 20 s for two lines of a raster: the tool turns with a mesh at every tick, which no shorter motion asks."""
    twin = simulated(*RASTER, pipeline=PIPELINE)
    world, ticks = twin.world, []
    tick = world._tick

    def recorded():
        tick()
        out = -(world._rotation @ world._pose[:3, :3])[:, 2]
        ticks.append((clock().now(), *world.position, *out, *world.velocity, world._turning, world._force))

    world._tick = recorded
    twin.run()
    rows = np.array(ticks)
    time, place, out, velocity, turning, force = np.split(rows, [1, 4, 7, 10, 11], axis=1)
    pipeline = twin.pipeline()
    limits, skin = pipeline.safety, pipeline.surfaces["truth"]
    points = skin.nearest(place)
    askew = np.arccos(np.clip((out * points.normal).sum(axis=1), -1.0, 1.0))
    assert ((place > limits.low) & (place < limits.high)).all()
    assert -points.height.min() < limits.depth
    assert askew.max() < limits.orientation
    assert np.linalg.norm(velocity, axis=1).max() < limits.speed
    assert turning.max() < limits.angular_speed
    assert force.max() < limits.stop_force

    motion = pipeline.trajectories["motion"]
    planned = 0.002 * np.arange(int(duration_of(motion) / 0.002))
    setpoint = setpoints_at(motion, planned)
    depth = -skin.nearest(setpoint.position).height

    def apart(begin):
        """How far the tip's depth is from the planned one [m], at most, where it is planned to be measured."""
        then = np.interp(begin + planned, time[:, 0], -points.height)
        return np.abs(then - depth)[setpoint.measuring].max()

    deep = np.flatnonzero(-points.height > 1e-3)[0]
    entry = time[deep, 0] - planned[np.flatnonzero(depth > 1e-3)[0]]
    assert min(apart(entry + late) for late in np.linspace(-0.05, 0.05, 51)) < 0.3e-3
    pressed = points.height < -1e-3
    assert np.degrees(askew[pressed].max()) < 1.0
    assert np.ptp(place[pressed], axis=0)[0] > 0.022
