"""How compiled kernels call the equations of a plant: through the addresses of C functions.

So one kernel serves every plant, and is compiled once. `void f(x, u, d, p, out)`, all pointers to
doubles, writes ẋ, y, or the matrices A, B, C, D (row by row, one after the other) to `out`.
"""

from functools import partial
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.errors import TypingError
from numba.extending import intrinsic

from prefcal_env.jit import callback

_POINTER = types.CPointer(types.float64)  # type: ignore[no-untyped-call]
_intrinsic: Any = intrinsic

SIGNATURE = types.void(_POINTER, _POINTER, _POINTER, _POINTER, _POINTER)
"""Type of an equation."""

equation = partial(callback, SIGNATURE)
"""Decorator, used as `@equation()`, that compiles one equation of a plant."""


@_intrinsic  # type: ignore[untyped-decorator]
def call(typing: Any, address: Any, x: Any, u: Any, d: Any, p: Any, out: Any) -> Any:
    """Call the equation at `address` with the data of five arrays."""
    arrays = (x, u, d, p, out)
    if any(array.layout != "C" for array in arrays):
        raise TypingError("the arrays of an equation must be contiguous")

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        double = ir.DoubleType().as_pointer()
        function = ir.FunctionType(ir.VoidType(), [double] * len(arrays)).as_pointer()
        data = [
            context.make_array(kind)(context, builder, value).data
            for kind, value in zip(signature.args[1:], values[1:], strict=True)
        ]
        builder.call(builder.inttoptr(values[0], function), data)
        return context.get_dummy_value()

    return types.void(address, *arrays), generate
