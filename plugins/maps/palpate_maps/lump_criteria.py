"""Criteria of a lump, and the properties that are found of one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from palpate import Floats

from palpate_maps.body_field import FWHM, Body, BodyFit

# A lump of one small body is some 10 mm wide, the width of the contact; both limits are choices, and give a warning.
_LONG = 18e-3  # [m] beyond which a lump may be two: less than twice that width
_LONG_OVER_WIDE = 1.5  # beyond which a wider lump is not round

MIN_SITES = 8  # of a sweep or an area; fewer have no surroundings: a choice

SweepMethod = Literal["prominence", "cusum"]


@dataclass(frozen=True)
class TrackResponse:
    """The response of a track to a narrow lump: lower, later and longer along the way of the tip than the lump is."""

    height: float = 1.0  # share of a wide lump's height
    lag: float = 0.0  # [m] along the way, in its direction
    blur: float = 0.0  # [m] standard deviation along the way

    def share(self, sigma: float) -> float:
        """Return the height of the response to a Gaussian lump of a standard deviation [m] and height 1."""
        return float(self.height * sigma / np.hypot(sigma, self.blur))

    def shape(self, offset: Floats, direction: Floats, sigma: float) -> Floats:
        """Return the response (...) at offsets (..., k) [m] from the middle of a Gaussian lump of height 1.

        h sigma/w exp(-(along - lag)^2/(2 w^2) - across^2/(2 sigma^2)), w^2 = sigma^2 + blur^2; where the tip stands,
        with a direction (..., k) of zeros, h exp(-d^2/(2 sigma^2)).
        """
        along = (offset * direction).sum(axis=-1)
        across_squared = (offset**2).sum(axis=-1) - along**2
        is_moving = direction.any(axis=-1)
        length = np.where(is_moving, np.hypot(sigma, self.blur), sigma)
        late = np.where(is_moving, along - self.lag, 0.0)
        gaussian = np.exp(-0.5 * (late**2 / length**2 + across_squared / sigma**2))
        return np.asarray(self.height * sigma / length * gaussian)


@dataclass(frozen=True)
class LumpSettings:
    """The criteria of a lump."""

    rate: float = 0.005  # false-discovery rate; without a lump, the chance of finding one: one in 200, a choice
    contrast: float = 0.04  # smaller ones are not reported, however significant: a choice
    spread: float = 0.005  # standard deviation of the stiffness between sites that is always assumed, relative
    width: float = 4e-3  # [m] of a site: of the order of the contact's diameter
    method: SweepMethod = "prominence"  # along a sweep
    contact_radius: float | None = None  # [m] of the tip, whose blur a body's own size is without; None: not known
    response: TrackResponse = TrackResponse()  # of the track, to what an exam excludes


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
    place_std: tuple[float, float] | None = None  # [m] of its middle; None where no body was fitted
    width_std: float | None = None  # relative, of its extents
    size: tuple[float, float] | None = None  # [m] own width without the tip's blur, and its standard deviation
    bodies: tuple[Body, ...] = ()  # that were fitted to it; more that no dip parts may be several lumps

    @property
    def may_be_two(self) -> bool:
        """True where several bodies that no dip parts explain it, or it is longer than one body as wide would be."""
        long, wide = self.axes
        return len(self.bodies) > 1 or long > max(_LONG, _LONG_OVER_WIDE * wide)


# A tip feels the mean over its contact of radius a: by the pressure of Hertz, sqrt(1 - r^2/a^2), its variance along an
# axis is a^2/5, with even weights a^2/4. The middle is taken; its uncertainty is a choice, for a depth that varies.
_BLUR_VARIANCE = (1 / 5 + 1 / 4) / 2  # of a^2
_BLUR_STD = 0.2  # relative, of the blur's standard deviation


def size_without_tip(width: float, width_std: float, contact_radius: float) -> tuple[float, float] | None:
    """Return the width [m] of a body without the blur of a contact [m], and its standard deviation; None below it.

    Variances of Gaussians add: w^2 = w_body^2 + w_tip^2. The blur by the depth of the body remains in it.
    """
    blur = FWHM * np.sqrt(_BLUR_VARIANCE) * contact_radius
    if width <= blur:
        return None
    size = float(np.sqrt(width**2 - blur**2))
    return size, float(np.hypot(width * width_std, _BLUR_STD * blur**2) / size)


@dataclass(frozen=True)
class LumpPower:
    """The weakest lump of a width that an exam shows with a probability."""

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
    power: LumpPower | None = None  # of a lump 10 mm wide, where it is known
    excluded: tuple[LumpPower, ...] = ()  # by width, what would have been found at nearly all places
    response: TrackResponse | None = None  # of the track, to narrow lumps; None where the run does not show it
    lags: str | None = None  # the track, where it does not follow the changes along its path
    fit: BodyFit | None = None  # of an area: the bodies, of which a map has the field
    several: float | None = None  # share of the sites that the background is, where they are not one population

    @property
    def excluded_where(self) -> str:
        """The places at which lumps are excluded, in words."""
        return "away from both ends by a width" if self.coordinate is not None else "at 95 % of the places"

    @property
    def warning(self) -> str | None:
        """The doubts: a track that lags, a background that was chosen, lumps that may be two; None without any."""
        doubts = []
        if self.lags is not None:
            doubts.append(
                f"{self.lags} does not follow the changes along its path: its lumps are doubtful, and none is "
                "excluded; use a filter that follows them, such as kinematic-smoother"
            )
        if self.several is not None:
            doubts.append(
                f"the sites are not one population with a few lumps: the {100 * self.several:.0f} % of them about the "
                "lowest common value are taken as the background"
            )
        for lump in self.lumps:
            if lump.may_be_two:
                x, y, long, wide = (1e3 * size for size in (*lump.place, *lump.axes))
                reason = f"is {long:.0f} mm long and {wide:.0f} mm wide"
                if len(lump.bodies) > 1:
                    reason = f"is explained by {len(lump.bodies)} bodies without a dip between them"
                doubts.append(f"the lump at ({x:.1f}, {y:.1f}) mm {reason}: may be two")
        return "; ".join(doubts) or None
