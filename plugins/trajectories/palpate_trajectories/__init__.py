"""Motions of the tip."""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader
from palpate import Command, plugin

if TYPE_CHECKING:
    from palpate_trajectories.excitation import Chirp, MultiSine
    from palpate_trajectories.force_hold import ForceHold
    from palpate_trajectories.grid_points import GridPoints
    from palpate_trajectories.lifted_motion import LiftedTrajectory
    from palpate_trajectories.line_sweep import LineSweep
    from palpate_trajectories.load_unload import Compression, LoadUnload
    from palpate_trajectories.point import Point
    from palpate_trajectories.ramp_hold import RampHold
    from palpate_trajectories.raster import Raster
    from palpate_trajectories.shake import Shake
    from palpate_trajectories.stay import Stay
    from palpate_trajectories.translation import TranslatedTrajectory
    from palpate_trajectories.waypoint_file import FromFile

__getattr__, _, _ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "excitation": ["Chirp", "MultiSine"],
        "force_hold": ["ForceHold"],
        "waypoint_file": ["FromFile"],
        "grid_points": ["GridPoints"],
        "lifted_motion": ["LiftedTrajectory"],
        "line_sweep": ["LineSweep"],
        "load_unload": ["Compression", "LoadUnload"],
        "translation": ["TranslatedTrajectory"],
        "point": ["Point"],
        "ramp_hold": ["RampHold"],
        "raster": ["Raster"],
        "shake": ["Shake"],
        "stay": ["Stay"],
    },
)

__all__ = [
    "Chirp",
    "Compression",
    "ForceHold",
    "FromFile",
    "GridPoints",
    "LiftedTrajectory",
    "LineSweep",
    "LoadUnload",
    "MultiSine",
    "Point",
    "RampHold",
    "Raster",
    "Shake",
    "Stay",
    "TranslatedTrajectory",
]


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
