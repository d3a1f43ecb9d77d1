"""Models over many records by the evidence of the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from palpate import Floats

_MAX_BIC_DIFFERENCE = 6.0  # of BIC, by independent samples; strong evidence beyond (Kass and Raftery 1995)

_SMALLEST_SUM = 1e-300  # in a quotient, in place of 0: near the smallest double


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
    behind: float  # BIC less that of the best model
    weight: float
    held_out: float  # [N]
    best_blocks: int
    blocks: int
    misfits: int
    records: int
    elasticity: tuple[float, float] | None  # mean over records, and its uncertainty or spread, the larger


def rank_models(candidates: Sequence[Candidate]) -> list[ModelStanding]:
    """Return the models over all records, the best first; a model without a fit of every record stands last."""
    names = list(dict.fromkeys(candidate.model for candidate in candidates))
    # The candidates of each record, in the order of the models.
    fits_by_record: dict[str, dict[str, Candidate]] = {}
    for candidate in candidates:
        fits_by_record.setdefault(candidate.record, {})[candidate.model] = candidate
    groups = [[fits[name] for name in names if name in fits] for fits in fits_by_record.values()]

    behind = _total_behind(names, groups)
    weights = _weights(behind)
    # Of each record and each held-out block, the model that predicts it best.
    winners = [winner for group in groups for winner in _winners(group)]
    standings = []
    for name in names:
        fits = [candidate for group in groups for candidate in group if candidate.model == name]
        standings.append(
            ModelStanding(
                model=name,
                behind=behind[name],
                weight=weights[name],
                held_out=_held_out_rms(fits),
                best_blocks=winners.count(name),
                blocks=len(winners),
                misfits=sum(candidate.misfit or candidate.verdict == "invalid" for candidate in fits),
                records=len(groups),
                elasticity=_mean_elasticity(fits),
            )
        )
    return sorted(standings, key=lambda standing: standing.behind if np.isfinite(standing.behind) else np.inf)


def _held_out_rms(fits: Sequence[Candidate]) -> float:
    """Return the root mean square [N] over all held-out blocks of a model's fits; NaN without any."""
    blocks = np.concatenate([fit.blocks for fit in fits])
    return float(np.sqrt(np.mean(blocks**2))) if len(blocks) else float("nan")


def _total_behind(names: Sequence[str], groups: Sequence[Sequence[Candidate]]) -> dict[str, float]:
    """Return the distance of each model's evidence from the best one's, summed over all records."""
    total = dict.fromkeys(names, 0.0)
    for group in groups:
        for name, behind in _behind(group).items():
            total[name] += behind
    best = min((value for value in total.values() if np.isfinite(value)), default=0.0)
    return {name: float(value - best) for name, value in total.items()}


def _weights(behind: Mapping[str, float]) -> dict[str, float]:
    """Return the weight exp(-dBIC/2) of each model, of all together; 0 without evidence."""
    shares = {name: float(np.exp(-value / 2)) if np.isfinite(value) else 0.0 for name, value in behind.items()}
    total = max(sum(shares.values()), _SMALLEST_SUM)
    return {name: share / total for name, share in shares.items()}


def _behind(group: Sequence[Candidate]) -> dict[str, float]:
    """Return the distance of each model's BIC from the best one's on a record.

    It is counted by the share of samples that are independent under the best model, so that correlated residuals do not
    feign certainty (Kass and Raftery 1995).
    """
    fitted = [candidate for candidate in group if np.isfinite(candidate.bic)]
    if not fitted:
        return {candidate.model: float("nan") for candidate in group}
    best = min(fitted, key=lambda candidate: candidate.bic)
    return {candidate.model: best.share * (candidate.bic - best.bic) for candidate in group}


def _winners(group: Sequence[Candidate]) -> list[str]:
    """Return the model that predicts each block of a record best."""
    if not group or not len(group[0].blocks):
        return []
    errors = np.array([np.where(np.isfinite(item.blocks), item.blocks, np.inf) for item in group])
    return [group[int(place)].model for place in np.argmin(errors, axis=0)]


def _mean_elasticity(fits: Sequence[Candidate]) -> tuple[float, float] | None:
    """Return the mean elasticity [Pa] over records, and its RMS uncertainty or the records' spread, the larger.

    None where no record has one.
    """
    values = np.array([candidate.elasticity for candidate in fits if candidate.elasticity is not None])
    if not len(values):
        return None
    spread = float(np.std(values[:, 0], ddof=1)) if len(values) > 1 else 0.0
    return float(values[:, 0].mean()), max(float(np.sqrt(np.mean(values[:, 1] ** 2))), spread)


def sentence(standings: Sequence[ModelStanding], records: int) -> str:
    """Return the data's evidence, in a sentence for a paper."""
    record_text = f"over {records} records" if records > 1 else "of the record"
    describes_some = [item.misfits < item.records and np.isfinite(item.behind) for item in standings]
    if not any(describes_some):
        return f"None of the models describes the data {record_text}: the residual of each is not the channel's noise."
    # The models that the evidence does not exclude, and those that it does.
    best = standings[0]
    supported = [item.model for item in standings if item.behind < _MAX_BIC_DIFFERENCE]
    refuted = [f"{item.model} by {item.behind:.3g}" for item in standings if item.behind >= _MAX_BIC_DIFFERENCE]
    text = f"The data {record_text} support {' and '.join(supported)}"
    text += " alike" if len(supported) > 1 else f" (weight {100 * best.weight:.0f} %)"
    if refuted:
        text += f"; less {', '.join(refuted)} of BIC"
    # Forecasts and lack of fit of the best.
    if best.blocks:
        text += f"; {best.model} predicts {best.best_blocks} of {best.blocks} held-out blocks best"
    if best.misfits:
        text += f"; it leaves a lack of fit in {best.misfits} of {best.records}"
    return text + "."
