"""An arm that a person leads by hand: this program reads its states and commands nothing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from palpate import DeviceError, Floats, Link, clock
from palpate_kit.kinematics.rotations import rotation_matrix, rotation_vector

if TYPE_CHECKING:
    from palpate_arms.arm_link import ArmLink

# Choices.
LISTEN = 0.5  # [s] of a standstill, over which a posture is the mean
_MAX_MOVE = 0.2e-3  # [m] that the tip may move meanwhile


class UnsteadyError(Exception):
    """A movement of the arm while it was read; the message has its size."""


@dataclass(frozen=True)
class Posture:
    """An arm at standstill, in its base."""

    tip: Floats  # (4, 4)
    flange: Floats  # (4, 4)
    wrench: Floats | None = None  # (6,) [N, N m] of the sensor in the flange, with all that it carries and its offset


class HandReader(Protocol):
    """A reader of an arm that a person leads."""

    tool: Floats  # (4, 4) the tip on the flange

    def read(self) -> Posture:
        """Return the mean over half a second; raises UnsteadyError, DeviceError."""
        ...


def mean_pose(places: Floats, vectors: Floats) -> Floats:
    """Return the mean (4, 4) of places (n, 3) [m] and rotation vectors (n, 3) that are near one another.

    Raises UnsteadyError where the places are not.
    """
    movement = float(np.ptp(places, axis=0).max())
    if movement > _MAX_MOVE:
        raise UnsteadyError(f"the tip moved by {1e3 * movement:.1f} mm: let go of freedrive, and keep off")
    pose = np.eye(4)
    pose[:3, 3] = places.mean(axis=0)
    # The mean of turns from the first orientation: near half a turn the signs of rotation vectors are up to chance.
    first = rotation_matrix(vectors[0].tolist())
    turns = [rotation_vector(first.T @ rotation_matrix(vector.tolist())) for vector in vectors]
    pose[:3, :3] = first @ rotation_matrix(np.mean(turns, axis=0).tolist())
    return pose


class _ObservedArm:
    """Any arm, by its joints and its kinematic model (a HandReader)."""

    def __init__(self, name: str, link: ArmLink) -> None:
        self._name, self._link, self.tool = name, link, link.tool

    def read(self) -> Posture:
        """Return the mean over half a second; raises UnsteadyError, DeviceError."""
        angles, end = [], clock().now() + LISTEN
        for batch in self._link.batches():
            if batch.stream == "joints" and len(batch.time):
                angles.append(batch.values[:, : len(self._link.model.joints)])
            if clock().now() > end:
                break
        if not angles:
            raise DeviceError(f"{self._name}: the controller is silent")
        poses = np.array([self._link.model.tip(q, self.tool)[0] for q in np.concatenate(angles).tolist()])
        tip = mean_pose(poses[:, :3, 3], np.array([rotation_vector(pose[:3, :3]) for pose in poses]))
        return Posture(tip, tip @ np.linalg.inv(self.tool))


@contextmanager
def observed_by_hand(name: str, connection: AbstractContextManager[Link]) -> Iterator[HandReader]:
    """Yield a reader of any arm that is observed by a connection; raises DeviceError."""
    from palpate_arms.arm_link import ArmLink

    with connection as link:
        assert isinstance(link, ArmLink)
        yield _ObservedArm(name, link)
