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
AIR_EVIDENCE = 25.0  # chi square of one degree of freedom; 5 sigma (choice)
FORCE_ROUNDING = 1e-5  # of the range of the force (choice): residual of a record without noise
MIN_SAMPLES = 5  # for each unknown (choice)

# From samples and unknowns: the sum of squared residuals of a fit [N^2], and how many independent samples it is of.
Misfit = Callable[[Samples, Unknowns], tuple[float, float]]


def begins_in_contact(samples: Samples, unknowns: Unknowns, misfit: Misfit) -> bool:
    """Return True if nothing shows that a record begins in air: likelihood ratio of two surfaces on the way in.

    A force that nobody has zeroed has a rise where a contact detector looks for the first touch, though the tip touched
    before. So the way in to the deepest point is fitted twice: with the surface anywhere, and at the first sample or
    above it, which is contact from the start. `misfit` returns the sum of squares [N^2] of such a fit, and the number
    of its independent residuals. With sums of squares S and S_above of n independent residuals the ratio is
    chi^2 = n (S_above - S)/S; the record begins in air where it is at least 25. Raises NotFitted where the tip never
    touches.
    """
    course = passage(samples)
    if samples.contact[0]:
        return True
    # The way in of the first cycle, all of it taken as contact.
    deepest = int(np.argmin(np.where(course.cycle <= 1, samples.position, np.inf)))
    approach = touching_from_start(samples)[: deepest + 1]
    approach = approach[np.isfinite(approach.force)]
    surface = unknowns.items[unknowns.index("surface")]
    if not surface.free or len(approach) < MIN_SAMPLES * len(unknowns.free):
        return False
    surface_above = unknowns.changed("surface", lower=max(surface.lower, float(approach.position.max())))
    try:
        squares, independent_samples = misfit(approach, unknowns)
        squares_above, _ = misfit(approach, surface_above)
    except NotFitted:
        return False
    rounding_squares = len(approach) * (FORCE_ROUNDING * float(np.ptp(approach.force))) ** 2
    return independent_samples * (squares_above - squares) < AIR_EVIDENCE * max(squares, rounding_squares)


def touching_from_start(samples: Samples) -> Samples:
    """Return the samples with all before the first touch in contact, and active if the touch is."""
    contact, active = samples.contact.copy(), samples.active.copy()
    touch = int(np.argmax(contact))
    contact[:touch] = True
    active[:touch] = active[touch]
    return replace(samples, contact=contact, active=active)
