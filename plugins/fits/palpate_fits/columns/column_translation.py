"""A CasADi function as two LLVM functions over columns: its values, and the sums of their products."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from palpate_kit.kernel.translation import Translation

from palpate_fits.columns.column_table import LANES


class ColumnTranslation(Translation):
    """`values(n, in, settings, out)`, `products(n, in, settings, sums)`: four samples at once, the rest one by one."""

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._scalar = self._double
        self._vector = self._ir.VectorType(self._scalar, LANES)

    def module(self) -> Any:
        """Return the LLVM module."""
        ir = self._ir
        self._module = ir.Module(name="columns")
        columns, place = self._scalar.as_pointer().as_pointer(), self._scalar.as_pointer()
        self._write("values", [columns, place, columns], self._values)
        self._write("products", [columns, place, place], self._products)
        return self._module

    def _write(self, name: str, arguments: list[Any], body: Callable[[Any, Any, Any], None]) -> None:
        ir = self._ir
        integer = ir.IntType(64)
        function = ir.Function(self._module, ir.FunctionType(ir.VoidType(), [integer, *arguments]), name=name)
        for argument in function.args[1:]:
            argument.add_attribute("noalias")
        count, samples, settings, result = function.args
        self._b = b = ir.IRBuilder(function.append_basic_block("entry"))
        self._samples = self._loaded(samples, self._function.numel_in(1))
        self._settings = self._loaded(settings, self._function.numel_in(2))
        whole = b.and_(count, integer(-LANES))
        body(count, whole, result)
        b.ret_void()

    def _loaded(self, array: Any, count: int) -> list[Any]:
        return [self._b.load(self._b.gep(array, [self._ir.IntType(64)(i)])) for i in range(count)]

    def _values(self, count: Any, whole: Any, result: Any) -> None:
        columns = self._loaded(result, self._function.numel_out(1))

        def store(index: Any, _: Sequence[Any]) -> list[Any]:
            for column, value in zip(columns, self._outputs(index), strict=True):
                self._b.store(value, self._place(column, index), align=8)
            return []

        zero, one, lanes = (self._ir.IntType(64)(k) for k in (0, 1, LANES))
        self._loop(zero, whole, lanes, [], self._vector, store)
        self._loop(whole, count, one, [], self._scalar, store)

    def _products(self, count: Any, whole: Any, sums: Any) -> None:
        """Write the body of `products`: sums over `count` samples of y_i y_j, for each pair i <= j in four lanes.

        The first `whole` samples, a multiple of four, are added four at a time; each of the others to its own lane.
        """
        b, integer = self._b, self._ir.IntType(64)
        width = self._function.numel_out(1)
        pairs = [(i, j) for i in range(width) for j in range(i, width)]

        def add_four(index: Any, totals: Sequence[Any]) -> list[Any]:
            y = self._outputs(index)
            return [b.fadd(total, b.fmul(y[i], y[j])) for total, (i, j) in zip(totals, pairs, strict=True)]

        def add_one(index: Any, _: Sequence[Any]) -> list[Any]:
            y, lane = self._outputs(index), b.sub(index, whole)
            for k, (i, j) in enumerate(pairs):
                address = b.gep(sums, [b.add(integer(k * LANES), lane)])
                b.store(b.fadd(b.load(address), b.fmul(y[i], y[j])), address)
            return []

        zeros = [self._ir.Constant(self._vector, [0.0] * LANES)] * len(pairs)
        totals = self._loop(integer(0), whole, integer(LANES), zeros, self._vector, add_four)
        self._double = self._vector
        for k, total in enumerate(totals):
            self._b.store(total, self._place(sums, integer(k * LANES)), align=8)
        self._loop(whole, count, integer(1), [], self._scalar, add_one)

    def _loop(
        self, start: Any, stop: Any, step: Any, carried: list[Any], kind: Any,
        body: Callable[[Any, Sequence[Any]], list[Any]],
    ) -> list[Any]:  # fmt: skip
        """for (i = start; i < stop; i += step) carried = body(i, carried), in numbers of one kind, scalars or lanes."""
        b, self._double = self._b, kind
        before = b.block
        inside, done = b.append_basic_block("loop"), b.append_basic_block("done")
        b.cbranch(b.icmp_signed("<", start, stop), inside, done)
        b.position_at_end(inside)
        index = b.phi(start.type)
        index.add_incoming(start, before)
        sums = [b.phi(value.type) for value in carried]
        found = body(index, sums)
        following = b.add(index, step)
        index.add_incoming(following, inside)
        b.cbranch(b.icmp_signed("<", following, stop), inside, done)
        b.position_at_end(done)
        ended = [b.phi(value.type) for value in carried]
        for first, one, last, out in zip(carried, sums, found, ended, strict=True):
            one.add_incoming(first, before)
            one.add_incoming(last, inside)
            out.add_incoming(first, before)
            out.add_incoming(last, inside)
        return ended

    def _outputs(self, index: Any) -> list[Any]:
        self._index = index
        _, output = self._instructions()
        return [output[i] for i in range(self._function.numel_out(1))]

    def _place(self, column: Any, index: Any) -> Any:
        return self._b.bitcast(self._b.gep(column, [index]), self._double.as_pointer())

    def _input(self, which: int, place: int) -> Any:
        if which == 1:
            return self._b.load(self._place(self._samples[place], self._index), align=8)
        return self._spread(self._settings[place])

    def _spread(self, value: Any) -> Any:
        """Return a number in every lane."""
        if self._double is self._scalar:
            return value
        found = self._ir.Constant(self._vector, self._ir.Undefined)
        for lane in range(LANES):
            found = self._b.insert_element(found, value, self._ir.IntType(32)(lane))
        return found

    def _intrinsic(self, name: str) -> Any:
        kind = self._ir.FunctionType(self._double, [self._double])
        full = f"llvm.{name}.{'f64' if self._double is self._scalar else f'v{LANES}f64'}"
        if full not in self._declared:
            self._declared[full] = self._ir.Function(self._module, kind, name=full)
        return self._declared[full]

    def _call(self, name: str, x: list[Any]) -> Any:
        if self._double is self._scalar:
            return super()._call(name, x)
        lanes, kind = self._double, self._scalar
        found = self._ir.Constant(lanes, self._ir.Undefined)
        for lane in range(LANES):
            at = self._ir.IntType(32)(lane)
            self._double = kind
            one = super()._call(name, [self._b.extract_element(value, at) for value in x])
            self._double = lanes
            found = self._b.insert_element(found, one, at)
        return found
