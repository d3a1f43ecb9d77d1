"""A pipeline whose motion is made above the specimen: ``palpate run --lift 20mm --speed 25%``."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
from palpate import ConfigurationError, ForceControlled, Trajectory, duration_of, setpoints_at, to_si
from palpate_engine import Pipeline, check_motion, single_trajectory

_STEP = 2e-3  # [s]
_CLEAR = 1e-3  # [m] that the tip stays above the skin of the work frame
_PERCENT = re.compile(r"\s*([0-9.eE+-]+)\s*%\s*")


def lifted(pipeline: Pipeline, lift: str, speed: str | None) -> Pipeline:
    """The same pipeline with its motion at a height above its own.

    Raises ConfigurationError for an invalid height or speed, a tip not clear of the skin, or a broken limit.
    """
    height, pace = _height(lift), _pace(speed)
    motion = single_trajectory(pipeline)
    ((name, _),) = pipeline.trajectories.items()
    if isinstance(motion, ForceControlled):
        raise ConfigurationError(f"--lift: a force leads [trajectory.{name}], and above the specimen no force acts")
    lowest = _lowest(motion)
    if lowest + height < _CLEAR:
        raise ConfigurationError(
            f"--lift {lift}: the tip would still go to z = {1e3 * (lowest + height):.1f} mm; at least "
            f"{1e3 * math.ceil(1e3 * (_CLEAR - lowest)) / 1e3:g} mm keep it 1 mm above the skin of the work frame"
        )
    part: Any = pipeline.registry.find("trajectory", "lifted-motion")
    there = part(of=motion, lift=height, pace=pace)
    if pipeline.safety is not None and (problems := check_motion(there, pipeline.safety).problems):
        lines = "\n".join(f"  {problem}" for problem in problems)
        raise ConfigurationError(f"--lift {lift}: the motion up there breaks the limits of [safety]:\n{lines}")
    return replace(pipeline, trajectories={name: there})


def _height(text: str) -> float:
    try:
        height = to_si(text, "m")
    except ValueError as error:
        raise ConfigurationError(f"--lift {text!r}: {error}; expected a height such as 20mm") from error
    if not (math.isfinite(height) and height > 0):
        raise ConfigurationError(f"--lift {text!r}: expected a height above 0, such as 20mm")
    return height


def _pace(text: str | None) -> float:
    if text is None:
        return 1.0
    match = _PERCENT.fullmatch(text)
    try:
        pace = float(match[1]) / 100.0 if match else math.nan
    except ValueError:
        pace = math.nan
    if not 0.0 < pace <= 1.0:
        raise ConfigurationError(f"--speed {text!r}: expected more than 0 % and at most 100 % of the motion's own")
    return pace


def _lowest(motion: Trajectory) -> float:
    """The lowest height [m] of a motion."""
    times = np.arange(0.0, duration_of(motion) + _STEP, _STEP)
    return float(setpoints_at(motion, times).position[:, 2].min())
