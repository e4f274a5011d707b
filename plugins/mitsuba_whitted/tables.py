"""Flat tables: one row a shape, material or light, so that a kernel looks things up instead of calling them.

A virtual call in Dr.Jit traces the code of every object alive in the process, 200 spheres one by one; a row of
a table costs one load. Rows are data: editing one never makes a new kernel.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

FEW_ROWS = 8
"""A table of so many rows stands in the kernel as constants, among which a lane selects.

The fewer they are the more it brings (the row `tables` of `whitted benchmark speed`); beyond, to load one for each lane
takes less. Unlike a table, constants have an answer also for lanes that are not active.
"""


def column(rows: Iterable[Any]) -> Any:
    """Store rows of floats one after another as float32."""
    return stored(np.array(list(rows), np.float32))


def double_column(rows: Iterable[Any]) -> Any:
    """Store rows of floats one after another as float64."""
    return stored(np.array(list(rows), np.float64))


def index_column(rows: Iterable[Any]) -> Any:
    """Store rows of unsigned integers one after another."""
    return stored(np.array(list(rows), np.uint32))


def stored(rows: NDArray[Any]) -> Any:
    """Store rows, (n, width) of float32, float64 or uint32, flat, where a kernel finds them.

    A row of three takes the place of four: the processor then loads it at once, and not number by number. A few rows
    are data of the kernel, a list of tuples: to select a row among them takes less than to load one for each lane.
    Scalar variants get plain Python numbers.
    """
    values = np.ascontiguousarray(rows)
    if values.shape[-1] == 3:
        values = np.pad(values, ((0, 0), (0, 1)))
    if not dr.is_jit_v(mi.Float):
        return values.ravel().tolist()
    if 0 < len(values) <= FEW_ROWS:
        kind = _type_of(values)
        return [tuple(opaque(kind(number)) for number in row) for row in values.tolist()]
    return owned(values.ravel())


def owned(values: NDArray[Any]) -> Any:
    """Copy numbers of float32, float64 or uint32 into Dr.Jit's own memory.

    Numpy's would be shared, and may be aligned less: a gather of pairs is then compiled otherwise, so that the kernel
    would depend on where numpy happened to allocate.
    """
    kind = _type_of(values)
    table = dr.empty(kind, values.size)
    dr.scatter(table, kind(values), dr.arange(mi.UInt32, values.size), mode=dr.ReduceMode.Permute)
    dr.eval(table)
    return table


def _type_of(values: NDArray[Any]) -> Any:
    return {"float32": mi.Float, "float64": mi.Float64, "uint32": mi.UInt32}[values.dtype.name]


def opaque(value: Any) -> Any:
    """Keep a number, vector or colour as data of the kernel, so that another value is no other kernel."""
    dr.make_opaque(value)
    return value


def fetch(kind: Any, table: Any, row: Any, active: Any = True) -> Any:
    """Row number `row` of `table` as a `kind`: a number, a vector or a colour.

    A literal `row` stays data: Dr.Jit makes it a parameter of the kernel, which another value does not recompile.
    """
    width = max(1, dr.size_v(kind)) if dr.depth_v(kind) else 1
    if dr.is_jit_v(mi.Float):
        if isinstance(table, list):
            first, *others = (kind(*numbers[:width]) for numbers in table)
            for i, other in enumerate(others, 1):
                first = dr.select(row == i, other, first)
            return first
        if width == 3:
            four = {dr.VarType.UInt32: mi.Vector4u, dr.VarType.Float64: mi.Vector4d}.get(dr.type_v(kind), mi.Vector4f)
            return kind(dr.gather(four, table, mi.UInt32(row), active).xyz)
        return dr.gather(kind, table, mi.UInt32(row), active)
    if not active:
        return dr.zeros(kind)
    if width == 1:
        return table[row]
    stride = 4 if width == 3 else width
    return kind(*table[stride * row : stride * row + width])
