"""A recorded run without a log, from its table of estimates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from palpate import Estimates, LogError, Parameter, Run, Samples, Status
from palpate_engine import RESULT
from palpate_kit.runs.run_folder import EstimatesTable, RunFolder, TrackTable

from palpate_live.live_feed import PageFeed
from palpate_live.recorded_skin import skin_and_extent

_ROWS_AT_ONCE = 500  # that are sent together: a choice


@dataclass(frozen=True)
class RecordedRun:
    """The content of a run folder without a log."""

    run: Run
    online: EstimatesTable
    offline: EstimatesTable | None
    result: Mapping[str, Any]


def read_tables(source: Path) -> RecordedRun | None:
    """Return the run of a folder by its tables of estimates; None where it has a log, or no table.

    The online table has the samples and the tracks that were estimated during the run, another one offline tracks.
    Raises LogError for a damaged table, or without a result.
    """
    folder = RunFolder(source)
    if not source.is_dir() or any(source.glob("*.mcap")):
        return None
    online = folder.online_table
    if online is None:
        return None
    if not (source / RESULT).is_file():
        raise LogError(f"{source}: has neither a log nor a result: `palpate report {source}` shows what it contains")
    result = folder.result
    offline = [table for table in folder.tables if table.path != online.path]
    tracks: dict[str, tuple[Parameter, ...]] = {}
    for table in (online, *offline):
        for track in table.tracks:
            tracks[track] = _parameters(table.track(track), result["tracks"].get(track, {}))
    surface, extent = skin_and_extent(source)
    name = result["run"]["name"]
    run = Run(source, streams={}, tracks=tracks, facts={}, documents={}, name=name, extent=extent, surface=surface)
    return RecordedRun(run, online, next(iter(offline), None), result)


def _parameters(table: TrackTable, track_result: Mapping[str, Any]) -> tuple[Parameter, ...]:
    """Return the parameters of a track's table, with the units of its result; without a unit if it has none there."""
    units = {name: parameter["unit"] for name, parameter in track_result.get("parameters", {}).items()}
    return tuple(Parameter(name, "", units.get(name, ""), "") for name in table.values)


def send_recorded_run(recorded: RecordedRun, feed: PageFeed) -> bool:
    """Send all of a recorded run to the page by its feed: samples, estimates, health of the devices, result.

    The order is that of a live run. Return True: the end is always reached.
    """
    tracks = {track: recorded.online.track(track) for track in recorded.online.tracks}
    samples = _samples(recorded.online, list(tracks.values()))
    estimates = {track: _estimates(table) for track, table in tracks.items()}
    for first in range(0, len(samples), _ROWS_AT_ONCE):
        rows = slice(first, first + _ROWS_AT_ONCE)
        feed.samples(samples[rows])
        for track, block in estimates.items():
            feed.estimates(track, _cut_estimates(block, rows))
    if recorded.offline is not None:
        for track in recorded.offline.tracks:
            feed.estimates(track, _estimates(recorded.offline.track(track)))
    run_result = recorded.result["run"]
    feed.health(
        {
            "streams": recorded.result["streams"],
            "devices": run_result.get("live", {}).get("devices", {}),
            "tare": run_result["tare"],
        }
    )
    feed.result(recorded.result)
    return True


def _samples(table: EstimatesTable, tracks: list[TrackTable]) -> Samples:
    """Return the samples of a table: in contact where some track was not idle."""
    measured = table.measured
    time = measured["time"]
    is_tracked = [(track.status & int(Status.IDLE)) == 0 for track in tracks]
    contact = np.any(is_tracked, axis=0) if is_tracked else np.zeros(len(time), bool)
    return Samples(
        stamp=np.rint(1e9 * time).astype(np.int64),  # [ns]
        time=time,
        interval=np.diff(time, prepend=time[:1]),
        force=measured["force"],
        position=measured["position"],
        velocity=measured["velocity"],
        contact=contact,
        active=contact,
        lateral=table.numbers[:, 1:3],  # x and y [m] follow the time
    )


def _estimates(table: TrackTable) -> Estimates:
    """Return the estimates of a track's table."""
    values, std = (np.column_stack(list(columns.values())) for columns in (table.values, table.std))
    names = ("surface", "surface_std", "force", "nis", "innovation")
    others: dict[str, Any] = {name: table.others[name] for name in names if name in table.others}
    return Estimates(table.time, values, std, status=table.status.astype(np.uint32), **others)


def _cut_estimates(estimates: Estimates, rows: slice) -> Estimates:
    """Return the estimates of some rows."""
    names = ("time", "values", "std", "surface", "surface_std", "force", "nis", "status", "innovation")
    return Estimates(**{name: getattr(estimates, name)[rows] for name in names})
