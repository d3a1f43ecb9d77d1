"""The parts of a map's uncertainty: its repeatability, and what is of the facts of the rig, common to all places."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from palpate_kit.runs.pipeline_diff import differences
from palpate_kit.runs.result_file import usable_value
from palpate_kit.runs.run_folder import RunFolder

_SYSTEMATIC = "systematic_"  # before a cause, in a value of a result
_OF_RUN = ("tare",)  # causes of which each run has another error
_OF_PLACES = ("places",)  # differences between places, which are not errors
_OF_EXAM = ("palpate", "run", "trajectory", "safety", "sink", "estimator", "sweep", "repeat")  # tables of no fact
_SHOWN = 3  # causes in a sentence
_OF_SPECIMEN = ("specimen", "file", "record")  # keys of a device that are of the specimen or its record


@dataclass(frozen=True)
class RigShare:
    """Standard uncertainties of a parameter, relative to it, that all places of a run have in common."""

    run: float  # of the run itself, another one in a repeat: tare
    causes: dict[str, float]  # of rig and law, by cause: the same in a repeat with the same facts

    @property
    def rig(self) -> float:
        """Of rig and law together."""
        return math.hypot(*self.causes.values())

    def sentence(self, name: str) -> str:
        """Return what of the ± all places have in common, with its largest causes; empty without any."""
        if not self.causes:
            return ""
        largest = sorted(self.causes, key=lambda cause: -self.causes[cause])[:_SHOWN]
        causes = ", ".join(f"{cause.replace('_', ' ')} {100 * self.causes[cause]:.2g}" for cause in largest)
        return f"{name}: of rig and law {100 * self.rig:.2g} %, common to all places ({causes} %)"


def rig_share(run: Path, track: str, parameter: str) -> RigShare:
    """Return the common uncertainties of a run by the budget of its result; none without a result or a value."""
    folder = RunFolder(run)
    result = folder.result["tracks"].get(track) if folder.finished else None
    estimate: dict[str, Any] | None = usable_value(result, parameter) if result is not None else None
    if estimate is None or not estimate["value"]:
        return RigShare(0.0, {})
    shares = {
        key.removeprefix(_SYSTEMATIC): abs(size / estimate["value"])
        for key, size in estimate.items()
        if key.startswith(_SYSTEMATIC) and size is not None
    }
    causes = {cause: share for cause, share in shares.items() if cause not in (*_OF_RUN, *_OF_PLACES) and share > 0}
    return RigShare(math.hypot(*(shares.get(cause, 0.0) for cause in _OF_RUN)), causes)


def fact_differences(run: Path, other: Path) -> str:
    """Return in words which facts of the rig two runs do not share; empty where they share all."""
    runs = [RunFolder(folder) for folder in (run, other)]
    devices = {name for folder in runs for name in folder.settings.get("device", {})}
    ignored = [f"device.{name}.{key}" for name in devices for key in _OF_SPECIMEN]
    return differences(runs[1].pipeline_text, runs[0].pipeline_text, (*_OF_EXAM, *ignored))
