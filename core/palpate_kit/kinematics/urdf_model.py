"""The kinematic model of an arm from a URDF file, which the library yourdfpy reads."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from palpate import ConfigurationError, Floats

from palpate_kit.kinematics.arm_model import ArmModel, numbers_of
from palpate_kit.kinematics.rotations import rotation_matrix, shortest_turn

_ROUNDING = 1e-12  # of a direction of length 1, across z
_ENDLESS = 1e4  # [rad] to both sides, of a joint that turns round and round


def urdf_model(path: Path, base: str, flange: str) -> ArmModel:
    """Return the joints between two links of a URDF file.

    `base` and `flange` are the names of the links, from the foot of the arm to where a tool is mounted. Raises
    ConfigurationError, with file and joint, where that is not a chain of turning joints, or one of them has no limits:
    without an end and a speed nothing is known to be allowed.
    """
    robot = _robot(path)
    chain = _chain(robot, path, base, flange)
    turning = [joint for joint in chain if joint.type != "fixed"]
    limits = [_limits(joint, path) for joint in turning]  # least and greatest angle [rad], highest speed [rad/s]
    to_next_axis, links = np.eye(4), list[Floats]()
    # A link of the model is all from one turning axis to the next; fixed joints are part of it.
    for joint in chain:
        to_next_axis = to_next_axis @ (np.eye(4) if joint.origin is None else np.asarray(joint.origin, float))
        if joint.type != "fixed":
            axis = _axis(joint)  # the transform that turns z into the joint's axis
            links.append(to_next_axis @ axis)
            to_next_axis = axis.T
    links.append(to_next_axis)
    low, high, speed = zip(*limits, strict=True) if limits else ((), (), ())
    return ArmModel(
        name=str(robot.name or path.stem),
        base=numbers_of(links[0]),
        links=tuple(numbers_of(link) for link in links[1:]),
        joints=tuple(joint.name for joint in turning),
        low=low,
        high=high,
        speed=speed,
    )


def _robot(path: Path) -> Any:
    """Return the robot of a URDF file; raises ConfigurationError where it cannot be read."""
    try:
        import yourdfpy
    except ImportError as error:
        raise ConfigurationError(f"{path}: yourdfpy reads URDF files: pip install 'palpate[urdf]'") from error
    try:
        loaded = yourdfpy.URDF.load(str(path), build_scene_graph=False, load_meshes=False)
    except Exception as error:  # whatever XML and its reader raise
        raise ConfigurationError(f"{path}: cannot be read as URDF: {type(error).__name__}: {error}") from error
    return loaded.robot


def _chain(robot: Any, path: Path, base: str, flange: str) -> list[Any]:
    """Return the joints from one link to another; raises ConfigurationError where they are not a chain that turns.

    The way is followed from the `flange` down to the `base`, by the joint that leads to each link.
    """
    leading = {joint.child: joint for joint in robot.joints}
    chain, link = list[Any](), flange
    while link != base:
        if link not in leading or len(chain) > len(robot.joints):
            raise ConfigurationError(
                f"{path}: no joints lead from link {base!r} to link {flange!r}; {link!r} ends there"
            )
        chain.append(leading[link])
        link = leading[link].parent
    for joint in chain:
        if joint.type not in ("fixed", "revolute", "continuous"):
            raise ConfigurationError(f"{path}: joint {joint.name!r} is {joint.type}: joints that turn make an arm")
    return chain[::-1]


def _limits(joint: Any, path: Path) -> tuple[float, float, float]:
    """Return the ends [rad] and the speed [rad/s] of a joint; raises ConfigurationError where they are not stated."""
    limit = joint.limit
    ends = (None, None) if limit is None else (limit.lower, limit.upper)
    if joint.type == "continuous":
        ends = -_ENDLESS, _ENDLESS
    numbers = (*ends, None if limit is None else limit.velocity)
    lower, upper, speed = (math.nan if number is None else float(number) for number in numbers)
    if not (lower < upper and speed > 0.0 and math.isfinite(upper - lower + speed)):
        raise ConfigurationError(f"{path}: joint {joint.name!r} has no limits: lower, upper and velocity are needed")
    return lower, upper, speed


def _axis(joint: Any) -> Floats:
    """Return the turn (4, 4) from z to a joint's axis."""
    direction = np.array([1.0, 0.0, 0.0]) if joint.axis is None else np.asarray(joint.axis, float)
    direction = direction / np.linalg.norm(direction)
    opposite = math.hypot(*direction[:2].tolist()) < _ROUNDING and direction[2] < 0.0
    turn = np.eye(4)
    turn[:3, :3] = rotation_matrix([math.pi, 0.0, 0.0] if opposite else shortest_turn(direction).tolist())
    return turn
