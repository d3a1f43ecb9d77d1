"""Power and false alarms of the lack-of-fit test, for eight kinds of wrong model and three estimators.

Run: python benchmarks/lack_of_fit.py [RECORDS] [CLEAN RECORDS]. The records come from `wrong_records.py`, which shares
no force formula with the product. "flagged" is the share of records with the flag, "named" that with the true reason
among those named, "held" that whose interval of two standard uncertainties holds the true E or whose uncertainty is
stated as not known.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from palpate import Diagnosed, Estimator, Problem, Status, TrackEvidence
from palpate_engine.result.sample_keeper import Keeper
from palpate_filters import ExtendedKalmanFilter, KinematicFilter
from palpate_fits import CasadiFit
from palpate_models import DimensionalityReduction, Sphere
from palpate_uncertainty.lack_of_fit import LEVEL, lack_of_fit
from wrong_records import KINDS, S2, Palpation, record

ESTIMATORS: dict[str, Estimator] = {
    "fit": CasadiFit(),
    "kinematic": KinematicFilter(),
    "ekf": ExtendedKalmanFilter(),
}
CASES = {
    "S1 R5": Palpation(),
    "S1 R10": replace(Palpation(), radius=10e-3),
    "S2 R5": S2,
    "S2 R5 coloured": replace(S2, colour=0.8),
}
REASONS = {"power-law": "memory", "stiffening": "thickness"}  # of kinds that no reason is called after


def findings(palpation: Palpation, kind: str, seed: int) -> Iterator[tuple[str, TrackEvidence, Diagnosed]]:
    """What is found of one record, by estimator."""
    model = DimensionalityReduction(indenter=Sphere(radius=palpation.radius))
    samples, tracks = record(palpation, kind, seed), []
    for name, estimator in ESTIMATORS.items():
        found = estimator.start(Problem(model, palpation.mass, None, 1.0)).run(samples)
        keeper = Keeper()
        keeper.add(samples, found)
        last = np.flatnonzero((found.status & Status.IDLE) == 0)[-500:]
        if not len(last):
            continue
        std, values = found.std[last[-1]], found.values[last].mean(axis=0)
        surface = float(found.surface[last].mean())
        tracks.append(
            TrackEvidence(
                name, model, estimator, palpation.mass, keeper.kept, *keeper.air, values, std, std, surface,
                found.report,
            )
        )  # fmt: skip
    said = lack_of_fit(tracks)
    for track in tracks:
        if track.name in said:
            yield track.name, track, said[track.name]


def clean(count: int) -> None:
    """Shares of clean records below the level, and flagged."""
    print(f"{count} clean records a case: share with p below {LEVEL:g}, share flagged")
    for case, palpation in CASES.items():
        rows = [item for seed in range(count) for item in findings(palpation, "clean", 10_000 + seed)]
        for name in ESTIMATORS:
            mine = [said for label, _, said in rows if label == name]
            below = sum(said.table["p"] < LEVEL for said in mine)
            print(f"  {case:<16}{name:<11}{below / len(mine):8.4f}{sum(bool(s.flags) for s in mine) / len(mine):8.4f}")


def power(count: int) -> None:
    """The table of kinds."""
    print(f"\n{count} records a kind            error of E %   flagged    named     held  not known")
    for kind in KINDS:
        for case, palpation in CASES.items():
            rows = [item for seed in range(count) for item in findings(_drawn(palpation, seed), kind, seed)]
            for name in ESTIMATORS:
                mine = [(track, said) for label, track, said in rows if label == name]
                if mine:
                    print(f"  {kind:<12}{case:<16}{name:<10}{_line(mine, kind, palpation.elasticity)}")


def _drawn(palpation: Palpation, seed: int) -> Palpation:
    """The start of the sine is drawn: how much a relaxing material shows depends on it."""
    return replace(palpation, phase=float(np.random.default_rng(seed).uniform(0, 2 * np.pi)))


def _line(mine: list[tuple[TrackEvidence, Diagnosed]], kind: str, truth: float) -> str:
    error = [100 * (track.values[0] / truth - 1) for track, _ in mine]
    flagged = [bool(said.flags) for _, said in mine]
    named = [REASONS.get(kind, kind) in said.table.get("reasons", ()) for _, said in mine]
    held = [
        bool(said.unknown)
        or abs(track.values[0] - truth) <= 2 * float(np.hypot(track.combined[0], said.terms.get("elasticity", 0.0)))
        for track, said in mine
    ]
    unknown = [bool(said.unknown) for _, said in mine]
    return f"{np.mean(error):10.1f}" + "".join(f"{np.mean(column):10.2f}" for column in (flagged, named, held, unknown))


if __name__ == "__main__":
    clean(int(sys.argv[2]) if len(sys.argv) > 2 else 20)
    power(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
