"""Limits and fallback values that the steps of all filters share."""

from __future__ import annotations

MISSING_ABOVE = 1e300  # a choice near the largest double; CasADi folds z == z to 1, so |z| <= this is the test for NaN
DEPTH_FLOOR = 1e-5  # [m], a choice: Jacobians are taken no nearer to 0, where the slope of sqrt(d) has a pole
MAX_LOW_SAMPLES = 25  # a choice: consecutive samples at depth <= 0, in contact, after which a filter restarts
MAX_DEPTH = 0.1  # [m], a choice: a filter whose depth exceeds this has diverged
UNKNOWN_FORCE_STD = 1.0  # [N], a choice: uncertainty of a missing force, 20 times the default noise of the force
RESUME_STD = 1e-4  # [m], a choice: how far the surface may have moved in a pause, added to the depth's uncertainty
FIT_SPREAD = (
    10.0  # a choice: the filter sees the fitted samples again, so it takes a hundredth of their weight from the fit
)
SMALLEST_VARIANCE = 1e-300  # a choice: keeps quotients of variances finite, and changes none that a filter has
