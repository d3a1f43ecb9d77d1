"""Parts that raise, or return malformed estimates, during a run: which one, where, and when."""

from __future__ import annotations

import inspect
import traceback
from dataclasses import dataclass, replace
from types import FrameType
from typing import Any

import numpy as np
from palpate.errors import PalpateError, PluginError, error_in
from palpate.estimation import Estimates, Samples, Status
from palpate.flags import Flag
from palpate.parts import Part
from palpate.registry import Registry
from palpate.vectors import finite_rows, read_only

from palpate_engine.config import Track

_MUTE = Status.IDLE | Status.WAITING | Status.DIVERGED  # of samples that need no number


@dataclass(frozen=True)
class PartFailure:
    """Names the part of a track that has failed."""

    track: Track
    registry: Registry

    def flag(self, error: BaseException, samples: Samples | None = None) -> Flag:
        """Return what ended the track: plugin, part, file, line, time and error.

        Without samples the estimator has done its work, and what is unclear is of the model.
        """
        when = f" between {samples.time[0]:.3f} and {samples.time[-1]:.3f} s" if samples else ""
        unclear = self.track.model if samples is None else self.track.estimator
        return Flag("failed", f"{self.complaint(error, when, unclear)}; this track ends here")

    def complaint(self, error: BaseException, when: str = "", unclear: Part | None = None) -> str:
        """Return ``estimator 'mine' of plugin my_filter.py failed: ValueError: no (my_filter.py, line 12, in run)``.

        The part is that whose code raised, or called what did; `unclear`, or else the estimator, where none is found.
        """
        frames = list(traceback.walk_tb(error.__traceback__))
        part, frame, line = self._culprit(frames) or (unclear or self.track.estimator, *frames[-1])
        return f"{self._named(part)} failed{when}: {error_in(error, frame, line)}"

    def _named(self, part: Part) -> str:
        """Return ``estimator 'mine' of plugin my_filter.py``."""
        entries = self.registry.parts.get(part.kind, {}).items()
        match = next(((name, entry) for name, entry in entries if entry.is_of(type(part))), None)
        if match is None:
            return f"{part.kind} {type(part).__name__}"
        return f"{part.kind} {match[0]!r} of plugin {match[1].plugin.name}"

    def _culprit(self, frames: list[tuple[FrameType, int]]) -> tuple[Part, FrameType, int] | None:
        """Return the part whose code raised, or called what did, and where in it; None where that is unclear."""
        for frame, line in reversed(frames):
            for part in (self.track.model, getattr(self.track.model, "indenter", None), self.track.estimator):
                if isinstance(part, Part) and _is_of(frame, part):
                    return part, frame, line
        return None


def third_party_error(error: Exception, registry: Registry) -> Exception:
    """Return a PluginError that names the third-party plugin whose code raised, or called what did.

    An error of palpate's own code, and one that palpate raised on purpose, is returned as it is.
    """
    strangers = [plugin for plugin in registry.plugins if not plugin.own]
    files = [frame.f_code.co_filename for frame, _ in traceback.walk_tb(error.__traceback__)]
    names = [plugin.name for file in reversed(files) for plugin in strangers if plugin.holds(file)]
    if isinstance(error, PalpateError) or not names:
        return error
    failure = PluginError(f"plugin {names[0]} failed: {error_in(error)}")
    failure.__cause__ = error
    return failure


def _is_of(frame: FrameType, part: Part) -> bool:
    """Return True if a frame runs a part's own method, or, of an estimator, anything in the file of its class."""
    if frame.f_locals.get("self") is part:
        return True
    try:
        return part.kind == "estimator" and frame.f_code.co_filename == inspect.getfile(type(part))
    except (TypeError, OSError):
        return False


def check_estimates(estimates: Any, samples: Samples, parameters: int) -> Estimates:
    """Return estimates of so many parameters, read-only, those that are not numbers marked as diverged.

    Raises TypeError or ValueError where their form is not that of the samples.
    """
    if not isinstance(estimates, Estimates):
        raise TypeError(f"the tracker's run answers {type(estimates).__name__}, not Estimates")
    shape = (len(samples), parameters)
    for name in ("values", "std"):
        actual = np.shape(getattr(estimates, name))
        if actual != shape:
            raise ValueError(f"the tracker's run answers {name} of shape {actual} in place of {shape}")
    is_missing = ~finite_rows(estimates.values) & ((estimates.status & _MUTE) == 0)
    if not is_missing.any():
        return read_only(estimates)
    status = np.where(is_missing, estimates.status | np.uint32(Status.DIVERGED), estimates.status).astype(np.uint32)
    return read_only(replace(estimates, status=status))
