"""Motions of the tip."""

from palpate import Trajectory, plugin

from palpate_trajectories.point import Point


@plugin
def palpate_trajectories() -> dict[str, type[Trajectory]]:
    """Motions."""
    return {"point": Point}
