"""The verdict: whether a run's numbers can be trusted, by which track, and why."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from palpate_engine import verdict_word
from palpate_kit.runs.document_table import table_value

from palpate_report.run_contents import RunContents

_MISFIT = 1.5  # times the least residual of the run's tracks: what leaves more is not shown first
LEVELS = ("good", "doubtful", "invalid")  # from the best to the worst


def levels_of(levels: Iterable[str]) -> list[str]:
    """Those levels, each once, from the best to the worst; the words of what has no number before the last."""
    return sorted(set(levels), key=lambda level: (_rank(level), level))


def _rank(level: str) -> float:
    return LEVELS.index(level) if level in LEVELS else len(LEVELS) - 1.5


@dataclass(frozen=True)
class TrackVerdict:
    """What to do with one track, and the reasons."""

    track: str
    level: str
    reasons: tuple[str, ...] = ()  # codes of the flags that decide, or a sentence


@dataclass(frozen=True)
class RunVerdict:
    """What to do with a run: the best verdict of its tracks, and the verdict on every track."""

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

    A track is as good as its verdict in ``result.json``.
    """
    if record.why_not is not None:
        return RunVerdict(LEVELS[2], (), (record.why_not,))
    tables = record.document["tracks"]
    tracks = [_track(name, table) for name, table in tables.items()]
    if not tracks:
        return RunVerdict(LEVELS[2], (), ("The run has no track.",))
    least = min((rms for table in tables.values() if (rms := table["force_rms"]) is not None), default=0.0)
    best = min(
        tracks,
        key=lambda track: (
            _rank(track.level),
            (tables[track.track]["force_rms"] or math.inf) > _MISFIT * least,
            _width(tables[track.track]),
        ),
    )
    return RunVerdict(best.level, tuple(tracks), (), best.track)


def _track(name: str, table: Mapping[str, Any]) -> TrackVerdict:
    worst = table["verdict"]
    level = verdict_word(worst)
    reasons = tuple(dict.fromkeys(flag["code"] for flag in table["flags"] if flag["severity"] == worst))
    return TrackVerdict(name, level, reasons if level != LEVELS[0] else ())


def _width(table: Mapping[str, Any]) -> float:
    """Mean relative combined uncertainty of a track's parameters: of equally good tracks the narrowest comes first."""
    shares = [_relative_std(found) for found in table["parameters"].values()]
    return sum(shares) / len(shares) if shares else math.inf


def _relative_std(found: Mapping[str, Any]) -> float:
    """Return the relative uncertainty of a value, along a path that of one place; infinite where it is not known."""
    std = table_value("", found, "").of_one_place
    return std / abs(found["value"]) if found["value"] and std > 0 else math.inf
