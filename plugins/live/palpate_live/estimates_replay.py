"""A recorded run without a log, as its table of estimates has it."""

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

_ROWS = 500  # that are sent together


@dataclass(frozen=True)
class RecordedRun:
    """What a run folder without a log has to show."""

    run: Run
    table: EstimatesTable
    offline: EstimatesTable | None
    result: Mapping[str, Any]  # empty where the run was cut


def read_tables(source: Path) -> RecordedRun | None:
    """Return the tables of a run folder; None where it has a log, or no table. Raises LogError for what cannot be
    read."""
    folder = RunFolder(source)
    if not source.is_dir() or any(source.glob("*.mcap")) or (online := folder.online_table) is None:
        return None
    if not (source / RESULT).is_file():
        raise LogError(f"{source}: has neither a log nor a result: `palpate report {source}` shows what it contains")
    result, offline = folder.result, [table for table in folder.tables if table.path != online.path]
    units = {name: {key: part["unit"] for key, part in t["parameters"].items()} for name, t in result["tracks"].items()}
    tracks = {
        name: tuple(Parameter(key, "", units.get(name, {}).get(key, ""), "") for key in table.track(name).values)
        for table in (online, *offline)
        for name in table.tracks
    }
    surface, extent = skin_and_extent(source)
    run = Run(source, {}, tracks, {}, {}, result["run"]["name"], extent=extent, surface=surface)
    return RecordedRun(run, online, next(iter(offline), None), result)


def tell(known: RecordedRun, feed: PageFeed) -> bool:
    """Let the page have all of it; whether it came to its end, as it always does."""
    measured, tracks = known.table.measured, {name: known.table.track(name) for name in known.table.tracks}
    time, place = measured["time"], known.table.numbers[:, 1:3]
    tracked = [(table.status & int(Status.IDLE)) == 0 for table in tracks.values()]
    contact = np.any(tracked, axis=0) if tracked else np.zeros(len(time), bool)
    samples = Samples(
        np.rint(1e9 * time).astype(np.int64),
        time,
        np.diff(time, prepend=time[:1]),
        measured["force"],
        measured["position"],
        measured["velocity"],
        contact,
        contact,
        place,
    )
    estimates = {name: _estimates(table) for name, table in tracks.items()}
    for begin in range(0, len(time), _ROWS):
        rows = slice(begin, begin + _ROWS)
        feed.samples(samples[rows])
        for name, block in estimates.items():
            feed.estimates(name, _rows(block, rows))
    for name in known.offline.tracks if known.offline else ():
        assert known.offline is not None
        feed.estimates(name, _estimates(known.offline.track(name)))
    live = known.result["run"].get("live", {})
    facts = {
        "streams": known.result["streams"],
        "devices": live.get("devices", {}),
        "tare": known.result["run"]["tare"],
    }
    feed.health(facts)
    feed.result(known.result)
    return True


def _estimates(table: TrackTable) -> Estimates:
    values, std = (np.column_stack(list(columns.values())) for columns in (table.values, table.std))
    names = ("surface", "surface_std", "force", "nis", "innovation")
    others: dict[str, Any] = {name: table.others[name] for name in names if name in table.others}
    return Estimates(table.time, values, std, status=table.status.astype(np.uint32), **others)


def _rows(block: Estimates, rows: slice) -> Estimates:
    names = ("time", "values", "std", "surface", "surface_std", "force", "nis", "status", "innovation")
    return Estimates(**{name: getattr(block, name)[rows] for name in names})
