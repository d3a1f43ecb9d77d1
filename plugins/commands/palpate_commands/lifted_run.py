"""A pipeline whose motion is made above the specimen: ``palpate run --lift 20mm --speed 25%``."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
from palpate import ConfigurationError, ForceControlled, Trajectory, duration_of, setpoints_at, to_si
from palpate_engine import Pipeline, check_motion, single_trajectory

# Choices.
_TIME_STEP = 2e-3  # [s] of the search for the lowest setpoint: the period of a servo loop at 500 Hz
_MIN_HEIGHT = 1e-3  # [m] of the tip above the skin of the work frame
_PERCENT = re.compile(r"\s*([0-9.eE+-]+)\s*%\s*")


def lifted(pipeline: Pipeline, lift: str, speed: str | None) -> Pipeline:
    """Return the same pipeline with its motion at a height above its own.

    Raises ConfigurationError for an invalid height or speed, a tip not clear of the skin, or a broken limit.
    """
    height, pace = _height(lift), _pace(speed)
    motion = single_trajectory(pipeline)
    ((name, _),) = pipeline.trajectories.items()
    if isinstance(motion, ForceControlled):
        raise ConfigurationError(f"--lift: a force leads [trajectory.{name}], and above the specimen no force acts")
    lowest = _lowest(motion)
    if lowest + height < _MIN_HEIGHT:
        raise ConfigurationError(
            f"--lift {lift}: the tip would still go to z = {1e3 * (lowest + height):.1f} mm; at least "
            f"{1e3 * math.ceil(1e3 * (_MIN_HEIGHT - lowest)) / 1e3:g} mm keep it 1 mm above the skin of the work frame"
        )
    part: Any = pipeline.registry.find("trajectory", "lifted-motion")
    lifted_motion = part(of=motion, lift=height, pace=pace)
    if pipeline.safety is not None and (problems := check_motion(lifted_motion, pipeline.safety).problems):
        lines = "\n".join(f"  {problem}" for problem in problems)
        raise ConfigurationError(f"--lift {lift}: the motion up there breaks the limits of [safety]:\n{lines}")
    return replace(pipeline, trajectories={name: lifted_motion})


def _height(text: str) -> float:
    """Return the height [m] of `--lift`; raises ConfigurationError unless it is above 0."""
    try:
        height = to_si(text, "m")
    except ValueError as error:
        raise ConfigurationError(f"--lift {text!r}: {error}; expected a height such as 20mm") from error
    if not (math.isfinite(height) and height > 0):
        raise ConfigurationError(f"--lift {text!r}: expected a height above 0, such as 20mm")
    return height


def _pace(text: str | None) -> float:
    """Return the share of the speed of `--speed`; raises ConfigurationError unless it is above 0 and at most 1."""
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
    """Return the lowest height [m] of a motion."""
    times = np.arange(0.0, duration_of(motion) + _TIME_STEP, _TIME_STEP)
    return float(setpoints_at(motion, times).position[:, 2].min())
