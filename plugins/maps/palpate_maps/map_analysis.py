"""Maps: from estimates along a way to a map with uncertainty, the lumps in it, and where to look next."""

from palpate_kit.runs.skin_places import surface_of_run

from palpate_maps.baseline_sites import (
    Baseline,
    Comparison,
    against_sites,
    discoveries,
    find_baseline,
    prediction_p,
    welch,
)
from palpate_maps.curve_sites import read_curve_sites
from palpate_maps.lump_criteria import MIN_SITES, Findings, Lump, LumpSettings, SweepMethod
from palpate_maps.lumps import find_lumps
from palpate_maps.map_grid import StiffnessMap, make_map
from palpate_maps.next_places import Knowledge, Proposal, is_placed
from palpate_maps.path_reader import Path2D, read_path, rejected_runs, tracks_of
from palpate_maps.run_lumps import lumps_of_run
from palpate_maps.search_area import Area, area_of
from palpate_maps.search_progress import LumpProgress, footprint, update_progress
from palpate_maps.sites import Sites, line_coordinate, sites_along
from palpate_maps.surface_map import sites_on

__all__ = [
    "MIN_SITES",
    "Area",
    "Baseline",
    "Comparison",
    "Findings",
    "Knowledge",
    "Lump",
    "LumpProgress",
    "LumpSettings",
    "Path2D",
    "Proposal",
    "Sites",
    "StiffnessMap",
    "SweepMethod",
    "against_sites",
    "area_of",
    "discoveries",
    "find_baseline",
    "find_lumps",
    "footprint",
    "is_placed",
    "line_coordinate",
    "lumps_of_run",
    "make_map",
    "prediction_p",
    "read_curve_sites",
    "read_path",
    "rejected_runs",
    "sites_along",
    "sites_on",
    "surface_of_run",
    "tracks_of",
    "update_progress",
    "welch",
]
