"""Criteria of a lump, and the properties that are found of one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from palpate import Floats

# A lump of one small body is some 10 mm wide, the width of the contact; both limits are choices, and give a warning.
_LONG = 18e-3  # [m] beyond which a lump may be two: less than twice that width
_LONG_OVER_WIDE = 1.5  # beyond which a wider lump is not round

SweepMethod = Literal["prominence", "cusum"]


@dataclass(frozen=True)
class LumpSettings:
    """The criteria of a lump."""

    rate: float = 0.005  # false-discovery rate; without a lump, the chance of finding one: one in 200, a choice
    contrast: float = 0.04  # smaller ones are not reported, however significant: a choice
    spread: float = 0.005  # standard deviation of the stiffness between sites that is always assumed, relative
    width: float = 4e-3  # [m] of a site: of the order of the contact's diameter
    method: SweepMethod = "prominence"  # along a sweep


@dataclass(frozen=True)
class Lump:
    """A place that is stiffer than its surroundings."""

    place: tuple[float, float]  # [m] its middle
    extent: tuple[float, float]  # [m] at half its height: along and across a sweep, or along x and y
    contrast: float  # peak over surroundings, minus 1
    contrast_std: float
    p: float  # the chance of one like it where none is
    along: float = float("nan")  # [m] its middle along a sweep
    checked: bool = False  # palpated at a point of it, too
    highest: tuple[float, float] | None = None  # [m] where the contrast is; the middle of a horseshoe is its hole
    height: float | None = None  # [m] z of its middle, on a surface
    axes: tuple[float, float] = (0.0, 0.0)  # [m] extent along its longest direction, and across it; of an area

    @property
    def may_be_two(self) -> bool:
        """True where it is longer than one body as wide as it is would be."""
        long, wide = self.axes
        return long > max(_LONG, _LONG_OVER_WIDE * wide)


@dataclass(frozen=True)
class LumpPower:
    """The weakest lump of a width that a sweep shows with a probability."""

    contrast: float
    width: float  # [m] at half its height
    probability: float


@dataclass(frozen=True)
class Findings:
    """The lumps of a run, and how they were found."""

    lumps: tuple[Lump, ...]
    background: float  # [SI]
    spread: float  # relative, between sites or along the sweep
    method: str
    coordinate: Floats | None = None  # (m,) [m] along a sweep
    curve: Floats | None = None  # (m,) [SI] smoothed along it
    power: LumpPower | None = None  # of a sweep, where it is known
    several: float | None = None  # share of the sites that the background is, where they are not one population

    @property
    def warning(self) -> str | None:
        """The doubts: a background that had to be chosen, and lumps that may be two; None without any."""
        doubts = []
        if self.several is not None:
            doubts.append(
                f"the sites are not one population with a few lumps: the {100 * self.several:.0f} % of them about the "
                "lowest common value are taken as the background"
            )
        for lump in self.lumps:
            if lump.may_be_two:
                x, y, long, wide = (1e3 * size for size in (*lump.place, *lump.axes))
                doubts.append(
                    f"the lump at ({x:.1f}, {y:.1f}) mm is {long:.0f} mm long and {wide:.0f} mm wide: may be two"
                )
        return "; ".join(doubts) or None
