"""Pictures, drawn without a screen: the same picture is the same file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from palpate.errors import ConfigurationError, OutputError
from palpate.writing import whole_file


def figure_of(columns: int, rows: int = 1, width: float = 6.0, height: float = 4.5) -> tuple[Any, Any]:
    """A figure and its axes (rows, columns), each of a size [inch]; raises ConfigurationError without matplotlib."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ConfigurationError("pictures need matplotlib: pip install matplotlib") from error
    figure = Figure(figsize=(width * columns, height * rows), layout="constrained", dpi=120)
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def save_figure(figure: Any, path: Path) -> None:
    """Write a picture, PNG or SVG by its name; the same picture is the same file."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        dated = {"Date": None} if path.suffix == ".svg" else {"Software": None}
        with whole_file(path, binary=True) as file:
            figure.savefig(file, metadata=dated, format=path.suffix.removeprefix(".") or "png")
    except (OSError, ValueError) as error:
        raise OutputError(f"{path}: cannot write: {error}") from error


@contextmanager
def drawing(path: Path) -> Iterator[None]:
    """Turns what can go wrong while a picture is drawn into an OutputError."""
    try:
        yield
    except ImportError as error:
        raise OutputError(f"{path}: drawing wants matplotlib: pip install matplotlib") from error
    except (OSError, ValueError) as error:
        raise OutputError(f"{path}: cannot draw: {error}") from error
