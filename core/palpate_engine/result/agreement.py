"""Agreement of the good tracks of one model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from itertools import combinations

from palpate.flags import Flag

from palpate_engine.result.track_result import TrackResult

# It applies where several good tracks of one model stand next to each other.
_MAX_DISTANCE = 2.0  # combined uncertainties between values of two tracks of one model; a choice: 95 %


def contradictions(tracks: Mapping[str, TrackResult]) -> dict[str, Flag]:
    """Return a flag for each of the good tracks that others of their model contradict, by track.

    Two tracks contradict each other where a value of one is further from the other's than twice the larger combined
    uncertainty. The one with which most others disagree is named; where two contradict each other, both are. Values
    along a sweep differ from place to place and are not compared.
    """
    good = [name for name, track in tracks.items() if track.verdict in ("good", "note") and not _is_swept(track)]

    # Pairs of tracks that contradict each other, with the distances of their values.
    pairs: dict[tuple[str, str], dict[str, float]] = {}
    for first, second in combinations(good, 2):
        if tracks[first].model == tracks[second].model:
            distances = _contradictory_distances(tracks[first], tracks[second])
            if distances:
                pairs[first, second] = distances

    # The tracks that most others contradict are named, and their pairs settled, until no pair remains.
    flags: dict[str, Flag] = {}
    while pairs:
        counts = Counter(track for pair in pairs for track in pair)
        largest_count = max(counts.values())
        for name in good:
            if counts[name] == largest_count:
                flags[name] = _contradiction_of(name, pairs)
        pairs = {pair: by_parameter for pair, by_parameter in pairs.items() if not flags.keys() & set(pair)}
    return flags


def _contradiction_of(name: str, pairs: Mapping[tuple[str, str], Mapping[str, float]]) -> Flag:
    """Return the flag of a track with those that contradict it, and the largest distance of each value."""
    contradicting: list[str] = []
    effects: dict[str, float] = {}
    for pair, distances in pairs.items():
        if name in pair:
            contradicting.append(pair[1 - pair.index(name)])
            for parameter, distance in distances.items():
                effects[parameter] = max(distance, effects.get(parameter, 0.0))
    return Flag("contradicted", f"{', '.join(contradicting)} finds another {', '.join(effects)}", effects=effects)


def _is_swept(track: TrackResult) -> bool:
    """Return True if values of a track differ from place to place."""
    return any(value.places for value in track.parameters.values())


def _contradictory_distances(first: TrackResult, second: TrackResult) -> dict[str, float]:
    """Return the distances of those values of two tracks that contradict each other, by name."""
    distances = {}
    for name in first.parameters:
        if name not in second.parameters:
            continue
        first_value, second_value = first.parameters[name], second.parameters[name]
        distance = abs(first_value.value - second_value.value)
        if distance > _MAX_DISTANCE * max(first_value.combined, second_value.combined):
            distances[name] = distance
    return distances
