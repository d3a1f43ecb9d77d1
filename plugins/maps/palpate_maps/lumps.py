"""Lumps: places that are significantly stiffer than their surroundings, along a sweep or on an area."""

from __future__ import annotations

from dataclasses import replace

from palpate import LogError

from palpate_maps.area_lumps import lumps_of_area
from palpate_maps.cusum import by_cusum
from palpate_maps.exclusion import Places
from palpate_maps.line_peaks import by_prominence, curve_along
from palpate_maps.lump_criteria import MIN_SITES, Findings, LumpSettings
from palpate_maps.sites import Sites, line_coordinate


def find_lumps(sites: Sites, settings: LumpSettings | None = None, places: Places | None = None) -> Findings:
    """Return the lumps along a sweep where the sites lie on a line, else on the area that they cover.

    `settings` are the criteria of a lump. Sites at all of which the tip stood still are an area even on a line: they
    have no way along which a filter is late. Of an area, the lumps that its sites exclude are computed at `places`, by
    default those between the sites. Raises LogError for too few sites.
    """
    settings = settings or LumpSettings()
    # What the relief of the surface makes of the stiffness between sites counts as a difference between them.
    settings = replace(settings, spread=max(settings.spread, sites.relief))
    if len(sites) < MIN_SITES:
        raise LogError(
            f"{len(sites)} sites are too few to distinguish a lump from its surroundings; {MIN_SITES} are needed"
        )
    along = line_coordinate(sites)
    is_sweep = along is not None and not sites.standing.all()
    if is_sweep and along is not None:
        curve = curve_along(sites, along, settings)
        return by_cusum(curve, settings) if settings.method == "cusum" else by_prominence(curve, settings)
    return lumps_of_area(sites, settings, places)
