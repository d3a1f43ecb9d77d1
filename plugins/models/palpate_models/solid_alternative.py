"""The modulus by a solid that relaxes, where a model has a gel whose solvent moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from palpate import Condition, Diagnosed, TrackEvidence

from palpate_models.poroelastic import Poroelastic

_INNER_SHARES = (0.1, 0.9)  # of the record in contact, between which its depths count: the ramp to a hold is shorter
# Squared ratio of the largest and the least contact radius, a choice: the gel's relaxation takes twice as long at one.
_MIN_TIME_RATIO = 2.0


def solid_alternative(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the condition of every track with `poroelastic` whose contact keeps about one radius.

    A gel relaxes the more slowly the larger the contact; a solid (Maxwell's arms) does not, and from one hold both
    have the same force. With the lasting force E/(1 - nu_s^2) A(d) of the gel, the modulus of a solid of Poisson's
    ratio nu at all times is E (1 - nu^2)/(1 - nu_s^2). The pipeline states the law, so that no value is doubtful by it.
    """
    diagnoses = {}
    for track in tracks:
        if isinstance(track.model, Poroelastic) and _has_one_radius(track, track.model):
            condition = _condition(track, track.model)
            if condition is not None:
                diagnoses[track.name] = Diagnosed(conditions=(condition,))
    return diagnoses


def _has_one_radius(track: TrackEvidence, model: Poroelastic) -> bool:
    """Return True where a gel's relaxation, whose time goes with the squared radius, takes about as long throughout."""
    depth = (track.surface - track.kept.position)[track.kept.used]
    depth = depth[depth > 0]
    if not len(depth):
        return False
    min_radius, max_radius = (float(model.indenter.contact_radius(d)) for d in np.quantile(depth, _INNER_SHARES))
    return max_radius**2 < _MIN_TIME_RATIO * min_radius**2


def _condition(track: TrackEvidence, model: Poroelastic) -> Condition | None:
    """Return the condition with the shifts of the values; None where the modulus stays within its uncertainty."""
    elasticity, drained_poisson, _ = track.values.tolist()
    ratio = (1.0 - model.poisson**2) / (1.0 - drained_poisson**2)
    shift = (ratio - 1.0) * elasticity
    if not abs(shift) > track.combined[0]:
        return None
    change = f"{100 * abs(ratio - 1.0):.0f} % {'lower' if ratio < 1.0 else 'higher'}"
    return Condition(
        fact="relaxation",
        text=f"it is a gel whose solvent moves (a solid that relaxes: elasticity {change})",
        remedy="hold at two depths, or with two tips",
        shifts={"elasticity": shift, "drained_poisson": model.poisson - drained_poisson},
    )
