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


def column(rows: Iterable[Any]) -> Any:
    """Store rows of floats one after another as float32."""
    return stored(mi.Float, np.array(list(rows), np.float32))


def index_column(rows: Iterable[Any]) -> Any:
    """Store rows of unsigned integers one after another."""
    return stored(mi.UInt32, np.array(list(rows), np.uint32))


def stored(kind: Any, values: Any) -> Any:
    """Store an array of any shape, flat, where a kernel finds it; plain Python numbers in scalar variants."""
    if not dr.is_jit_v(mi.Float):
        return values.ravel().tolist()
    flat = np.ascontiguousarray(values, np.uint32 if kind is mi.UInt32 else np.float32).ravel()
    # A copy in Dr.Jit's own memory. Numpy's would be shared, and may be aligned less: a gather of pairs is then
    # compiled otherwise, so that the kernel would depend on where numpy happened to allocate.
    table = dr.empty(kind, len(flat))
    dr.scatter(table, kind(flat), dr.arange(mi.UInt32, len(flat)), mode=dr.ReduceMode.Permute)
    dr.eval(table)
    return table


def opaque(value: Any) -> Any:
    """Keep a number, vector or colour as data of the kernel, so that another value is no other kernel."""
    dr.make_opaque(value)
    return value


def fetch(kind: Any, table: Any, row: Any, active: Any = True) -> Any:
    """Row number `row` of `table` as a `kind`: a number, a vector or a colour.

    A literal `row` stays data: Dr.Jit makes it a parameter of the kernel, which another value does not recompile.
    """
    if dr.is_jit_v(mi.Float):
        return dr.gather(kind, table, mi.UInt32(row), active)
    if not active:
        return dr.zeros(kind)
    if dr.depth_v(kind) == 0:
        return table[row]
    width = dr.size_v(kind)
    return kind(*table[width * row : width * (row + 1)])
