"""The diagnosis of the bias of filters, which imports nothing for the tracks of others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from palpate import Diagnosed, Estimator, TrackEvidence

_FAMILY = __package__


def diagnose_bias(tracks: Sequence[TrackEvidence]) -> Mapping[str, Diagnosed]:
    """Return the predicted bias of every track of a filter; see docs/uncertainty.md."""
    if not any(_is_filter(track.estimator) for track in tracks):
        return {}
    from palpate_filters.noise_bias import noise_bias

    return noise_bias(tracks)


def _is_filter(estimator: Estimator) -> bool:
    """Return True for a filter of this family."""
    return any(kind.__module__.partition(".")[0] == _FAMILY for kind in type(estimator).__mro__)
