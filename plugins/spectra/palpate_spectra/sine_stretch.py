"""The stretch of a record in which its motion is a sum of sines: without an approach, a smooth start and a way back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from palpate import ConfigurationError, Floats

from palpate_spectra.spectral_lines import LEAST_EXPLAINED, columns_of, lines_of

_MIDDLE = (0.3, 0.8)  # of a record, which begins with an approach and may end with a way back: a choice
_LEAST_SHARE = 0.6  # of a record, that its sines last: less is one step of a motion in steps
_BLOCK_PERIODS = 0.5  # of the slowest sine: a stretch grows by blocks as long as that, over which a misfit shows


def sine_stretch(time: Floats, height: Floats, frequencies: Sequence[float] | None) -> tuple[slice, Floats] | None:
    """Return the rows in which a motion (n,) [m] is a sum of sines, and their frequencies [Hz], ascending.

    All rows where sines explain the whole record; else those in its middle, and the blocks before and after that
    continue them. Frequencies are found in it unless they are stated. None where sines do not explain the motion;
    raises ConfigurationError where those of stated frequencies do not explain it.
    """
    best = 0.0
    middle = slice(*(int(share * len(time)) for share in _MIDDLE))
    for part in (slice(0, len(time)), middle):
        lines = np.array(sorted(frequencies)) if frequencies else lines_of(time[part], height[part])
        if lines is None:
            continue
        # Slow sines may describe an approach; in the middle they do not describe the motion then.
        share = min(explained_share(time[rows], height[rows], lines) for rows in (part, middle))
        if share > LEAST_EXPLAINED:
            rows = _extended(time, height, lines, part)
            if rows.stop - rows.start < _LEAST_SHARE * len(time):
                continue
            refined = None if frequencies else lines_of(time[rows], height[rows])
            return rows, lines if refined is None else refined
        best = max(best, share)
    if frequencies:
        listed = ", ".join(f"{frequency:g}" for frequency in sorted(frequencies))
        raise ConfigurationError(
            f"--frequencies: sines at {listed} Hz explain {100 * best:.3g} % of the motion, and "
            f"{100 * LEAST_EXPLAINED:g} % are needed; leave it out to find them, or record a motion of sines alone"
        )
    return None


def explained_share(time: Floats, height: Floats, frequencies: Floats) -> float:
    """Return the share of a motion's power about its trend that sines explain."""
    t = time - time.mean()
    trend = columns_of(t, [])
    power = _square_rest(trend, height)
    return 1.0 - _square_rest(columns_of(t, frequencies), height) / max(power, 1e-300)


def _square_rest(columns: Floats, values: Floats) -> float:
    """Return the squares that least squares of columns leave of values (n,)."""
    residual = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
    return float(residual @ residual)


def _extended(time: Floats, height: Floats, frequencies: Floats, part: slice) -> slice:
    """Return a part of a record with the blocks on both sides that its sines continue."""
    middle = time[part].mean()
    columns = columns_of(time - middle, frequencies)
    estimate = np.linalg.lstsq(columns[part], height[part], rcond=None)[0]
    misfit = (height - columns @ estimate) ** 2
    allowed = (1.0 - LEAST_EXPLAINED) * float(np.var(height[part]))
    step = float(np.median(np.diff(time)))
    block = max(int(_BLOCK_PERIODS / float(frequencies[0]) / step), 1)
    first, last = part.start, part.stop
    while first - block >= 0 and float(misfit[first - block : first].mean()) < allowed:
        first -= block
    while last + block <= len(time) and float(misfit[last : last + block].mean()) < allowed:
        last += block
    return slice(first, last)
