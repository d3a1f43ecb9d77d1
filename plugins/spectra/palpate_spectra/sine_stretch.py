"""The stretch of a record in which its motion is a sum of sines: without an approach, a smooth start and a way back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from palpate import ConfigurationError, Floats

from palpate_spectra.spectral_lines import MIN_EXPLAINED_SHARE, design_matrix, find_lines

# Choices.
_MIDDLE_SHARES = (0.3, 0.8)  # of a record, which begins with an approach and may end with a way back
_MIN_STRETCH_SHARE = 0.6  # of a record, that its sines last: shorter ones are one step of a motion in steps
_BLOCK_PERIODS = 0.5  # of the slowest sine: a stretch grows by blocks as long as that, over which a misfit shows
_MIN_POWER = 1e-300  # [m^2] keeps a division by a power finite


def sine_stretch(time: Floats, height: Floats, frequencies: Sequence[float] | None) -> tuple[slice, Floats] | None:
    """Return the rows in which a motion (n,) [m] is a sum of sines, and their frequencies [Hz], ascending.

    All rows where sines explain the whole record; else those in its middle, and the blocks before and after that
    continue them. Frequencies are found in it unless they are stated. None where sines do not explain the motion;
    raises ConfigurationError where those of stated frequencies do not explain it.
    """
    best_share = 0.0
    middle = slice(*(int(share * len(time)) for share in _MIDDLE_SHARES))
    for part in (slice(0, len(time)), middle):
        lines = np.array(sorted(frequencies)) if frequencies else find_lines(time[part], height[part])
        if lines is None:
            continue
        # Slow sines may describe an approach; in the middle they do not describe the motion then.
        share = min(explained_share(time[rows], height[rows], lines) for rows in (part, middle))
        if not share > MIN_EXPLAINED_SHARE:
            best_share = max(best_share, share)
            continue
        stretch = _extend_stretch(time, height, lines, part)
        if stretch.stop - stretch.start < _MIN_STRETCH_SHARE * len(time):
            continue
        refined_lines = None if frequencies else find_lines(time[stretch], height[stretch])
        return stretch, lines if refined_lines is None else refined_lines
    if frequencies:
        listed = ", ".join(f"{frequency:g}" for frequency in sorted(frequencies))
        raise ConfigurationError(
            f"--frequencies: sines at {listed} Hz explain {100 * best_share:.3g} % of the motion, and "
            f"{100 * MIN_EXPLAINED_SHARE:g} % are needed; leave it out to find them, or record a motion of sines alone"
        )
    return None


def explained_share(time: Floats, height: Floats, frequencies: Floats) -> float:
    """Return the share of a motion's power about its straight trend that sines of frequencies [Hz] explain."""
    t = time - time.mean()
    power = _residual_power(design_matrix(t, []), height)
    return 1.0 - _residual_power(design_matrix(t, frequencies), height) / max(power, _MIN_POWER)


def _residual_power(design: Floats, values: Floats) -> float:
    """Return the sum of the squared residuals of least squares on a design matrix (n, p), for values (n,)."""
    residual = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
    return float(residual @ residual)


def _extend_stretch(time: Floats, height: Floats, frequencies: Floats, part: slice) -> slice:
    """Return the rows of a part of a record and of the blocks before and after it that the part's sines continue."""
    # Sines by the part alone, and their squared misfit over the whole record.
    design = design_matrix(time - time[part].mean(), frequencies)
    coefficients = np.linalg.lstsq(design[part], height[part], rcond=None)[0]
    squared_misfit = (height - design @ coefficients) ** 2
    allowed_misfit = (1.0 - MIN_EXPLAINED_SHARE) * float(np.var(height[part]))

    interval = float(np.median(np.diff(time)))
    block = max(int(_BLOCK_PERIODS / float(frequencies[0]) / interval), 1)  # [samples]
    first, end = part.start, part.stop
    while first - block >= 0 and float(squared_misfit[first - block : first].mean()) < allowed_misfit:
        first -= block
    while end + block <= len(time) and float(squared_misfit[end : end + block].mean()) < allowed_misfit:
        end += block
    return slice(first, end)
