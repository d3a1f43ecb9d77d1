"""Motions of the tip."""

from palpate import Trajectory, plugin

from palpate_trajectories.excitation import Chirp, MultiSine
from palpate_trajectories.from_file import FromFile
from palpate_trajectories.grid_points import GridPoints
from palpate_trajectories.line_sweep import LineSweep
from palpate_trajectories.load_unload import Compression, LoadUnload
from palpate_trajectories.point import Point
from palpate_trajectories.raster import Raster
from palpate_trajectories.shake import Shake
from palpate_trajectories.stay import Stay


@plugin
def palpate_trajectories() -> dict[str, type[Trajectory]]:
    """Motions."""
    return {
        "point": Point,
        "load-unload": LoadUnload,
        "compression": Compression,
        "multi-sine": MultiSine,
        "chirp": Chirp,
        "line-sweep": LineSweep,
        "raster": Raster,
        "grid-points": GridPoints,
        "from-file": FromFile,
        "shake": Shake,
        "stay": Stay,
    }
