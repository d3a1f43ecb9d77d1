"""The table of the lumps of a run, the same on a terminal and on a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from palpate_kit.terminal.quantities import unsigned
from palpate_kit.terminal.table import Table

LUMP_NOTE = "own size: the width without the tip's blur; the depth of a lump is not known"
_HEADINGS = ("#", "x mm", "y mm", "width mm", "contrast %", "own size mm", "p")
_MIN_P = 1e-99  # a smaller p is shown as below that


def lump_table(lumps: Sequence[Mapping[str, Any]]) -> Table:
    """Return a row for each lump of ``lumps.json``: place, width, contrast and own size, each with ±, and p."""
    rows = []
    for number, lump in enumerate(lumps, 1):
        place_std, size = lump.get("place_std") or (None, None), lump.get("size")
        places = [_length(lump[axis], std) for axis, std in zip("xy", place_std, strict=True)]
        contrast = f"{100 * lump['contrast']:.1f} ± {100 * lump['contrast_std']:.1f}"
        own_size = "" if size is None else _length(size["value"], size["std"])
        rows.append([str(number), *places, _width(lump), contrast, own_size, chance(lump["p"])])
    return Table.of("", _HEADINGS, rows)


def chance(p: float | None) -> str:
    """Return a p-value.

    >>> chance(1e-120)
    '< 1e-99'
    """
    if p is None:
        return "–"
    return f"< {_MIN_P:g}" if p < _MIN_P else f"{p:.2g}"


def _length(length: float, std: float | None) -> str:
    """Return a length with its standard deviation [m], where there is one, in mm."""
    text = unsigned(f"{1e3 * length:.1f}")
    return text if std is None else f"{text} ± {1e3 * std:.1f}"


def _width(lump: Mapping[str, Any]) -> str:
    """Return the width of a round lump with its standard deviation, else its extents, in mm."""
    sizes = [size for size in lump["extent"] if size > 0]
    if len(set(sizes)) == 1:
        stds = lump.get("extent_std")
        return _length(sizes[0], None if stds is None else stds[lump["extent"].index(sizes[0])])
    return " x ".join(_length(size, None) for size in sizes)
