"""Motions of the tip."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate import Command, plugin
from palpate_kit.lazy_names import lazy_names

if TYPE_CHECKING:
    from palpate_trajectories.excitation import Chirp as Chirp, MultiSine as MultiSine
    from palpate_trajectories.force_hold import ForceHold as ForceHold
    from palpate_trajectories.grid_points import GridPoints as GridPoints
    from palpate_trajectories.lifted_motion import LiftedTrajectory as LiftedTrajectory
    from palpate_trajectories.line_sweep import LineSweep as LineSweep
    from palpate_trajectories.load_unload import Compression as Compression, LoadUnload as LoadUnload
    from palpate_trajectories.point import Point as Point
    from palpate_trajectories.ramp_hold import RampHold as RampHold
    from palpate_trajectories.raster import Raster as Raster
    from palpate_trajectories.shake import Shake as Shake
    from palpate_trajectories.stay import Stay as Stay
    from palpate_trajectories.translation import TranslatedTrajectory as TranslatedTrajectory
    from palpate_trajectories.waypoint_file import FromFile as FromFile


@plugin
def palpate_trajectories() -> dict[str, str]:
    """Motions."""
    return {
        "point": "palpate_trajectories.point:Point",
        "load-unload": "palpate_trajectories.load_unload:LoadUnload",
        "compression": "palpate_trajectories.load_unload:Compression",
        "ramp-hold": "palpate_trajectories.ramp_hold:RampHold",
        "force-hold": "palpate_trajectories.force_hold:ForceHold",
        "multi-sine": "palpate_trajectories.excitation:MultiSine",
        "chirp": "palpate_trajectories.excitation:Chirp",
        "line-sweep": "palpate_trajectories.line_sweep:LineSweep",
        "raster": "palpate_trajectories.raster:Raster",
        "grid-points": "palpate_trajectories.grid_points:GridPoints",
        "from-file": "palpate_trajectories.waypoint_file:FromFile",
        "shake": "palpate_trajectories.shake:Shake",
        "stay": "palpate_trajectories.stay:Stay",
        "lifted-motion": "palpate_trajectories.lifted_motion:LiftedTrajectory",
        "moved": "palpate_trajectories.translation:TranslatedTrajectory",
    }


@plugin
def palpate_commands() -> dict[str, Command]:
    """Motions looked at before they are made."""
    return {
        "check motion": Command(
            "palpate_trajectories.plan.plan_command:plan", "Preview a motion before running it.", "begin"
        )
    }


__getattr__, __all__ = lazy_names(__name__, *palpate_trajectories().values())
