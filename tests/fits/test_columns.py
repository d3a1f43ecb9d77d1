"""Functions over columns: machine code gives the bits of CasADi's virtual machine, sums are those of the values."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from palpate_fits.columns.column_function import ColumnFunction, _compiled, _OnVirtualMachine, with_roots
from palpate_fits.columns.column_table import ColumnTable

from tests.filters.test_kernel import OPERATIONS, a, awkward, b, bits, p, w

SETTINGS = np.array([[0.3], [-2.0]])


def table(n: int) -> ColumnTable:
    return ColumnTable(awkward(max(n, 40))[:n].T)


@pytest.mark.parametrize("name", OPERATIONS)
@pytest.mark.parametrize("n", [1, 3, 4, 103])
def test_both_kernels_give_the_same_bits(name, n):
    function = ColumnFunction(w, p, ca.vertcat(p * OPERATIONS[name], a))
    machine, code = _OnVirtualMachine(function._function), _compiled(function._function)
    rows = table(n)
    np.testing.assert_array_equal(bits(code.values(rows, SETTINGS[1])), bits(machine.values(rows, SETTINGS[1])))
    sums = [kernel.lanes(rows, SETTINGS, 50) for kernel in (code, machine)]
    np.testing.assert_array_equal(*(bits(np.ascontiguousarray(one)) for one in sums))


@pytest.mark.parametrize("n", [0, 5, 8192, 20_011])
def test_products_are_those_of_the_values(n):
    function = ColumnFunction(w, p, ca.vertcat(a * p, ca.sin(b), a * b))
    rows = ColumnTable(np.random.default_rng(1).standard_normal((2, n)))
    found = function.products(rows, SETTINGS)
    assert found.shape == (2, 3, 3)
    for one, settings in zip(found, SETTINGS, strict=True):
        values = function.values(rows, settings)
        np.testing.assert_allclose(one, values @ values.T, rtol=1e-12, atol=1e-10)
        np.testing.assert_array_equal(one, function.products(rows, settings))


def test_nobody_can_tell_when_a_function_is_compiled():
    rows = ColumnTable(np.random.default_rng(2).standard_normal((2, 9_000)))
    function = ColumnFunction(w, p, ca.vertcat(ca.fabs(a) ** 1.5, b))
    first = function.products(rows, SETTINGS[0])
    for _ in range(3):
        np.testing.assert_array_equal(function.products(rows, SETTINGS[0]), first)
    assert type(function._kernel).__name__ == "CompiledColumns"


@pytest.mark.parametrize("power", [-4.5, -0.5, 0.5, 1.5, 2.5, 1.7, 2.0, 5.5])
def test_half_powers_are_products_of_roots(power):
    base = np.geomspace(1e-12, 1e3, 200)
    plain = ca.Function("power", [ca.SX.sym("n"), w, p], [0, (w[0] + p) ** power * w[1]])
    changed = with_roots(plain)
    names = {ca.OP_POW, ca.OP_CONSTPOW}
    has_power = any(changed.instruction_id(k) in names for k in range(changed.n_instructions()))
    assert has_power == (power in (1.7, 5.5))
    for one in base:
        expected = plain(0, [one, 3.0], 0.0)[1]
        assert float(changed(0, [one, 3.0], 0.0)[1]) == pytest.approx(float(expected), rel=2e-15)
