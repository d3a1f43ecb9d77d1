"""Statistics of pairs of palpation and reference: limits of agreement, Deming's line, precision, correlations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from palpate import ConfigurationError, Floats
from palpate_kit.numerics.precision import (
    Correlation,
    Precision,
    grouped,
    method_correlation,
    precision,
    repeat_correlation,
)

from palpate_reference.agreement.bland_altman import DemingLine, LimitsOfAgreement, deming_line, limits_of_agreement
from palpate_reference.agreement.reference_source import QUANTITIES
from palpate_reference.agreement.value_pairs import FACTORS, ValuePair


@dataclass(frozen=True)
class Agreement:
    """Pairs, and their statistics [SI]."""

    quantity: str
    unit: str
    pairs: tuple[ValuePair, ...]
    limits: LimitsOfAgreement | None
    line: DemingLine | None
    correlation: float  # ICC(2,1) of palpation and reference over specimens; NaN for one
    repeats: Correlation | None
    precision: dict[str, Precision]  # by the factor in which groups differ; "" of repeats alone


def agreement_of(pairs: Sequence[ValuePair], quantity: str) -> Agreement:
    """Return the statistics of pairs of one quantity; raises ConfigurationError without pairs."""
    if not pairs:
        raise ConfigurationError("no value to compare")
    specimens = [pair.specimen for pair in pairs]
    values = grouped([pair.value for pair in pairs], specimens)
    references = grouped([pair.reference for pair in pairs], specimens)
    # The reference of a specimen is one value, however often it is repeated.
    single_references = [np.unique(specimen_references) for specimen_references in references.values()]
    means = np.array([[values[specimen].mean(), references[specimen].mean()] for specimen in values])
    value_variance = np.mean([pair.std**2 for pair in pairs])
    reference_variance = np.mean([pair.reference_std**2 for pair in pairs])
    return Agreement(
        quantity,
        QUANTITIES[quantity],
        tuple(pairs),
        limits=limits_of_agreement(list(values.values()), single_references),
        line=deming_line(means[:, 0], means[:, 1], float(value_variance / reference_variance)),
        correlation=method_correlation(means),
        repeats=repeat_correlation(list(values.values())),
        precision=dict(_precisions(pairs)),
    )


def _precisions(pairs: Sequence[ValuePair]) -> Iterator[tuple[str, Precision]]:
    """Yield the precision of values that share every factor, then by each factor of which a specimen has several."""
    conditions = [f"{pair.specimen}|{sorted(pair.factors.items())}" for pair in pairs]
    repeats = grouped([pair.value for pair in pairs], conditions)
    repeatability = precision([[values] for values in repeats.values() if len(values) > 1])
    if repeatability:
        yield "", repeatability
    specimens = dict.fromkeys(pair.specimen for pair in pairs)
    for factor in FACTORS:
        specimen_groups = [_groups_by(pairs, specimen, factor) for specimen in specimens]
        if any(len(groups) > 1 for groups in specimen_groups):
            reproducibility = precision(specimen_groups)
            if reproducibility is not None:
                yield factor, reproducibility


def _groups_by(pairs: Sequence[ValuePair], specimen: str, factor: str) -> list[Floats]:
    """Return the values (m,) of a specimen for each level of a factor."""
    specimen_pairs = [pair for pair in pairs if pair.specimen == specimen]
    levels = [pair.factors.get(factor, "") for pair in specimen_pairs]
    return list(grouped([pair.value for pair in specimen_pairs], levels).values())
