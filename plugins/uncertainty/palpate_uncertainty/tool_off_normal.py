"""The test that the tool stands along the skin's normal, as well as its tip needs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from palpate import Diagnosed, Flag, Indenter, TrackEvidence

# They apply to an arm whose orientation over a surface is recorded.
# [rad] between tool and normal, from which on a value is doubtful, and from which on it is invalid.
_SPHERE_LIMITS = math.radians(45.0), math.radians(60.0)  # a choice, of a sphere
_OTHER_LIMITS = math.radians(2.0), math.radians(10.0)  # a choice, of a tip with an edge


def tool_off_normal(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the flag of each track whose tool stands farther off the normal than its tip's law is known for.

    A sphere touches through its centre at any angle. Any other tip counts as pressed along its axis, at its end: a flat
    one loses 5 % of its force by 2 degrees, and a cone leans on one side.
    """
    flags = {track.name: _flag(track) for track in tracks}
    return {name: Diagnosed((flag,)) for name, flag in flags.items() if flag is not None}


def _flag(track: TrackEvidence) -> Flag | None:
    """Return the flag of a track by the largest angle between tool and normal; None within the limit."""
    turned = None if track.ending is None else track.ending.report.turned
    tip = getattr(track.model, "indenter", None)
    is_sphere = isinstance(tip, Indenter) and tip.sphere_radius is not None
    doubtful, invalid = _SPHERE_LIMITS if is_sphere else _OTHER_LIMITS
    if turned is None or turned.tilt <= doubtful:
        return None
    tip_words = "sphere" if is_sphere else "tip that is not a sphere"
    text = (
        f"the tool stands up to {math.degrees(turned.tilt):.3g} deg off the normal, "
        f"and a {tip_words} is known to {math.degrees(doubtful):.0f} deg"
    )
    return Flag("off-normal", text) if turned.tilt <= invalid else Flag("far-off-normal", text)
