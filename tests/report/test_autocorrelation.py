"""Autocorrelation of innovations with gaps: pairs over a gap, or with a value that is not known, do not count."""

import numpy as np
import pytest
from palpate_report.whiteness import autocorrelation


def test_pairs_are_those_within_a_run():
    index = np.r_[0:100, 140:300, 301:420]
    values = np.cumsum(np.random.default_rng(1).standard_normal(len(index)))
    values[[30, 31, 200]] = np.nan
    whole = np.full(420, np.nan)
    whole[index] = values
    known = [whole[lag:] * whole[:-lag] for lag in (1, 7, 50)]
    crossing = [
        np.array([not set(range(i, i + lag + 1)) <= {*index.tolist()} for i in range(420 - lag)]) for lag in (1, 7, 50)
    ]
    shares, count = autocorrelation(index, values)
    assert count == len(index) - 3
    for lag, products, over in zip((1, 7, 50), known, crossing, strict=True):
        expected = np.nanmean(products[~over]) / np.nanmean(values**2)
        assert shares[lag - 1] == pytest.approx(expected, rel=1e-12)
