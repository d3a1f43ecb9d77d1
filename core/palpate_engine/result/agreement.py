"""Agreement: whether the tracks of one model that can be trusted say the same."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from itertools import combinations

from palpate.flags import Flag

from palpate_engine.result.track_result import TrackResult

_APART = 2.0  # combined uncertainties between two tracks of one model


def contradictions(tracks: Mapping[str, TrackResult]) -> dict[str, Flag]:
    """Of the good tracks those that others of their model contradict, each with a flag.

    Two tracks contradict each other where a value of one is further from the other's than twice the larger combined
    uncertainty. The one with which most others disagree is named; where two contradict each other, both are. Values
    along a sweep differ from place to place and are not compared.
    """
    good = [name for name, track in tracks.items() if track.verdict in ("good", "note") and not _swept(track)]
    pairs = {
        (first, second): apart
        for first, second in combinations(good, 2)
        if tracks[first].model == tracks[second].model and (apart := _apart(tracks[first], tracks[second]))
    }
    flags: dict[str, Flag] = {}
    while pairs:
        count = Counter(name for pair in pairs for name in pair)
        most = max(count.values())
        for name in [name for name in good if count[name] == most]:
            others = [pair[1 - pair.index(name)] for pair in pairs if name in pair]
            effects: dict[str, float] = {}
            for pair, apart in pairs.items():
                if name in pair:
                    effects = {key: max(size, effects.get(key, 0.0)) for key, size in (effects | apart).items()}
            flags[name] = Flag(
                "contradicted", f"{', '.join(others)} finds another {', '.join(effects)}", effects=effects
            )
        pairs = {pair: apart for pair, apart in pairs.items() if not flags.keys() & set(pair)}
    return flags


def _swept(track: TrackResult) -> bool:
    return any(value.places for value in track.parameters.values())


def _apart(first: TrackResult, second: TrackResult) -> dict[str, float]:
    """By how much the values of two tracks contradict each other, by name."""
    distances = {}
    for name in [name for name in first.parameters if name in second.parameters]:
        one, other = first.parameters[name], second.parameters[name]
        distance = abs(one.value - other.value)
        if distance > _APART * max(one.combined, other.combined):
            distances[name] = distance
    return distances
