"""The verdict on a run: the level of each track with its reasons, and the track that is shown first."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from palpate_engine import verdict_word
from palpate_kit.runs.document_table import table_value

from palpate_report.run_contents import RunContents

_MAX_RESIDUAL_RATIO = 1.5  # to the least residual of the run's tracks, of the track that is shown first: a choice
LEVELS = ("good", "doubtful", "invalid")  # from the best to the worst


def levels_of(levels: Iterable[str]) -> list[str]:
    """Return levels, each once, from the best to the worst; words without a number come before the last."""
    return sorted(set(levels), key=lambda level: (_rank(level), level))


def _rank(level: str) -> float:
    return LEVELS.index(level) if level in LEVELS else len(LEVELS) - 1.5


@dataclass(frozen=True)
class TrackVerdict:
    """The level of one track, and its reasons."""

    track: str
    level: str
    reasons: tuple[str, ...] = ()  # codes of the flags that decide, or a sentence


@dataclass(frozen=True)
class RunVerdict:
    """The level of a run, which is the best of its tracks, and the verdict on every track."""

    level: str
    tracks: tuple[TrackVerdict, ...]
    reasons: tuple[str, ...] = ()
    main: str | None = field(default=None)  # the track that is shown first

    @property
    def levels(self) -> list[str]:
        """The levels of the tracks, from the best to the worst."""
        return levels_of(track.level for track in self.tracks)

    def of(self, level: str) -> list[TrackVerdict]:
        """Return the tracks of one level."""
        return [track for track in self.tracks if track.level == level]


def judge(record: RunContents) -> RunVerdict:
    """Return the verdict on a run, whether it has a result or not.

    `record` is a run folder as far as it can be read. A track is as good as its verdict in ``result.json``. The best
    one is that of the best level, then one whose residual is not much above the least, then of the smallest relative
    uncertainty.
    """
    if record.why_not is not None:
        return RunVerdict(LEVELS[2], tracks=(), reasons=(record.why_not,))
    tables = record.document["tracks"]
    tracks = [_track(name, table) for name, table in tables.items()]
    if not tracks:
        return RunVerdict(LEVELS[2], tracks=(), reasons=("The run has no track.",))
    least_rms = min((rms for table in tables.values() if (rms := table["force_rms"]) is not None), default=0.0)
    best = min(
        tracks,
        key=lambda track: (
            _rank(track.level),
            (tables[track.track]["force_rms"] or math.inf) > _MAX_RESIDUAL_RATIO * least_rms,
            _width(tables[track.track]),
        ),
    )
    return RunVerdict(best.level, tuple(tracks), main=best.track)


def _track(name: str, table: Mapping[str, Any]) -> TrackVerdict:
    worst = table["verdict"]
    level = verdict_word(worst)
    reasons = tuple(dict.fromkeys(flag["code"] for flag in table["flags"] if flag["severity"] == worst))
    return TrackVerdict(name, level, reasons if level != LEVELS[0] else ())


def _width(table: Mapping[str, Any]) -> float:
    """Return the mean relative combined uncertainty of a track: of equally good tracks the smallest comes first."""
    shares = [_relative_std(value) for value in table["parameters"].values()]
    return sum(shares) / len(shares) if shares else math.inf


def _relative_std(value: Mapping[str, Any]) -> float:
    """Return the relative uncertainty of a value, along a path that of one place; infinite where it is not known."""
    std = table_value("", value, "").of_one_place
    return std / abs(value["value"]) if value["value"] and std > 0 else math.inf
