"""The start of a record: in air, or already in contact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from palpate import Samples
from palpate_kit.numerics.refusal import NotFitted

from palpate_fits.segments import passage
from palpate_fits.unknowns import Unknowns

# Rise of chi square from which on no surface above the first sample explains the way in. A constant force alone reaches
# 15 once in 1000 records; air that passes for contact costs certainty, and the opposite the truth.
AIR_EVIDENCE = 25.0
FORCE_ROUNDING = 1e-5  # of the range of the force: residual of a record without noise
FEWEST = 5  # samples for each unknown

# Of samples and unknowns: sum of squares [N^2] that a fit leaves, and how many independent samples that is of.
Misfit = Callable[[Samples, Unknowns], tuple[float, float]]


def begins_in_contact(samples: Samples, unknowns: Unknowns, misfit: Misfit) -> bool:
    """Return True if nothing shows that a record begins in air: likelihood ratio of two surfaces on the way in.

    A force that nobody has zeroed has a rise where a contact detector looks for the first touch, though the tip touched
    before. Contact from the start is the same fit with the surface at the first sample or above. Raises NotFitted where
    the tip never touches.
    """
    course, surface = passage(samples), unknowns.items[unknowns.index("surface")]
    if samples.contact[0]:
        return True
    deepest = int(np.argmin(np.where(course.cycle <= 1, samples.position, np.inf)))
    approach = touching_from_start(samples)[: deepest + 1]
    approach = approach[np.isfinite(approach.force)]
    if not surface.free or len(approach) < FEWEST * len(unknowns.free):
        return False
    above = unknowns.changed("surface", lower=max(surface.lower, float(approach.position.max())))
    try:
        (squares, independent), (squares_above, _) = misfit(approach, unknowns), misfit(approach, above)
    except NotFitted:
        return False
    rounding = len(approach) * (FORCE_ROUNDING * float(np.ptp(approach.force))) ** 2
    return independent * (squares_above - squares) < AIR_EVIDENCE * max(squares, rounding)


def touching_from_start(samples: Samples) -> Samples:
    """Return the samples with all of them before the first touch in contact, and active where that touch is."""
    contact, active = samples.contact.copy(), samples.active.copy()
    first = int(np.argmax(contact))
    contact[:first], active[:first] = True, active[first]
    return replace(samples, contact=contact, active=active)
