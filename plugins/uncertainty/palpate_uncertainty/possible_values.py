"""Values outside of what is possible, by more than their uncertainty."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from palpate import Diagnosed, Flag, TrackEvidence
from palpate_kit.terminal.quantities import number_with_unit

EXPLAINED = 3.5  # combined uncertainties: one of 4000 values at a bound is beyond by chance
UNDETERMINED = 2.0  # combined uncertainties from a bound (choice), within which a value is not determined by itself


def possible_values(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the finding on each track with an impossible value; order after the whole uncertainty is known."""
    findings = {track.name: Diagnosed(tuple(impossible_values(track))) for track in tracks}
    return {name: finding for name, finding in findings.items() if finding.flags}


def impossible_values(track: TrackEvidence) -> Iterator[Flag]:
    """Yield a flag for each estimate that lies beyond a bound of its parameter; a value held fixed has none.

    Within what chance explains it is a value at the bound, which the record does not determine.
    """
    held = track.ending.held if track.ending is not None else frozenset[str]()
    for parameter, value, u in zip(track.model.parameters, track.values.tolist(), track.combined.tolist(), strict=True):
        beyond = max(parameter.lower - value, value - parameter.upper)
        if parameter.name not in held and beyond > EXPLAINED * u:
            text = f"{parameter.name} of {number_with_unit(value, parameter.unit)} is outside what is possible"
            yield Flag("implausible", text, effects={parameter.name: math.inf})
        elif parameter.name not in held and beyond > UNDETERMINED * u:
            text = f"{parameter.name} is at its bound as far as the record shows"
            yield Flag("undetermined", text, effects={parameter.name: u})
