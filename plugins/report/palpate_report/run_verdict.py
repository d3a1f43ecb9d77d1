"""The verdict: whether a run's numbers can be trusted, by which track, and why."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, Literal

import numpy as np
from palpate import ADVICE, TrackName

from palpate_report.figure_data import curves_of, swept
from palpate_report.run_contents import RunContents

Level = Literal["trust it", "look at it", "do not use it"]
LEVELS: tuple[Level, ...] = ("trust it", "look at it", "do not use it")  # from the best to the worst
_APART = 2.0  # combined uncertainties between two tracks of one model
_COLOURED = 0.3  # autocorrelation of innovations over the later half of a record; white ones have some 0.03
_PLACES = 0.2  # of a sweep, in which tracks may differ by more


@dataclass(frozen=True)
class TrackVerdict:
    """What to do with one track, and the reasons."""

    track: str
    level: Level
    reasons: tuple[str, ...] = ()  # codes of the flags that decide, or a sentence


@dataclass(frozen=True)
class RunVerdict:
    """What to do with a run: the best verdict of its tracks, and the verdict on every track."""

    level: Level
    tracks: tuple[TrackVerdict, ...]
    reasons: tuple[str, ...] = ()
    main: str | None = field(default=None)  # the track that is shown first

    def of(self, level: Level) -> list[TrackVerdict]:
        """The tracks of one level."""
        return [track for track in self.tracks if track.level == level]


def judge(record: RunContents) -> RunVerdict:
    """The verdict on a run, whether it has a result or not.

    A track is as good as the worst severity among its flags. A value without a known uncertainty, and a track that
    others of its model contradict, are to be looked at, whatever their flags.
    """
    if record.why_not is not None:
        return RunVerdict(LEVELS[2], (), (record.why_not,))
    tables = record.document["tracks"]
    tracks = [_track(name, table) for name, table in tables.items()]
    if not tracks:
        return RunVerdict(LEVELS[2], (), ("The run has no track.",))
    against = contradicted_tracks(record, [track.track for track in tracks if track.level == LEVELS[0]])
    tracks = [
        TrackVerdict(track.track, LEVELS[1], (against[track.track],)) if track.track in against else track
        for track in tracks
    ]
    best = min(tracks, key=lambda track: (LEVELS.index(track.level), _width(tables[track.track])))
    return RunVerdict(best.level, tuple(tracks), (), best.track)


def _track(name: str, table: Mapping[str, Any]) -> TrackVerdict:
    worst = table["verdict"]
    reasons = tuple(dict.fromkeys(flag["code"] for flag in table["flags"] if flag["severity"] == worst))
    level: Level = ADVICE[worst]  # type: ignore[assignment]
    unknown = [
        key for key, found in table["parameters"].items() if found["value"] is None or found.get("combined") is None
    ]
    if level == LEVELS[0] and unknown:
        return TrackVerdict(name, LEVELS[1], (f"the uncertainty of {', '.join(unknown)} is not known",))
    shares = table.get("diagnoses", {}).get("innovations", {}).get("autocorrelation", ())
    if level == LEVELS[0] and (most := max(map(abs, shares), default=0.0)) > _COLOURED:
        return TrackVerdict(name, LEVELS[1], (f"its innovations correlate by {most:.2g}: the model misses something",))
    return TrackVerdict(name, level, reasons if level != LEVELS[0] else ())


def contradicted_tracks(record: RunContents, trusted: Sequence[str]) -> dict[str, str]:
    """Of the trusted tracks those that others of their model contradict, each with a sentence.

    Two tracks contradict each other where they lie further apart than twice the larger combined uncertainty: at a
    point their values, on a sweep their estimates in more than a fifth of the places. The one with which most others
    disagree is named; where two contradict each other, both are.
    """
    pairs = {
        (first, second): names
        for first, second in combinations(trusted, 2)
        if TrackName.parse(first).model == TrackName.parse(second).model and (names := _apart(record, first, second))
    }
    found: dict[str, str] = {}
    while pairs:
        count = Counter(name for pair in pairs for name in pair)
        most = max(count.values())
        for name in [name for name in trusted if count[name] == most]:
            others = [pair[1 - pair.index(name)] for pair in pairs if name in pair]
            what = dict.fromkeys(key for pair, names in pairs.items() if name in pair for key in names)
            found[name] = f"contradicts {', '.join(others)} in {', '.join(what)}"
        pairs = {pair: names for pair, names in pairs.items() if not found.keys() & set(pair)}
    return found


def _apart(record: RunContents, first: str, second: str) -> list[str]:
    """Parameters in which two tracks contradict each other."""
    one, other = (record.document["tracks"][name]["parameters"] for name in (first, second))
    curves = [curves_of(record, name) for name in (first, second) if name in record.tracks]
    along = len(curves) == 2 and any(swept(curve.place) for curve in curves)
    found = []
    for name in [name for name in one if name in other]:
        allowed = _APART * max(_of_a_place(one[name]), _of_a_place(other[name]))
        distance: Any = abs(one[name]["value"] - other[name]["value"])
        if along:
            rows = curves[0].settled
            second_values = np.interp(
                curves[0].time[rows], curves[1].time, np.where(curves[1].used, curves[1].values[name], np.nan)
            )
            distance = np.abs(curves[0].values[name][rows] - second_values)
            distance = np.nanquantile(distance, 1 - _PLACES) if np.isfinite(distance).any() else 0.0
        if distance > allowed:
            found.append(name)
    return found


def _of_a_place(found: Mapping[str, Any]) -> float:
    """Combined uncertainty without how the places of a sweep differ, which is no error; 0 where it is not known."""
    combined, places = found.get("combined") or 0.0, found.get("systematic_places") or 0.0
    return math.sqrt(max(combined**2 - places**2, 0.0))


def _width(table: Mapping[str, Any]) -> float:
    """Mean relative combined uncertainty of a track's parameters: of equally good tracks the narrowest comes first."""
    shares = [
        (_of_a_place(found) or float("inf")) / abs(found["value"]) if found["value"] else float("inf")
        for found in table["parameters"].values()
    ]
    return sum(shares) / len(shares) if shares else float("inf")
