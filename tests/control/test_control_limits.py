"""E_n, Shewhart's chart and the EWMA: by hand, by published run lengths, and by simulation."""

import math

import numpy as np
import pytest
from palpate_control.control_limits import (
    BASELINE,
    EWMA,
    SHEWHART,
    WEIGHT,
    CheckValue,
    check_states,
)
from palpate_kit.numerics.normalised_error import normalised_error

ALONE = 0.0  # standard uncertainty of a reference that is exactly known


def readings(values, std=1.0, repeat_std=1.0):
    return [CheckValue(float(value), std, repeat_std) for value in values]


def test_e_n_by_hand():
    """(115 - 112.5)/(2 sqrt(1.8^2 + 1.5^2)) = 2.5/4.686."""
    assert normalised_error(115.0, 1.8, 112.5, 1.5) == pytest.approx(0.5335, abs=1e-4)
    assert normalised_error(112.5 - 4.6862, 1.8, 112.5, 1.5) == pytest.approx(-1.0, abs=1e-4)


def test_a_value_that_is_not_the_references_is_out_of_control_at_once():
    near, far = (check_states(readings([value]), 100.0, 0.5)[0] for value in (101.9, 102.4))
    assert near.in_control
    assert far.reasons == ("E_n is 1.07, beyond 1: the value is not that of the reference",)


def test_the_ewma_by_hand():
    """z = 0, 0.2, 0.36 of a step of one; its variance by the sum of the squared weights."""
    states = check_states(readings([0.0, 1.0, 1.0]), 0.0, ALONE)
    assert [state.ewma for state in states] == pytest.approx([0.0, 0.2, 0.36])
    spread = [np.sqrt(sum((WEIGHT * (1 - WEIGHT) ** j) ** 2 for j in range(i))) for i in (1, 2, 3)]
    assert [state.ewma_limit for state in states] == pytest.approx([EWMA * s for s in spread])


def test_an_error_that_all_checks_share_is_no_change():
    """One standard uncertainty of a tip's radius in every check: an average of many does not make it less likely."""
    shared = check_states(readings([1.0] * 60, std=1.0, repeat_std=0.05), 0.0, ALONE)
    assert all(state.in_control for state in shared[:BASELINE])
    alone = check_states(readings([1.0] * BASELINE), 0.0, ALONE)
    assert not alone[-1].in_control  # the same mean of values that scatter by it


def test_after_25_checks_in_control_the_limits_are_those_of_the_own_scatter():
    scatter = 0.02 * np.random.default_rng(1).standard_normal(BASELINE)
    states = check_states(readings([*(100.5 + scatter), 100.5, 100.7], 1.0, 0.05), 100.0, 0.5)
    assert not states[BASELINE - 1].own_scatter
    last = states[-1]
    assert last.own_scatter
    assert last.centre == pytest.approx(100.5 + scatter.mean())
    assert last.limit == pytest.approx(SHEWHART * np.abs(np.diff(scatter)).mean() / 1.12838, rel=1e-4)
    assert states[-2].in_control
    assert "3 sigma" in last.reasons[0]  # 0.2 is nothing beside 1.1, and ten times the scatter
    assert abs(last.e_n) < 1


def test_a_check_out_of_control_is_no_part_of_the_baseline():
    values = [100.0 + 0.1 * (-1) ** i for i in range(BASELINE)]
    states = check_states(readings([values[0], 110.0, *values[1:], 100.0, 100.0]), 100.0, ALONE)
    assert [state.own_scatter for state in states[-3:]] == [False, True, True]
    assert states[-1].centre == pytest.approx(np.mean(values))


def normal(x):
    """Distribution function of the normal distribution."""
    return 0.5 * (1 + np.vectorize(math.erf)(x / np.sqrt(2)))


def test_the_ewma_has_a_published_run_length():
    """Lucas and Saccucci 1990: with lambda 0.2 an average of 500 until a false alarm at L 2.962; 370 is at 2.859.

    By the Markov chain of Brook and Evans, with 201 states.
    """

    def run_length(limit, states=201):
        edge = limit * np.sqrt(WEIGHT / (2 - WEIGHT))
        width = 2 * edge / states
        middle = -edge + width * (np.arange(states) + 0.5)
        start = (1 - WEIGHT) * middle[:, None]
        chances = normal((middle + width / 2 - start) / WEIGHT) - normal((middle - width / 2 - start) / WEIGHT)
        return np.linalg.solve(np.eye(states) - chances, np.ones(states))[states // 2]

    assert run_length(2.962) == pytest.approx(500, rel=0.01)
    assert run_length(EWMA) == pytest.approx(370.4, rel=0.01)


@pytest.mark.slow
def test_run_lengths_by_simulation(monkeypatch):
    """400 charts of stated scatter until a false alarm, by the product's own states; their mean is known to 5 %."""
    from palpate_control import control_limits

    monkeypatch.setattr(control_limits, "BASELINE", 10**9)  # limits by the stated scatter all along
    monkeypatch.setattr("palpate_kit.numerics.normalised_error.COVERAGE", 10**9)  # the EWMA alone
    monkeypatch.setattr(control_limits, "SHEWHART", 10**9)
    lengths = []
    for seed in range(400):
        values, alarms = np.random.default_rng(seed).standard_normal(6000), [None, None]
        for end in (400, 1200, 6000):  # the states of a value do not depend on those after it
            states = check_states(readings(values[:end]), 0.0, ALONE)
            lines = [not state.in_control for state in states], (np.abs(values[:end]) > SHEWHART).tolist()
            alarms = [line.index(True) + 1 if True in line else None for line in lines]
            if None not in alarms:
                break
        lengths.append(alarms)
    ewma, single = np.mean(lengths, axis=0)
    assert ewma == pytest.approx(370, rel=0.15)
    assert single == pytest.approx(370, rel=0.15)
    assert np.min(lengths, axis=1).mean() == pytest.approx(202, rel=0.15)  # docs/control.md
