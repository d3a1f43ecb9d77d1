"""A linear mixed model of groups: means of groups, and a random intercept for each unit of replication."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from itertools import combinations
from typing import NamedTuple

import numpy as np
from palpate import ConfigurationError, Floats, LogError

_UNKNOWN_TOLERANCE = 1e-8  # of the ratio of variances (choice)
_LIKELIHOOD_TOLERANCE = 1e-12  # of the likelihood (choice)
_UPPER_PROBABILITY = 0.975  # of Student's t at the upper end of a 95 % interval
_NO_FIT = "--mixed: the model cannot be fitted to these values: do the curves of a unit scatter at all?"


class MixedDifference(NamedTuple):
    """The difference of the means of two groups, second less first, by the mixed model."""

    difference: float
    low: float  # of the 95 % interval
    high: float
    t: float
    freedom: float
    p: float


def mixed_differences(groups: Mapping[str, Mapping[str, Floats]]) -> dict[tuple[str, str], MixedDifference]:
    """Return, of every two groups of units with values (m,): difference, its 95 % interval, t, degrees of freedom, p.

    Value = mean of the group + random intercept of the unit + noise, by restricted maximum likelihood; the degrees of
    freedom are units less groups. Raises ConfigurationError without statsmodels, and LogError where it cannot be
    fitted.
    """
    from scipy.stats import t as student

    model = _fitted_model(groups)
    scale, covariance = model.scale, model.covariance
    unit_count = sum(len(units) for units in groups.values())
    freedom = float(unit_count - len(groups))
    quantile = float(student.ppf(_UPPER_PROBABILITY, freedom))
    names = list(groups)
    differences = {}
    for i, j in combinations(range(len(names)), 2):
        difference = scale * float(model.means[j] - model.means[i])
        std = scale * math.sqrt(covariance[i, i] + covariance[j, j] - 2 * covariance[i, j])
        t = difference / std
        differences[names[i], names[j]] = MixedDifference(
            difference=difference,
            low=difference - quantile * std,
            high=difference + quantile * std,
            t=t,
            freedom=freedom,
            p=float(2 * student.sf(abs(t), freedom)),
        )
    return differences


class _FittedModel(NamedTuple):
    """Means of groups, less that of all values, in units of the standard deviation `scale` of all values."""

    means: Floats  # (g,)
    covariance: Floats  # (g, g)
    scale: float


def _fitted_model(groups: Mapping[str, Mapping[str, Floats]]) -> _FittedModel:
    """Return the means of groups and their covariance by restricted maximum likelihood.

    Raises ConfigurationError without statsmodels, and LogError where the model cannot be fitted.
    """
    try:
        from statsmodels.regression.mixed_linear_model import MixedLM
    except ImportError as error:
        raise ConfigurationError('--mixed needs statsmodels; pip install "palpate[mixed]"') from error

    # Values unit by unit, with the group and the unit of each.
    group_numbers, unit_values = [], []
    for i, units in enumerate(groups.values()):
        for values_of_unit in units.values():
            group_numbers.append(i)
            unit_values.append(values_of_unit)
    # Without scatter within any unit the noise is zero and the likelihood has no bound.
    if all(np.ptp(values_of_unit) == 0.0 for values_of_unit in unit_values):
        raise LogError(_NO_FIT)
    values = np.concatenate(unit_values)
    counts = [len(values_of_unit) for values_of_unit in unit_values]
    scale = float(values.std()) or 1.0  # the model is that of values less their mean, in units of this
    design = np.eye(len(groups))[np.repeat(group_numbers, counts)]  # the mean of each group
    labels = np.repeat(np.arange(len(counts)), counts)  # the unit of each value
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a variance between units at its bound, 0, which is an estimate like others
        model = MixedLM((values - values.mean()) / scale, design, groups=labels)
        try:  # by Powell's method, as gradients fail at that bound
            fit = model.fit(reml=True, method="powell", xtol=_UNKNOWN_TOLERANCE, ftol=_LIKELIHOOD_TOLERANCE)
        except np.linalg.LinAlgError:
            fit = None
    if fit is None or not fit.converged:
        raise LogError(_NO_FIT)
    covariance = np.asarray(fit.cov_params())[: len(groups), : len(groups)]  # of the means, without the variances
    return _FittedModel(np.asarray(fit.fe_params), covariance, scale)
