"""Vectors of three numbers for the kernels, as tuples that compiled code keeps in registers."""

from __future__ import annotations

from wbc.arrays import Array
from wbc.compiled import kernel

Vector = tuple[float, float, float]


@kernel
def vector(row: Array) -> Vector:
    """A row (3,) as a vector."""
    return (row[0], row[1], row[2])


@kernel
def dot(a: Vector, b: Vector) -> float:
    """a·b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@kernel
def scaled(s: float, a: Vector) -> Vector:
    """s a."""
    return (s * a[0], s * a[1], s * a[2])


@kernel
def added(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])
