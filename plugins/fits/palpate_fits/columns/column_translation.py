"""A CasADi function as two LLVM functions over columns: its values, and the sums of their products."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from palpate_kit.kernel.translation import Translation

from palpate_fits.columns.column_table import LANES

_INTEGER_BITS, _LANE_BITS = 64, 32  # of a count and an index, and of the number of a lane
_ALIGNMENT = 8  # [bytes] of a double in memory


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
        """Add a function of a count and three arrays; its `body` gets the count, its multiple of four, and the last."""
        ir = self._ir
        integer = ir.IntType(_INTEGER_BITS)
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
        """Return the first `count` entries of an array."""
        return [self._b.load(self._b.gep(array, [self._ir.IntType(_INTEGER_BITS)(i)])) for i in range(count)]

    def _values(self, count: Any, whole: Any, result: Any) -> None:
        """Write the body of `values`: four samples at a time up to `whole`, then one by one."""
        columns = self._loaded(result, self._function.numel_out(1))

        def store(index: Any, _: Sequence[Any]) -> list[Any]:
            for column, value in zip(columns, self._outputs(index), strict=True):
                self._b.store(value, self._place(column, index), align=_ALIGNMENT)
            return []

        integer = self._ir.IntType(_INTEGER_BITS)
        self._loop(start=integer(0), stop=whole, step=integer(LANES), carried=[], number_type=self._vector, body=store)
        self._loop(start=whole, stop=count, step=integer(1), carried=[], number_type=self._scalar, body=store)

    def _products(self, count: Any, whole: Any, sums: Any) -> None:
        """Write the body of `products`: sums over `count` samples of y_i y_j, for each pair i <= j in four lanes.

        The first `whole` samples, a multiple of four, are added four at a time; each of the others to its own lane.
        """
        b, integer = self._b, self._ir.IntType(_INTEGER_BITS)
        width = self._function.numel_out(1)
        pairs = [(i, j) for i in range(width) for j in range(i, width)]

        def add_four(index: Any, totals: Sequence[Any]) -> list[Any]:
            """Return the totals of all pairs with the products of four samples, each in its lane."""
            y = self._outputs(index)
            return [b.fadd(total, b.fmul(y[i], y[j])) for total, (i, j) in zip(totals, pairs, strict=True)]

        def add_one(index: Any, _: Sequence[Any]) -> list[Any]:
            """Add the products of one sample to its lane of the stored sums."""
            y, lane = self._outputs(index), b.sub(index, whole)
            for k, (i, j) in enumerate(pairs):
                address = b.gep(sums, [b.add(integer(k * LANES), lane)])
                b.store(b.fadd(b.load(address), b.fmul(y[i], y[j])), address)
            return []

        zeros = [self._ir.Constant(self._vector, [0.0] * LANES)] * len(pairs)
        totals = self._loop(
            start=integer(0), stop=whole, step=integer(LANES), carried=zeros, number_type=self._vector, body=add_four
        )
        self._double = self._vector
        for k, total in enumerate(totals):
            self._b.store(total, self._place(sums, integer(k * LANES)), align=_ALIGNMENT)
        self._loop(start=whole, stop=count, step=integer(1), carried=[], number_type=self._scalar, body=add_one)

    def _loop(
        self,
        start: Any,
        stop: Any,
        step: Any,
        carried: list[Any],
        number_type: Any,
        body: Callable[[Any, Sequence[Any]], list[Any]],
    ) -> list[Any]:
        """Write a loop and return what it has carried: for (i = start; i < stop; i += step) carried = body(i, carried).

        Numbers are of one type within it, scalars or vectors of four lanes.
        """
        b, self._double = self._b, number_type
        before = b.block
        inside, done = b.append_basic_block("loop"), b.append_basic_block("done")
        b.cbranch(b.icmp_signed("<", start, stop), inside, done)
        b.position_at_end(inside)
        index = b.phi(start.type)
        index.add_incoming(start, before)
        carried_in = [b.phi(value.type) for value in carried]
        carried_out = body(index, carried_in)
        following = b.add(index, step)
        index.add_incoming(following, inside)
        b.cbranch(b.icmp_signed("<", following, stop), inside, done)
        b.position_at_end(done)
        final = [b.phi(value.type) for value in carried]
        # Each value comes from before the loop, or from its latest turn.
        for first, value, latest, end in zip(carried, carried_in, carried_out, final, strict=True):
            value.add_incoming(first, before)
            value.add_incoming(latest, inside)
            end.add_incoming(first, before)
            end.add_incoming(latest, inside)
        return final

    def _outputs(self, index: Any) -> list[Any]:
        """Return the values of the function at a sample, or at four from it on."""
        self._index = index
        _, output = self._instructions()
        return [output[i] for i in range(self._function.numel_out(1))]

    def _place(self, column: Any, index: Any) -> Any:
        """Return the address of an entry of a column, as one of a scalar or of four lanes."""
        return self._b.bitcast(self._b.gep(column, [index]), self._double.as_pointer())

    def _input(self, which: int, place: int) -> Any:
        """Return an entry of the sample, or one of the settings in every lane."""
        if which == 1:
            return self._b.load(self._place(self._samples[place], self._index), align=_ALIGNMENT)
        return self._spread(self._settings[place])

    def _spread(self, value: Any) -> Any:
        """Return a number in every lane."""
        if self._double is self._scalar:
            return value
        vector = self._ir.Constant(self._vector, self._ir.Undefined)
        for lane in range(LANES):
            vector = self._b.insert_element(vector, value, self._ir.IntType(_LANE_BITS)(lane))
        return vector

    def _intrinsic(self, name: str) -> Any:
        """Return LLVM's function of a name for the present type of numbers, declared once."""
        signature = self._ir.FunctionType(self._double, [self._double])
        full = f"llvm.{name}.{'f64' if self._double is self._scalar else f'v{LANES}f64'}"
        if full not in self._declared:
            self._declared[full] = self._ir.Function(self._module, signature, name=full)
        return self._declared[full]

    def _call(self, name: str, x: list[Any]) -> Any:
        """Return a function of the C library, called for each lane by itself."""
        if self._double is self._scalar:
            return super()._call(name, x)
        vector_type, scalar_type = self._double, self._scalar
        vector = self._ir.Constant(vector_type, self._ir.Undefined)
        for lane in range(LANES):
            place = self._ir.IntType(_LANE_BITS)(lane)
            self._double = scalar_type
            value = super()._call(name, [self._b.extract_element(argument, place) for argument in x])
            self._double = vector_type
            vector = self._b.insert_element(vector, value, place)
        return vector
