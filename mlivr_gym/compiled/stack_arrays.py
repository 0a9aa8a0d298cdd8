"""Small arrays on the stack for compiled kernels.

A `kernel` does without Numba's reference counts, see `kernels`. What it needs for itself it puts on
the stack, where it lives until the kernel returns: never return such an array. Called from Python
the functions make ordinary arrays.
"""

from __future__ import annotations

from math import prod
from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin
from numba.np.arrayobj import make_array, populate_array

from mlivr_gym.arrays import Array, IntArray


def floats(*shape: int) -> Array:
    """An array of numbers that is not filled."""
    return np.empty(shape)


def zeros(*shape: int) -> Array:
    """An array of numbers that are zero."""
    return np.zeros(shape)


def integers(*shape: int) -> IntArray:
    """An array of whole numbers that is not filled."""
    return np.empty(shape, dtype=np.int64)


def _on_the_stack(function: Any, dtype: Any, clear: bool = False) -> None:
    """Teach Numba a function that makes an array of some type, filled with zeros if `clear`."""

    class Typer(AbstractTemplate):
        prefer_literal = True

        def generic(self, args: Any, kws: Any) -> Any:
            if not kws and all(isinstance(arg, types.Integer) for arg in args):
                return signature(types.Array(dtype, len(args), "C"), *args)
            return None

    infer_global(function)(Typer)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        item = context.get_data_type(dtype)
        width = context.get_abi_sizeof(item)
        lengths = [
            context.get_constant(types.intp, kind.literal_value)
            if isinstance(kind, types.IntegerLiteral)
            else context.cast(builder, value, kind, types.intp)
            for kind, value in zip(sig.args, args, strict=True)
        ]
        if all(isinstance(kind, types.IntegerLiteral) for kind in sig.args):
            # A size known to the compiler: one place for the whole call, even in a loop.
            block = ir.ArrayType(item, prod(kind.literal_value for kind in sig.args))
            data = builder.bitcast(cgutils.alloca_once(builder, block), item.as_pointer())
        else:
            count = lengths[0]
            for length in lengths[1:]:
                count = builder.mul(count, length)
            data = builder.alloca(item, size=count)
        if clear:
            total = context.get_constant(types.intp, width)
            for length in lengths:
                total = builder.mul(total, length)
            cgutils.memset(builder, data, total, 0)
        strides: list[Any] = []
        step = context.get_constant(types.intp, width)
        for length in reversed(lengths):
            strides.insert(0, step)
            step = builder.mul(step, length)
        array = make_array(sig.return_type)(context, builder)
        populate_array(
            array, data=data, shape=lengths, strides=strides, itemsize=width, meminfo=None
        )
        return array._getvalue()

    lower_builtin(function, types.VarArg(types.Any))(lower)


_on_the_stack(floats, types.float64)
_on_the_stack(zeros, types.float64, clear=True)
_on_the_stack(integers, types.int64)
