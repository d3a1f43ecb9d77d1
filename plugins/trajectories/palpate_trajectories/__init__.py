"""Motions of the tip."""

from palpate import Trajectory, plugin

from palpate_trajectories.point import Point
from palpate_trajectories.shake import Shake


@plugin
def palpate_trajectories() -> dict[str, type[Trajectory]]:
    """Motions."""
    return {"point": Point, "shake": Shake}
