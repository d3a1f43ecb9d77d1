"""The joints of a whole motion, before anything moves."""

import math

import numpy as np
import pytest
from palpate import DeviceError
from palpate_arms.reach import ArmReach
from palpate_kit.kinematics.rotations import matrix_of, rotation_matrix
from palpate_kit.kinematics.ur_arm import UR3E
from palpate_kit.kinematics.work_frame import WorkFrame
from palpate_surfaces.plane import Plane
from palpate_trajectories.line_sweep import LineSweep
from palpate_trajectories.point import Point
from palpate_trajectories.stations import local_axes

TOOL = matrix_of([0.0, 0.0, 0.12, 0.0, 0.0, 0.0])
START = np.array([0.0, -1.3, -1.9, -1.5, 1.5708, 0.0])
PRESS = {"bias": 0.002, "amplitude": 0.0005}
BOX = ((-2.0, -2.0, 0.0), (2.0, 2.0, 2.0))


def reach(origin, surface, **changes):
    """An arm whose tool stands along the normal of a plane, above the origin of its work."""
    work = WorkFrame(origin=origin)
    normal = surface.nearest(np.zeros((1, 3))).normal[0]
    goal, q = work.tool_pose(0.005 * normal), START
    axes, level = local_axes(normal), goal[:3, :3].copy()
    angle = math.acos(normal[2])
    axis = np.cross([0.0, 0.0, 1.0], normal) / max(math.sin(angle), 1e-12)
    for share in np.linspace(0.0, 1.0, 9):
        goal[:3, :3] = rotation_matrix((share * angle * axis).tolist()) @ level
        q = UR3E.joints_at(goal, TOOL, q, steps=100)
    assert np.allclose(goal[:3, :3], axes @ level)
    settings = {"joint_speed": math.pi / 2, "speed": 0.06, "links": BOX, **changes}
    return ArmReach(UR3E, TOOL, work, joints=q, **settings)


def test_a_press_on_an_inclined_plane_near_the_base_is_within_reach():
    plane = Plane(tilt_x=math.radians(-20.0))
    reach((-0.22, -0.13, 0.1), plane).refuse(Point(surface=plane, duration=1.0, **PRESS))


@pytest.mark.parametrize(
    ("origin", "tilt", "end", "changes", "words"),
    [
        ((-0.22, -0.13, 0.1), -20.0, (0.0, 0.05), {"speed": 1e-3}, "the flange would move at 1. mm/s, over 1 mm/s"),
        ((-0.22, -0.13, 0.1), -20.0, (0.0, 0.05), {"joint_speed": 0.01}, "would turn at .* deg/s, over 0.57"),
        (
            (-0.22, -0.13, 0.1), -20.0, (0.0, 0.05), {"links": (BOX[0], (2.0, 2.0, 0.2))}, "would be out of the box",
        ),
    ],
)  # fmt: skip
def test_what_an_arm_cannot_do_is_named_with_its_place(origin, tilt, end, changes, words):
    plane = Plane(tilt_x=math.radians(tilt))
    sweep = LineSweep(end=end, surface=plane, settle=0.0, speed=0.004, press=PRESS)
    with pytest.raises(DeviceError, match=words) as caught:
        reach(origin, plane, **changes).refuse(sweep)
    assert "mm in the work frame" in str(caught.value)
    assert "s after the start" in str(caught.value)


@pytest.mark.slow
def test_a_sweep_that_ends_out_of_reach_is_refused_where_it_does():
    plane = Plane(tilt_x=math.radians(-20.0))
    sweep = LineSweep(end=(-0.4, 0.0), surface=plane, settle=0.0, speed=0.004, press=PRESS)
    with pytest.raises(DeviceError, match=r"out of the arm's reach|singular posture"):
        reach((-0.22, -0.13, 0.1), plane, joint_speed=1e3, speed=1e3).refuse(sweep)
