"""The line of a result that says what was assumed to be exact."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from palpate_engine import Result, TrackResult, verdict_rank

_WORDS = {
    "force_scale": "force",
    "position_scale": "height",
    "indenter.radius": "tip radius",
    "indenter.curvature_radius": "tip radius",
    "poisson": "Poisson's ratio",
    "thickness.height": "thickness",
}
_MIN_PERCENT = 0.05  # per cent of a value by 1 % of an assumption (choice); less is in result.json, not on a screen
_PREFERRED_VALUES = ("elasticity", "stiffness")  # the value that is looked at first, where a track has it
_SECOND = ("viscosity", "damping")


def assumption_lines(result: Result) -> list[str]:
    """Return one line for the run, by its best track; none if no track has assumptions."""
    tracks = [track for track in result.tracks.values() if track.diagnoses.get("assumptions")]
    if not tracks:
        return []
    best = min(tracks, key=lambda track: (verdict_rank(track.verdict), _width(track)))
    return [_line(best.diagnoses["assumptions"])]


def _width(track: TrackResult) -> float:
    """Return the relative combined uncertainty of the first value of a track."""
    shares = [value.combined / abs(value.value) for value in track.parameters.values() if value.value]
    return shares[0] if shares else float("inf")


def _line(table: Mapping[str, Any]) -> str:
    """Return the assumptions of one track: those that scale, then those that are yes or no."""
    values = dict.fromkeys(name for shares in table["percent"].values() for name in shares)
    first = next((name for name in _PREFERRED_VALUES if name in values), next(iter(values)))
    second = next((name for name in _SECOND if name in values), None)
    scales = ", ".join(_scales(table["percent"], first, second))
    conditions = ", ".join(_conditions(table, first))
    both = first if second is None else f"{first}/{second}"
    return f"assumed exact; a 1 % error changes {both} by: {scales}; {conditions}"


def _scales(percent: Mapping[str, Mapping[str, float]], first: str, second: str | None) -> Iterator[str]:
    """Yield name and effects of each number, the largest first; the second value is stated where it differs."""
    sizes = {
        name: [abs(shares.get(value, 0.0)) for value in (first, second) if value] for name, shares in percent.items()
    }
    for name, shown in sorted(sizes.items(), key=lambda item: -max(item[1])):
        if max(shown) > _MIN_PERCENT:
            texts = list(dict.fromkeys(f"{share:.1f}" for share in shown))
            yield f"{_WORDS.get(name, name.replace('_', ' ').replace('.', ' '))} {'/'.join(texts)} %"


def _conditions(table: Mapping[str, Any], first: str) -> Iterator[str]:
    """Yield the assumptions that are not a number of the pipeline, each with the size at which it begins to matter."""
    stiffness, thick = table.get("rigid_above", {}).get(first), table.get("half_space_above")
    yield "rigid mount" + (f" ({_rounded(1e-3 * stiffness)} N/mm: 1 %)" if stiffness else "")
    if not table.get("skin_stated"):
        yield from skin_conditions(table) or ["flat, level skin"]
    if thick:
        yield f"thick specimen ({_rounded(1e3 * thick)} mm: 5 %)"
    if "frequency" in table:
        yield f"{table['frequency']:.2g} Hz only"


def skin_conditions(table: Mapping[str, Any]) -> list[str]:
    """Return the assumed form of the skin, with the size at which it begins to matter; nothing where it is stated.

    >>> skin_conditions({"level_within": 0.0897, "flat_above": 0.25})
    ['level skin (5.1 deg: 1 %)', 'flat skin (radius 250 mm: 1 %)']
    """
    if "level_within" not in table:
        return []
    level, flat = _rounded(math.degrees(table["level_within"])), _rounded(1e3 * table["flat_above"])
    return [f"level skin ({level} deg: 1 %)", f"flat skin (radius {flat} mm: 1 %)"]


def _rounded(number: float) -> str:
    """Return a positive number to two digits, without a power of ten.

    >>> _rounded(206.1), _rounded(0.0234)
    ('210', '0.023')
    """
    return f"{float(f'{number:.2g}'):g}"
