"""Values outside of what is possible, by more than their uncertainty."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from palpate import Diagnosed, Flag, TrackEvidence

EXPLAINED = 2.0  # combined uncertainties, within which a value beyond a bound is one at the bound


def possible_values(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the finding on each track with an impossible value; order after the whole uncertainty is known."""
    findings = {track.name: Diagnosed(tuple(impossible_values(track))) for track in tracks}
    return {name: finding for name, finding in findings.items() if finding.flags}


def impossible_values(track: TrackEvidence) -> Iterator[Flag]:
    """Yield a flag for each estimate that lies beyond a bound of its parameter; a value held fixed has none."""
    held = track.ending.held if track.ending is not None else frozenset[str]()
    for parameter, value, u in zip(track.model.parameters, track.values.tolist(), track.combined.tolist(), strict=True):
        beyond = max(parameter.lower - value, value - parameter.upper)
        if parameter.name not in held and beyond > EXPLAINED * u:
            text = f"{parameter.name} of {value:.3g} {parameter.unit} is outside what is possible"
            yield Flag("implausible", text, effects={parameter.name: math.inf})
