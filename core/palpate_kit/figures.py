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
_HANDLE, _LETTER = 10.0, 1.4  # [mm] of a legend: a line with its blanks, and a letter
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
    """What the style sets; read once, since a page enters it for each of its parts."""
    import matplotlib

    with as_file(files("palpate") / "palpate.mplstyle") as path:
        return matplotlib.rc_params_from_file(path, use_default_template=False)


def figure_of(columns: int = 1, rows: int = 1, width: float = WIDTHS["double"], height: float = 55.0) -> Any:
    """Return a figure of a width [mm] and its axes (rows, columns), each row of a height [mm]; to be called in the
    style."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width / _INCH, height * rows / _INCH))
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def legend_outside(axes: Any, columns: int = 3) -> None:
    """A legend above the axes, no wider than they are, where it hides no data; nothing where no curve has a name."""
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        panel = axes.figure.get_figwidth() * _INCH / axes.get_subplotspec().get_gridspec().ncols
        fitting = int(0.8 * panel // (_HANDLE + _LETTER * max(map(len, labels))))
        place = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.2}
        axes.legend(handles, labels, ncols=max(1, min(columns, fitting, len(labels))), **place)


def force_unit(size: float) -> tuple[str, float]:
    """Return the unit in which forces of a size [N] show their digits, and how many of it one newton is.

    >>> force_unit(0.02)
    ('mN', 1000.0)
    """
    return ("N", 1.0) if size > 0.1 else ("mN", 1e3) if size > 1e-4 else ("uN", 1e6) if size > 1e-7 else ("nN", 1e9)


def label_forces(axis: Any, words: str) -> None:
    """Label the y axis of forces [N] that are already drawn, in the unit that shows their digits."""
    unit, factor = force_unit(max(map(abs, axis.get_ylim())))
    axis.yaxis.set_major_formatter(lambda force, _: f"{factor * force:g}")
    axis.set_ylabel(f"{words} [{unit}]")


def common_limits(curves: Sequence[Floats], settled_from: float = 0.5) -> tuple[float, float] | None:
    """Limits of axes for curves of one quantity, each by its later part; a curve far from most others is cut off.

    What an estimator does in its first moments, and one that has diverged, so flatten nothing. `settled_from` is the
    share of a curve at its begin that does not count. None without a number.
    """
    known = [values[np.isfinite(values)] for values in curves]
    settled = [values[int(settled_from * len(values)) :] for values in known if len(values)]
    if not settled:
        return None
    middles = np.array([np.median(values) for values in settled])
    centre = float(np.median(middles))
    near = 4 * float(np.median(np.abs(middles - centre))) + 0.5 * abs(centre)
    seen = np.concatenate([v for v, middle in zip(settled, middles, strict=True) if abs(middle - centre) <= near])
    low, high = np.quantile(seen, [0.01, 0.99]).tolist()
    margin = max(0.4 * (high - low), 0.02 * max(abs(low), abs(high)), 1e-30)
    return low - margin, high + margin


def quartiles(x: Floats, y: Floats, bins: int = 40) -> tuple[Floats, Floats]:
    """Middles (b,) of bins of x with equally many points, and quartiles and median of y in each (3, b).

    What would be a hairball as a curve, such as residuals over depth, can be read so.
    """
    known = np.isfinite(x) & np.isfinite(y)
    order = np.argsort(x[known], kind="stable")
    parts = [part for part in np.array_split(order, bins) if len(part)]
    if not parts:
        return np.zeros(0), np.zeros((3, 0))
    x, y = x[known], y[known]
    middles = np.array([np.median(x[part]) for part in parts])
    return middles, np.array([np.quantile(y[part], [0.25, 0.5, 0.75]) for part in parts]).T


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
