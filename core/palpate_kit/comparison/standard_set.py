"""The standard set: simulated scenes on which estimators are compared."""

from __future__ import annotations

from importlib.resources import as_file, files
from pathlib import Path

SCENES = ("sine", "hold", "lumps", "step", "late", "noise", "50Hz", "memory", "tip")  # in the order of the table
SLOW_SCENES = ("filterpy",)  # of shipped estimators that are too slow for all records
# Settings by which a record of a scene has at most 3 s of contact, for a check that takes a moment.
_SHORT_PRESS = ("trajectory.press.duration=3 s", "trajectory.press.standstill=0.5 s")
_SHORT_SWEEP = ("trajectory.sweep.settle=0.5 s",)
SHORT_SETTINGS = {
    **dict.fromkeys(("sine", "late", "noise", "50Hz", "memory", "tip"), _SHORT_PRESS),
    "hold": ("trajectory.press.hold=2 s", "trajectory.press.standstill=0.5 s"),
    "lumps": (*_SHORT_SWEEP, 'trajectory.sweep.start=["0 mm", "-20 mm"]', 'trajectory.sweep.end=["0 mm", "-12 mm"]'),
    "step": (*_SHORT_SWEEP, 'trajectory.sweep.start=["0 mm", "-4 mm"]', 'trajectory.sweep.end=["0 mm", "4 mm"]'),
}


def scene_files(names: tuple[str, ...] = SCENES) -> list[Path]:
    """Return the pipeline files of scenes."""
    with as_file(files("palpate_kit.comparison") / "scenes") as folder:
        return [folder / f"{name}.toml" for name in names]
