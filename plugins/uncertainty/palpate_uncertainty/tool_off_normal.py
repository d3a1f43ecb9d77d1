"""The test that the tool stands along the skin's normal, as well as its tip needs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from palpate import Diagnosed, Flag, Indenter, TrackEvidence

# [rad] between tool and normal, beyond which a value is doubtful, and none.
_SPHERE_LIMITS = math.radians(45.0), math.radians(60.0)  # off the normal, between which it is doubtful
_OTHER_LIMITS = math.radians(2.0), math.radians(10.0)  # the same of a tip with an edge


def tool_off_normal(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Of every track whose record has tool and normal: a flag where the angle between them is beyond what is known.

    A sphere touches through its centre at any angle. Any other tip counts as pressed along its axis, at its end: a flat
    one loses 5 % of its force by 2 degrees, and a cone leans on one side.
    """
    found = {track.name: _of(track) for track in tracks}
    return {name: Diagnosed((flag,)) for name, flag in found.items() if flag is not None}


def _of(track: TrackEvidence) -> Flag | None:
    turned = None if track.ending is None else track.ending.report.turned
    tip = getattr(track.model, "indenter", None)
    is_sphere = isinstance(tip, Indenter) and tip.sphere_radius is not None
    doubtful, most = _SPHERE_LIMITS if is_sphere else _OTHER_LIMITS
    if turned is None or turned.tilt <= doubtful:
        return None
    known = f"a {'sphere' if is_sphere else 'tip that is not a sphere'} is known to {math.degrees(doubtful):.0f} deg"
    text = f"the tool stands up to {math.degrees(turned.tilt):.3g} deg off the normal, and {known}"
    return Flag("off-normal", text) if turned.tilt <= most else Flag("far-off-normal", text)
