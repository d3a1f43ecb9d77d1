"""What pairs of palpation and reference say together: limits of agreement, Deming's line, precision, correlations."""

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
    """Pairs, and what they say together [SI]."""

    quantity: str
    unit: str
    pairs: tuple[ValuePair, ...]
    limits: LimitsOfAgreement | None
    line: DemingLine | None
    correlation: float  # ICC(2,1) of palpation and reference over specimens; NaN for one
    repeats: Correlation | None
    precision: dict[str, Precision]  # by what groups differ; "" of repeats alone


def agreement_of(pairs: Sequence[ValuePair], quantity: str) -> Agreement:
    """Everything that pairs say together."""
    if not pairs:
        raise ConfigurationError("no value to compare")
    specimens = [pair.specimen for pair in pairs]
    values = grouped([pair.value for pair in pairs], specimens)
    references = grouped([pair.reference for pair in pairs], specimens)
    once = [np.unique(one) for one in references.values()]  # the reference of a specimen is one value, however often
    means = np.array([[values[name].mean(), references[name].mean()] for name in values])
    ratio = float(np.mean([p.std**2 for p in pairs]) / np.mean([p.reference_std**2 for p in pairs]))
    return Agreement(
        quantity, QUANTITIES[quantity], tuple(pairs),
        limits_of_agreement(list(values.values()), once), deming_line(means[:, 0], means[:, 1], ratio),
        method_correlation(means), repeat_correlation(list(values.values())), dict(_precisions(pairs)),
    )  # fmt: skip


def _precisions(pairs: Sequence[ValuePair]) -> Iterator[tuple[str, Precision]]:
    """Of values that share every factor, and by each factor of which a specimen has several."""
    alike = grouped(
        [pair.value for pair in pairs], [f"{pair.specimen}|{sorted(pair.factors.items())}" for pair in pairs]
    )
    if repeats := precision([[values] for values in alike.values() if len(values) > 1]):
        yield "", repeats
    for factor in FACTORS:
        levels: list[list[Floats]] = []
        for specimen in dict.fromkeys(pair.specimen for pair in pairs):
            own = [pair for pair in pairs if pair.specimen == specimen]
            labels = [pair.factors.get(factor, "") for pair in own]
            levels.append(list(grouped([pair.value for pair in own], labels).values()))
        if any(len(groups) > 1 for groups in levels) and (spread := precision(levels)) is not None:
            yield factor, spread
