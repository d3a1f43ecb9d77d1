"""Named parts of a vector."""

import numpy as np
import pytest
from palpate import Layout, finite_rows

STATE = Layout(height=1, velocity=1, slope=0, memory=0, parameters=2)


def test_parts_stand_one_after_another_and_fill_the_vector():
    assert STATE.size == 4
    vector = np.arange(4.0)
    assert vector[STATE.at("velocity")] == 1.0
    assert vector[STATE["parameters"]].tolist() == [2.0, 3.0]
    assert vector[STATE.span("velocity", "parameters")].tolist() == [1.0, 2.0, 3.0]
    assert [k for name in STATE for k in range(4)[STATE[name]]] == [0, 1, 2, 3]


def test_what_is_absent_has_a_slice_and_no_place():
    assert "slope" not in STATE
    assert "height" in STATE
    assert np.arange(4.0)[STATE["slope"]].size == 0
    with pytest.raises(KeyError, match="slope is 0 entries"):
        STATE.at("slope")


def test_a_part_of_several_entries_has_no_single_place():
    with pytest.raises(KeyError, match="parameters is 2 entries"):
        STATE.at("parameters")
    with pytest.raises(KeyError):
        STATE["parameter"]


def test_it_cuts_casadi_columns_and_lists_alike():
    import casadi as ca

    column = ca.vertcat(1, 2, 3, 4)
    assert np.array(column[STATE["parameters"]]).ravel().tolist() == [3, 4]
    assert [1, 2, 3, 4][STATE["parameters"]] == [3, 4]


def test_no_part_is_of_negative_length():
    with pytest.raises(ValueError, match="memory has -1 entries"):
        Layout(memory=-1)


@pytest.mark.parametrize("shape", [(0, 2), (3, 0), (4, 1), (1000, 7)])
def test_rows_are_finite_where_every_number_is(shape):
    share = [0.3, 0.3, 0.2, 0.18, 0.01, 0.01]
    values = np.random.default_rng(0).choice([0.0, 1.0, 2.0, 3.0, np.nan, np.inf], shape, p=share)
    np.testing.assert_array_equal(finite_rows(values), np.isfinite(values).all(axis=1))
