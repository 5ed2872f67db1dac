"""Stacks to solve, as values, and an oracle for them that shares nothing with the solver."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wbc.stack.projection import solve_stack

EXACT = 0.1


@dataclass(frozen=True)
class Level:
    """Rows (m, n) that are to move at rhs (m,), their gain ρ, the share from which it is exact."""

    rows: np.ndarray
    rhs: np.ndarray
    rho: float = 1.0
    exact: float = EXACT


@dataclass(frozen=True)
class Stack:
    """A main task, levels from the highest priority down, and what is descended in the rest."""

    main: Level
    levels: tuple[Level, ...]
    gradient: np.ndarray

    @property
    def n(self) -> int:
        return self.main.rows.shape[1]

    def up_to(self, count: int) -> Stack:
        """The first `count` levels alone."""
        return replace(self, levels=self.levels[:count], gradient=np.zeros(self.n))

    def with_level(self, place: int, **changes: object) -> Stack:
        levels = list(self.levels)
        levels[place] = replace(levels[place], **changes)  # type: ignore[arg-type]
        return replace(self, levels=tuple(levels))


@dataclass(frozen=True)
class Solution:
    """What `solve_stack` fills and returns."""

    main: np.ndarray
    v: np.ndarray
    freedom: np.ndarray
    rank: int
    independence: float


def level(rows: object, rhs: object = 0.0, rho: float = 1.0, exact: float = EXACT) -> Level:
    """A level from anything that looks like rows."""
    matrix = np.atleast_2d(np.array(rows, dtype=float))
    return Level(matrix, np.broadcast_to(np.array(rhs, float), matrix.shape[:1]).copy(), rho, exact)


def make_stack(
    n: int,
    levels: Sequence[Level],
    main: Level | None = None,
    gradient: np.ndarray | None = None,
) -> Stack:
    main = main or Level(np.zeros((0, n)), np.zeros(0))
    return Stack(main, tuple(levels), np.zeros(n) if gradient is None else gradient)


def solve(
    stack: Stack, order: Sequence[int] | None = None, fading: Sequence[float] | None = None
) -> Solution:
    """Solve with workspaces full of rubbish, which must not matter.

    Args:
        order: levels from the highest priority down; the stack's own order if not given.
        fading: row activation of each level.
    """
    n, levels = stack.n, stack.levels
    size = np.array([len(level.rows) for level in levels], dtype=np.int64)
    start = np.cumsum(size) - size
    rows = np.vstack([np.zeros((0, n))] + [level.rows for level in levels])
    rhs = np.concatenate([np.zeros(0)] + [level.rhs for level in levels])
    activation = np.ones(len(rhs))
    for first, value in zip(start, fading or (), strict=bool(fading)):
        activation[first] = value
    v_main, v, freedom = np.full(n, np.nan), np.full(n, np.nan), np.full(len(levels), np.nan)
    rank, independence = solve_stack(
        stack.main.rows.copy(), stack.main.rhs.copy(), rows, rhs, activation, start, size,
        np.array([level.exact for level in levels]),
        np.array(range(len(levels)) if order is None else order, dtype=np.int64),
        np.array([level.rho for level in levels]), stack.gradient.copy(),
        np.full((len(stack.main.rows) + len(rows), n), np.nan), np.full(rows.shape, np.nan),
        np.full(len(rows), np.nan), v_main, v, freedom,
    )  # fmt: skip
    return Solution(v_main, v, freedom, rank, independence)


def projector(stack: Stack) -> np.ndarray:
    """(n, n) the N that is left below the stack, column by column."""
    start = solve(replace(stack, gradient=np.zeros(stack.n))).v
    columns = [solve(replace(stack, gradient=-e)).v - start for e in np.eye(stack.n)]
    return np.stack(columns, axis=1)


def null_space(rows: np.ndarray, cut: float = 1e-9) -> np.ndarray:
    """(n, k) orthonormal columns that the rows do not see."""
    if not len(rows):
        return np.eye(rows.shape[1])
    _, s, vt = np.linalg.svd(rows)
    rank = int(np.sum(s > cut * max(s[0], 1e-300)))
    return np.ascontiguousarray(vt[rank:].T)


def lexicographic(stack: Stack) -> np.ndarray:
    """(n,) each level's least squares among the minimisers of those above, by explicit bases."""
    n = stack.n
    v, basis = np.zeros(n), np.eye(n)
    for here in (stack.main, *stack.levels):
        if not basis.shape[1] or not len(here.rows):
            continue
        left = here.rows @ basis
        left[np.abs(left) < 1e-9 * np.abs(here.rows).max()] = 0.0
        v = v + basis @ np.linalg.lstsq(left, here.rhs - here.rows @ v, rcond=1e-9)[0]
        basis = basis @ null_space(left)
    return v - basis @ (basis.T @ stack.gradient)


def seeded(*key: object) -> np.random.Generator:
    """A generator for the test that is named by `key`, the same on every machine."""
    return np.random.default_rng(zlib.crc32(repr(key).encode()))


def directions(rng: np.random.Generator, count: int, n: int) -> np.ndarray:
    """(count, n) orthonormal rows, anywhere."""
    return np.ascontiguousarray(np.linalg.qr(rng.normal(size=(n, n)))[0][:count])


def conditioned(rng: np.random.Generator, m: int, n: int, condition: float) -> np.ndarray:
    """(m, n) rows with singular values spread evenly (in the logarithm) from 1 to 1/condition."""
    left = np.linalg.qr(rng.normal(size=(m, m)))[0]
    values = np.geomspace(1.0, 1.0 / condition, m) if m > 1 else np.ones(1)
    return left @ (values[:, None] * directions(rng, m, n))


def random_levels(rng: np.random.Generator, n: int, sizes: Sequence[int]) -> list[Level]:
    return [level(rng.normal(size=(m, n)), rng.normal(size=m)) for m in sizes]
