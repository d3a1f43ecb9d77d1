"""The lumps of a run: those of its sites, with what the run says of its track and its tip."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from palpate import PalpateError
from palpate_kit.runs.continuation import recorded_pipeline

from palpate_maps.exclusion import Places
from palpate_maps.lump_criteria import Findings, Lump, LumpSettings, TrackResponse
from palpate_maps.lumps import find_lumps
from palpate_maps.path_reader import Path2D
from palpate_maps.sites import Sites
from palpate_maps.track_response import SIGMA, track_response

_MIN_SHARE = 0.5  # of a narrow lump's height, below which a track does not follow it: a choice


def lumps_of_run(
    run: Path, path: Path2D, sites: Sites, settings: LumpSettings | None = None, places: Places | None = None
) -> Findings:
    """Return the lumps of a run's sites, and the lumps that the exam excludes: those it would have found.

    A track responds to a narrow lump with a part of its height, and late; its response is that of the run's own track,
    and says what would have been found. A track that lags, by its verdict or since it shows less than half of a narrow
    lump, excludes nothing, and its lumps are doubtful. `places` are those of the area at which lumps are excluded.
    Raises LogError for a run without sites.
    """
    response = track_response(run, path.track, path.parameter)
    settings = replace(
        settings or LumpSettings(),
        contact_radius=_contact_radius(run, path.track),
        response=response or TrackResponse(),
    )
    findings = replace(find_lumps(sites, settings, places), response=response)
    if response is not None and findings.coordinate is not None:
        findings = replace(findings, lumps=tuple(_with_lag(lump, response.lag) for lump in findings.lumps))
    if path.lags or (response is not None and response.share(SIGMA) < _MIN_SHARE):
        return replace(findings, power=None, excluded=(), lags=path.track)
    return findings


def _with_lag(lump: Lump, lag: float) -> Lump:
    """Return a lump of a sweep, with the lag [m] of its track in the standard deviation of its place along the way.

    Lines of a raster that go to and fro move a lump to either side.
    """
    if lump.place_std is None or not any(lump.place_std):
        return lump
    std = math.hypot(*lump.place_std)
    x, y = (part / std * math.hypot(std, lag) for part in lump.place_std)
    return replace(lump, place_std=(x, y))


def _contact_radius(run: Path, track: str) -> float | None:
    """Return the radius [m] of the contact at the bias of the run's press; None where it has no such motion or tip."""
    try:
        pipeline = recorded_pipeline(run)
    except PalpateError:
        return None
    tip = getattr(pipeline.models.get(track.split("/")[0]), "indenter", None)
    depths = [
        press.bias for motion in pipeline.trajectories.values() if (press := getattr(motion, "press", None)) is not None
    ]
    return float(tip.contact_radius(depths[0])) if tip is not None and depths else None
