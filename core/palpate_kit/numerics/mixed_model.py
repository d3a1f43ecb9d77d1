"""A linear mixed model of groups: means of groups, and a random intercept for each unit of replication."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from itertools import combinations

import numpy as np
from palpate import ConfigurationError, Floats, LogError


def mixed_differences(
    groups: Mapping[str, Mapping[str, Floats]],
) -> dict[tuple[str, str], tuple[float, float, float, float, float, float]]:
    """Of every two groups of units with values (m,): difference, its 95 % interval, t, degrees of freedom, p.

    By restricted maximum likelihood; the degrees of freedom are units less groups. Raises ConfigurationError without
    statsmodels, and LogError where it cannot be fitted.
    """
    try:
        from statsmodels.regression.mixed_linear_model import MixedLM
    except ImportError as error:
        raise ConfigurationError('--mixed needs statsmodels; pip install "palpate[mixed]"') from error
    from scipy.stats import t as student

    names = list(groups)
    units = [(i, values) for i, name in enumerate(names) for values in groups[name].values()]
    values = np.concatenate([one for _, one in units])
    scale = float(values.std()) or 1.0
    design = np.eye(len(names))[np.repeat([i for i, _ in units], [len(one) for _, one in units])]
    labels = np.repeat(np.arange(len(units)), [len(one) for _, one in units])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a variance between units at its bound, 0, which is an estimate like others
        model = MixedLM((values - values.mean()) / scale, design, groups=labels)
        try:  # gradients fail at that bound
            fit = model.fit(reml=True, method="powell", xtol=1e-8, ftol=1e-12)
        except np.linalg.LinAlgError:
            fit = None
    if fit is None or not fit.converged:
        raise LogError("--mixed: the model cannot be fitted to these values: do the curves of a unit scatter at all?")
    means, covariance = np.asarray(fit.fe_params), np.asarray(fit.cov_params())[: len(names), : len(names)]
    freedom = float(len(units) - len(names))
    half = float(student.ppf(0.975, freedom))
    found = {}
    for i, j in combinations(range(len(names)), 2):
        difference = scale * float(means[j] - means[i])
        std = scale * math.sqrt(covariance[i, i] + covariance[j, j] - 2 * covariance[i, j])
        t = difference / std
        numbers = (difference, difference - half * std, difference + half * std, t, freedom)
        found[names[i], names[j]] = (*numbers, float(2 * student.sf(abs(t), freedom)))
    return found
