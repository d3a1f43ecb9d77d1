"""Limits of an arm's posture: speeds and ends of its joints, singular postures, and the box of its links."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from palpate import Floats
from palpate_kit.kinematics.arm_model import ArmModel, inverse_of

# Choices.
_MAX_JOINT_WAY = 0.15  # [rad] of a joint from where it is to where the command is
_MAX_CANCELLATION = 12.0  # joint motion over the tip's; it is 2 to 5 in an ordinary posture
_MM = 1e3  # per metre
SINGULAR = "the arm is near a singular posture: move the specimen to another place in its reach"


@dataclass(frozen=True)
class Verdict:
    """A broken limit."""

    text: str
    trusted: bool = True  # the arm can be trusted to leave the material on its own


class PostureFence:
    """Limits of the arm itself: speeds and ends of its joints, and the box of its links."""

    def __init__(self, arm_facts: dict[str, Any], tool: Floats, model: ArmModel) -> None:
        self._tool, self._model = tool, model
        self._joint_speed, self._links = arm_facts["joint_speed"], (arm_facts["links_low"], arm_facts["links_high"])

    def verdict(self, twist: Floats, error: Floats, joints: list[float], leaving: bool) -> Verdict | None:
        """Return the limit of the arm's posture that a command breaks; None where it keeps them all.

        The command is given by the tip's twist (6,) and the error (6,) from where joints (n,) [rad] have it, both in
        the base. An arm that is `leaving` the material may do so near a singular posture and past an end.
        """
        # Far from a singular posture, where the Jacobian has an inverse.
        _, jacobian, places = self._model.tip_and_places(joints, self._tool)
        try:
            inverse = inverse_of(jacobian)
        except np.linalg.LinAlgError:
            return Verdict(SINGULAR, not leaving)
        if not leaving and _against_one_another(jacobian, inverse[:, :3]) > _MAX_CANCELLATION:
            return Verdict(SINGULAR)
        # Speeds of the joints, and their ways from where they are to the command.
        speeds, ways = (inverse @ twist).tolist(), (inverse @ error).tolist()
        names = self._model.joints
        joint = max(range(len(names)), key=lambda i: abs(speeds[i]))
        if abs(speeds[joint]) > self._joint_speed:
            max_speed = math.degrees(self._joint_speed)
            return Verdict(
                f"a command would turn {names[joint]} at {math.degrees(abs(speeds[joint])):.0f} deg/s, over "
                f"{max_speed:g} deg/s ([device.*] joint_speed): the arm is near a singular posture, or too slow"
            )
        joint = max(range(len(names)), key=lambda i: abs(ways[i]))
        if abs(ways[joint]) > _MAX_JOINT_WAY:
            return Verdict(f"{names[joint]} is {math.degrees(abs(ways[joint])):.0f} deg from its command")
        if leaving:
            return None
        # Ends of the joints at the command, and the box of the links where they are.
        if (text := self._model.end_of([angle + way for angle, way in zip(joints, ways, strict=True)])) is not None:
            return Verdict(text)
        return self._place_outside(places.tolist())

    def _place_outside(self, places: list[list[float]]) -> Verdict | None:
        """Return the first of the places (3,) [m] of elbow, wrist and flange that is out of the box of the links."""
        low, high = self._links
        for name, place in zip(self._model.place_names, places, strict=True):
            if not all(lower <= x <= upper for x, lower, upper in zip(place, low, high, strict=True)):
                location = ", ".join(f"{_MM * x:.0f}" for x in place)
                return Verdict(
                    f"the {name} is at ({location}) mm in the base, out of the box of [device.*] links_low and "
                    "links_high"
                )
        return None


def is_singular(jacobian: Floats) -> bool:
    """Return True if joints near this Jacobian (6, n) of the tip have to move by much to move it a little."""
    try:
        return _against_one_another(jacobian, inverse_of(jacobian)[:, :3]) > _MAX_CANCELLATION
    except np.linalg.LinAlgError:
        return True


def _against_one_another(jacobian: Floats, inverse: Any) -> float:
    """Return how much faster than the tip its joints would move it, each on its own: 2 to 5 in an ordinary posture.

    The root of the sum of squares over the joints and the three directions of the tip. Near a singular posture they
    cancel out, and where one of them lags, brakes or is at its limit, the tip leaves its path.
    """
    return float(np.linalg.norm(np.linalg.norm(jacobian[:3], axis=0)[:, None] * inverse))
