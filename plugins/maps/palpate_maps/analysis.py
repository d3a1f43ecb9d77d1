"""Maps: from estimates along a way to a map with uncertainty, the lumps in it, and where to look next."""

from palpate_maps.area import Area, area_of
from palpate_maps.baseline import Baseline, Comparison, against_sites, discoveries, find_baseline, prediction_p, welch
from palpate_maps.findings import Findings, Lump, LumpSettings, SweepMethod
from palpate_maps.grid import StiffnessMap, make_map
from palpate_maps.lumps import find_lumps
from palpate_maps.path import Path2D, read_path, rejected, tracks_of
from palpate_maps.progress import Watched, nothing_left, off_limits, watched
from palpate_maps.search import Proposal, propose, settled
from palpate_maps.sites import Sites, line_coordinate, sites_along

__all__ = [
    "Area",
    "Baseline",
    "Comparison",
    "Findings",
    "Lump",
    "LumpSettings",
    "Path2D",
    "Proposal",
    "Sites",
    "StiffnessMap",
    "SweepMethod",
    "Watched",
    "against_sites",
    "area_of",
    "discoveries",
    "find_baseline",
    "find_lumps",
    "line_coordinate",
    "make_map",
    "nothing_left",
    "off_limits",
    "prediction_p",
    "propose",
    "read_path",
    "rejected",
    "settled",
    "sites_along",
    "tracks_of",
    "watched",
    "welch",
]
