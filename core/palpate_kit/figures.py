"""Pictures, drawn without a screen, all in one style: the same picture is the same file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np
from palpate import ConfigurationError, Floats, OutputError
from palpate_engine import whole_file

WIDTHS = {"single": 85.0, "middle": 120.0, "double": 175.0}  # [mm] of the columns of journals
FORMATS = ("png", "svg", "pdf")
_INCH = 25.4  # [mm]
# Choices of the layout.
_HANDLE_WIDTH, _LETTER_WIDTH = 10.0, 1.4  # [mm] of a legend: a line with its blanks, and a letter
_LEGEND_SHARE = 0.8  # of the width of a panel, that a legend may take
_NEAR_DEVIATIONS, _NEAR_SHARE = 4, 0.5  # median distances from the middle, and share of it, within which curves count
_SHOWN_QUANTILES = (0.01, 0.99)  # of the values, that are within the axes
_MARGIN, _MIN_MARGIN = 0.4, 0.02  # of the range, and of the largest value, outside these
_SMALLEST_MARGIN = 1e-30  # [as the values], of curves that are 0
_QUARTILES = (0.25, 0.5, 0.75)
# Units of forces: how many of it one newton is, and the force [N] from which on it is used, 0.1 of the unit.
_FORCE_UNITS = (("N", 1.0, 0.1), ("mN", 1e3, 1e-4), ("uN", 1e6, 1e-7))
_SMALLEST_FORCE_UNIT = ("nN", 1e9)
_ROW_HEIGHT = 55.0  # [mm] of a row of panels, unless another is given
_BINS = 40  # of a curve of quartiles, unless another number is given
_DATED = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {"Software": None}}


@contextmanager
def style() -> Iterator[None]:
    """Within the context, or a function that it decorates, pictures are drawn in palpate's style.

    Raises ConfigurationError without matplotlib.
    """
    try:
        import matplotlib
    except ImportError as error:
        raise ConfigurationError("pictures need matplotlib: pip install matplotlib") from error
    with matplotlib.rc_context(_settings()):
        yield


@cache
def _settings() -> Any:
    """Return what the style sets; read once, since a page enters it for each of its parts."""
    import matplotlib

    with as_file(files("palpate") / "palpate.mplstyle") as path:
        return matplotlib.rc_params_from_file(path, use_default_template=False)


def figure_of(columns: int = 1, rows: int = 1, width: float = WIDTHS["double"], height: float = _ROW_HEIGHT) -> Any:
    """Return a figure of a width [mm] and its axes (rows, columns), each row of a height [mm]; call it in `style`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width / _INCH, height * rows / _INCH))
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def legend_outside(axes: Any, columns: int = 3) -> None:
    """Draw a legend above the axes, no wider than they are, where it hides no data; none where no curve has a name."""
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        panel_width = axes.figure.get_figwidth() * _INCH / axes.get_subplotspec().get_gridspec().ncols
        entry_width = _HANDLE_WIDTH + _LETTER_WIDTH * max(map(len, labels))
        fitting_columns = int(_LEGEND_SHARE * panel_width // entry_width)
        placement = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.2}
        axes.legend(handles, labels, ncols=max(1, min(columns, fitting_columns, len(labels))), **placement)


def force_unit(size: float) -> tuple[str, float]:
    """Return the unit in which a force of a size [N] is a number of 0.1 to 100, and how many of it one newton is.

    >>> force_unit(0.02)
    ('mN', 1000.0)
    """
    for unit, factor, min_force in _FORCE_UNITS:
        if size > min_force:
            return unit, factor
    return _SMALLEST_FORCE_UNIT


def label_forces(axis: Any, words: str) -> None:
    """Label the y axis of forces [N] that are already drawn, in the unit that shows their digits."""
    unit, factor = force_unit(max(map(abs, axis.get_ylim())))
    axis.yaxis.set_major_formatter(lambda force, _: f"{factor * force:g}")
    axis.set_ylabel(f"{words} [{unit}]")


def common_limits(curves: Sequence[Floats], settled_from: float = 0.5) -> tuple[float, float] | None:
    """Return limits of axes for curves of one quantity, by their later parts; a curve far from most others is cut off.

    So neither the first moments of an estimator nor one that has diverged flatten the others. `settled_from` is the
    share of a curve at its begin that does not count. The limits are quantiles of the others with a margin. None
    without a number.
    """
    finite_curves = [values[np.isfinite(values)] for values in curves]
    settled = [values[int(settled_from * len(values)) :] for values in finite_curves if len(values)]
    if not settled:
        return None
    # Curves whose median is near to that of all.
    medians = np.array([np.median(values) for values in settled])
    centre = float(np.median(medians))
    deviation = float(np.median(np.abs(medians - centre)))
    max_distance = _NEAR_DEVIATIONS * deviation + _NEAR_SHARE * abs(centre)
    near = [values for values, median in zip(settled, medians, strict=True) if abs(median - centre) <= max_distance]
    low, high = np.quantile(np.concatenate(near), _SHOWN_QUANTILES).tolist()
    margin = max(_MARGIN * (high - low), _MIN_MARGIN * max(abs(low), abs(high)), _SMALLEST_MARGIN)
    return low - margin, high + margin


def quartiles(x: Floats, y: Floats, bins: int = _BINS) -> tuple[Floats, Floats]:
    """Return medians (b,) of bins of x with equally many points, and quartiles and median of y in each (3, b).

    For points that would be a hairball as a curve, such as residuals over depth.
    """
    is_finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[is_finite], y[is_finite]
    order = np.argsort(x, kind="stable")
    rows_of_bins = [rows for rows in np.array_split(order, bins) if len(rows)]
    if not rows_of_bins:
        return np.zeros(0), np.zeros((3, 0))
    medians = np.array([np.median(x[rows]) for rows in rows_of_bins])
    return medians, np.array([np.quantile(y[rows], _QUARTILES) for rows in rows_of_bins]).T


def save_figure(figure: Any, path: Path) -> None:
    """Write a picture, PNG, SVG or PDF by its name; the same picture is the same file. Raises OutputError."""
    ending = path.suffix.removeprefix(".").lower()
    if ending not in FORMATS:
        raise OutputError(f"{path}: a picture's name ends in .{', .'.join(FORMATS)}")
    try:
        with style(), whole_file(path, binary=True) as file:
            figure.savefig(file, metadata=_DATED[ending], format=ending)
    except (OSError, ValueError) as error:
        raise OutputError(f"{path}: cannot write: {error}") from error
