"""Models over many records by the evidence of the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from palpate import Floats

_MAX_BIC_DIFFERENCE = 6.0  # of BIC, by independent samples; strong evidence beyond (Kass and Raftery 1995)


@dataclass(frozen=True)
class Candidate:
    """One model on one record."""

    record: str
    model: str
    bic: float
    share: float  # of independent samples among those that were fitted
    blocks: Floats  # (4,) [N] held-out root mean squares
    rms: float  # [N] of the fit to all
    misfit: bool  # a lack of fit was found
    verdict: str
    elasticity: tuple[float, float] | None  # [Pa] and its combined uncertainty
    doubts: tuple[str, ...] = ()  # codes of the flags that count against its numbers


@dataclass(frozen=True)
class ModelStanding:
    """One model over all records."""

    model: str
    behind: float  # of the best one's evidence
    weight: float
    held_out: float  # [N]
    best_blocks: int
    blocks: int
    misfits: int
    records: int
    elasticity: tuple[float, float] | None  # mean over records, and its uncertainty or spread, the larger


def rank_models(found: Sequence[Candidate]) -> list[ModelStanding]:
    """Models over all records, the best first; only those that have a fit of every record stand."""
    records = list(dict.fromkeys(one.record for one in found))
    names = list(dict.fromkeys(one.model for one in found))
    by = {(one.record, one.model): one for one in found}
    total = dict.fromkeys(names, 0.0)
    for record in records:
        for name, behind in _behind([one for one in found if one.record == record]).items():
            total[name] += behind
    finite = [value for value in total.values() if np.isfinite(value)]
    best = min(finite, default=0.0)
    shares = {name: float(np.exp(-(value - best) / 2)) if np.isfinite(value) else 0.0 for name, value in total.items()}
    winners = [_winner([by[record, name] for name in names if (record, name) in by]) for record in records]
    standings = []
    for name in names:
        own = [by[record, name] for record in records if (record, name) in by]
        blocks = np.concatenate([one.blocks for one in own]) if own else np.zeros(0)
        standings.append(
            ModelStanding(
                name, float(total[name] - best), shares[name] / max(sum(shares.values()), 1e-300),
                float(np.sqrt(np.mean(blocks**2))) if len(blocks) else float("nan"),
                sum(sum(winner == name for winner in record) for record in winners), sum(map(len, winners)),
                sum(one.misfit or one.verdict == "invalid" for one in own), len(records), _mean(own),
            )
        )  # fmt: skip
    return sorted(standings, key=lambda one: one.behind if np.isfinite(one.behind) else np.inf)


def _behind(group: Sequence[Candidate]) -> dict[str, float]:
    """Distance of each model's BIC from the best one's on a record, by samples that are independent under that.

    Sources: Kass and Raftery 1995; residuals that are correlated feign no certainty.
    """
    best = min((one for one in group if np.isfinite(one.bic)), key=lambda one: one.bic, default=None)
    if best is None:
        return {one.model: float("nan") for one in group}
    return {one.model: best.share * (one.bic - best.bic) for one in group}


def _winner(group: Sequence[Candidate]) -> list[str]:
    """Return the model that predicts each block of a record best."""
    if not group or not len(group[0].blocks):
        return []
    table = np.array([np.where(np.isfinite(one.blocks), one.blocks, np.inf) for one in group])
    return [group[int(place)].model for place in np.argmin(table, axis=0)]


def _mean(own: Sequence[Candidate]) -> tuple[float, float] | None:
    values = np.array([one.elasticity for one in own if one.elasticity is not None])
    if not len(values):
        return None
    spread = float(np.std(values[:, 0], ddof=1)) if len(values) > 1 else 0.0
    return float(values[:, 0].mean()), max(float(np.sqrt(np.mean(values[:, 1] ** 2))), spread)


def sentence(standings: Sequence[ModelStanding], records: int) -> str:
    """Return the data's evidence, in a sentence for a paper."""
    over = f"over {records} records" if records > 1 else "of the record"
    fair = [one for one in standings if one.misfits < one.records and np.isfinite(one.behind)]
    if not fair:
        return f"None of the models describes the data {over}: the residual of each is not the channel's noise."
    best = standings[0]
    level = [one.model for one in standings if one.behind < _MAX_BIC_DIFFERENCE]
    refuted = [f"{one.model} by {one.behind:.3g}" for one in standings if one.behind >= _MAX_BIC_DIFFERENCE]
    text = f"The data {over} support {' and '.join(level)}"
    text += " alike" if len(level) > 1 else f" (weight {100 * best.weight:.0f} %)"
    text += f"; less {', '.join(refuted)} of BIC" if refuted else ""
    if best.blocks:
        text += f"; {best.model} predicts {best.best_blocks} of {best.blocks} held-out blocks best"
    if best.misfits:
        text += f"; it leaves a lack of fit in {best.misfits} of {best.records}"
    return text + "."
