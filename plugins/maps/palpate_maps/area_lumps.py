"""Lumps of an area: where its sites are stiff, and the bodies that explain them together with the background."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from palpate_maps.baseline_sites import Baseline, background_sites, prediction_p
from palpate_maps.body_field import BodyFit, SiteField
from palpate_maps.body_lumps import body_lump
from palpate_maps.body_search import MAX_BODIES, explain, lump_members
from palpate_maps.exclusion import Places, excluded_lumps, site_directions
from palpate_maps.lump_criteria import MIN_SITES, Findings, LumpSettings
from palpate_maps.lump_power import WIDTH
from palpate_maps.site_lumps import is_visit, is_wide, lump_of_sites, neighbour_reach, stiff_groups
from palpate_maps.sites import Sites, merge_sites, site_numbers
from palpate_maps.stiffness_field import near

_NOWHERE = np.zeros((0, 2))
_ROUNDS = 4  # of fits and of looks at what they leave: a choice, two are enough on most fields


def lumps_of_area(sites: Sites, settings: LumpSettings, places: Places | None = None) -> Findings:
    """Return the lumps of an area: sites outside the prediction interval of the baseline, joined, and fitted.

    False discoveries are controlled. Background and bodies are then fitted together; what they leave may be further
    lumps, and a lump that the others and the background explain is dropped. A stiff part of the area that few bodies
    do not explain is a lump by its sites alone. Lumps are excluded at `places` of the area, by default between the
    sites. Spreads are those of the logarithm of the stiffness.
    """
    # Groups of stiff sites, each one to be fitted by bodies, or wide: a stiff part of the area.
    coarse = merge_sites(sites, settings.width)
    baseline = background_sites(coarse, settings.spread, settings.width)
    area = _AreaSites(SiteField(sites.place, site_numbers(sites, settings.width), coarse.log), coarse, settings)
    groups: list[NDArray[np.intp]] = []
    wide: list[NDArray[np.intp]] = []
    for group in stiff_groups(coarse, baseline, settings):
        (wide if is_wide(coarse, group, baseline) else groups).append(group)
    fit, wide = area.explain(groups, wide)

    # A lump of each wide group and of each body, and the baseline without the bodies.
    p = prediction_p(coarse.log, baseline)
    lumps = [lump_of_sites(coarse, group, baseline, p) for group in wide]
    if fit is not None:
        points = coarse.place[is_visit(coarse)]
        lumps += [body_lump(fit, members, points, settings.contact_radius) for members in lump_members(fit)]
        # Without the bodies the sites may be one population, which they were not with them.
        if not wide:
            _, baseline = area.remainder(fit, np.arange(len(coarse)))
        baseline = replace(baseline, mean=fit.level, spread=fit.noise)
    lumps = [lump for lump in lumps if lump.p <= settings.rate and lump.contrast >= settings.contrast]

    excluded = excluded_lumps(
        area.field, direction=site_directions(sites), baseline=baseline, lumps=lumps, settings=settings, area=places
    )
    return Findings(
        lumps=tuple(lumps),
        background=float(np.exp(baseline.mean)),
        spread=baseline.spread,
        method=f"prediction interval of {baseline.count} baseline sites",
        power=next((power for power in excluded if power.width == WIDTH), None),
        excluded=excluded,
        fit=fit,
        several=None if baseline.single else float(baseline.members.mean()),
    )


@dataclass(frozen=True)
class _AreaSites:
    """The sites of an area, as fine as they are and merged."""

    field: SiteField
    coarse: Sites
    settings: LumpSettings

    def explain(
        self, groups: list[NDArray[np.intp]], wide: list[NDArray[np.intp]]
    ) -> tuple[BodyFit | None, list[NDArray[np.intp]]]:
        """Return the fit of bodies to groups of sites, None without any, and the groups that need too many.

        Each group has the rows of stiff sites. Groups that are `wide` stand for a stiff part of the area: their sites
        and those on their flanks are left out of the fit.
        """
        fit: BodyFit | None = None
        for _ in range(_ROUNDS):
            # Without the wide groups and their flanks.
            kept = ~near(self.coarse.place, self.coarse.place[np.concatenate(wide)] if wide else _NOWHERE, self._reach)
            groups = [group for group in groups if kept[group].all()]
            rows = np.flatnonzero(kept)
            if not groups or len(rows) < MIN_SITES:
                return None, wide
            row_among_kept = np.cumsum(kept) - 1
            kept_groups = [row_among_kept[group] for group in groups]
            fit, counts = explain(self.field.chosen(kept), kept_groups, self.settings.spread)
            # A group that needs too many bodies is taken out, and the others are fitted again.
            large = [group for group, count in zip(groups, counts, strict=True) if count >= MAX_BODIES]
            if large:
                wide, fit = [*wide, *large], None
                continue
            # What bodies and background leave may be further lumps.
            further, _ = self.remainder(fit, rows)
            if not further:
                break
            groups = groups + further
        return fit, wide

    @property
    def _reach(self) -> float:
        """Distance [m] from a stiff site, up to which one is on its flank."""
        return max(neighbour_reach(self.coarse.place), self.settings.width)

    def remainder(self, fit: BodyFit, rows: NDArray[np.intp]) -> tuple[list[NDArray[np.intp]], Baseline]:
        """Return the groups of stiff sites that a fit to some rows leaves, and the baseline without its bodies."""
        sites = replace(self.coarse[rows], log=fit.level + fit.residual)
        baseline = background_sites(sites, self.settings.spread, self.settings.width)
        return [rows[group] for group in stiff_groups(sites, baseline, self.settings)], baseline
