"""Tables of numbers as text."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from palpate_kit.runs.csv_writer import csv_rows


def by_python(table):
    """The same rows, number by number."""
    return "".join(",".join("" if np.isnan(x) else f"{x:.10g}" for x in row) + "\n" for row in table.tolist())


def near_ties():
    """Numbers whose eleventh digit and what follows are nearly, or exactly, a half."""
    halves = np.array([0.5, 0.50000001, 0.49999999, 0.5 + 1e-6, 0.5 - 1e-6, 0.0])
    whole = np.array([1234567890, 1000000000, 9999999999, 9999999998, 5_000_000_000])
    return ((whole[:, None] + halves)[:, :, None] * 10.0 ** np.arange(-30, 25)).reshape(-1, 6)


TABLES = {
    "every size": np.random.default_rng(0).normal(size=(300, 40)) * 10.0 ** np.linspace(-320, 307, 40),
    "ties": near_ties(),
    "powers of ten": 10.0 ** np.arange(-30, 30).reshape(-1, 5) * np.array([1, -1, 2, 1 - 1e-11, 1 - 1e-12]),
    "whole": np.arange(-3000, 3000, dtype=float).reshape(-1, 4) ** 3,
    "decimals": np.arange(12_000, dtype=float).reshape(-1, 6) / 1000,
    "odd": np.array([[0.0, -0.0, np.inf, -np.inf, np.nan, 5e-324, 1.8e308, 2.2e-308, -1e-290, 1e290]]),
    "nothing": np.full((300, 3), np.nan),
    "one column": np.array([[1.5], [np.nan], [-2e-7]]),
    "no row": np.zeros((0, 4)),
}


@pytest.mark.parametrize("table", TABLES.values(), ids=list(TABLES))
def test_the_text_is_that_of_python(table):
    """Whatever the number."""
    assert csv_rows(table) == by_python(table)
    many = np.resize(table, (500, table.shape[1]))  # few numbers go another way
    assert csv_rows(many) == by_python(many)


@pytest.mark.slow
@given(st.lists(st.floats(), min_size=1, max_size=8))
def test_any_number(numbers):
    """Those that nobody thought of."""
    table = np.tile(numbers, (400, 1))
    assert csv_rows(table) == by_python(table)
