"""A linear mixed model of groups: means of groups, and a random intercept for each unit of replication."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from itertools import combinations

import numpy as np
from palpate import ConfigurationError, Floats, LogError

_UNKNOWN_TOLERANCE = 1e-8  # of the ratio of variances (choice)
_LIKELIHOOD_TOLERANCE = 1e-12  # of the likelihood (choice)
_UPPER_PROBABILITY = 0.975  # of Student's t at the upper end of a 95 % interval


def mixed_differences(
    groups: Mapping[str, Mapping[str, Floats]],
) -> dict[tuple[str, str], tuple[float, float, float, float, float, float]]:
    """Return, of every two groups of units with values (m,): difference, its 95 % interval, t, degrees of freedom, p.

    Value = mean of the group + random intercept of the unit + noise, by restricted maximum likelihood; the degrees of
    freedom are units less groups. Raises ConfigurationError without statsmodels, and LogError where it cannot be
    fitted.
    """
    try:
        from statsmodels.regression.mixed_linear_model import MixedLM
    except ImportError as error:
        raise ConfigurationError('--mixed needs statsmodels; pip install "palpate[mixed]"') from error
    from scipy.stats import t as student

    names = list(groups)
    units = [(i, values) for i, name in enumerate(names) for values in groups[name].values()]
    values = np.concatenate([unit_values for _, unit_values in units])
    counts = [len(unit_values) for _, unit_values in units]
    scale = float(values.std()) or 1.0
    design = np.eye(len(names))[np.repeat([i for i, _ in units], counts)]  # the mean of each group
    labels = np.repeat(np.arange(len(units)), counts)  # the unit of each value
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a variance between units at its bound, 0, which is an estimate like others
        model = MixedLM((values - values.mean()) / scale, design, groups=labels)
        try:  # by Powell's method, as gradients fail at that bound
            fit = model.fit(reml=True, method="powell", xtol=_UNKNOWN_TOLERANCE, ftol=_LIKELIHOOD_TOLERANCE)
        except np.linalg.LinAlgError:
            fit = None
    if fit is None or not fit.converged:
        raise LogError("--mixed: the model cannot be fitted to these values: do the curves of a unit scatter at all?")
    means, covariance = np.asarray(fit.fe_params), np.asarray(fit.cov_params())[: len(names), : len(names)]
    freedom = float(len(units) - len(names))
    quantile = float(student.ppf(_UPPER_PROBABILITY, freedom))
    differences = {}
    for i, j in combinations(range(len(names)), 2):
        difference = scale * float(means[j] - means[i])
        std = scale * math.sqrt(covariance[i, i] + covariance[j, j] - 2 * covariance[i, j])
        t = difference / std
        p = float(2 * student.sf(abs(t), freedom))
        interval = difference - quantile * std, difference + quantile * std
        differences[names[i], names[j]] = (difference, *interval, t, freedom, p)
    return differences
