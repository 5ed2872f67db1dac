"""The published law on the full extended system, where `Law` is asked for it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray
from wbc.contact.extended_finger import ExtendedKinematics, HeldEdge, extended_jacobian
from wbc.contact.grasp import ContactMode
from wbc.control.task_stack import TaskStack
from wbc.stack.printed import PrintedLevel, solve_printed


class PrintedAnswer(NamedTuple):
    """What `Law.solve` makes its answer of.

    Attributes:
        main, total: (nv + 5N,) in the layout of `Motion`.
        rank, independence: of J̃; the latter its smallest singular value over its largest.
    """

    main: Array
    total: Array
    rank: int
    independence: float


@final
class PrintedLaw:
    """Assembles (37) from the tick's kinematics and tasks.

    The right-hand sides are the settled law's, errors saturated and targets' rates fed forward:
    what can be compared is the law. Rows out of force leave J^A, as those of (47), (48) do.
    """

    def __init__(self, kin: ExtendedKinematics, stack: TaskStack, passive_weight: float) -> None:
        self._kin = kin
        self._stack = stack
        nv, n = kin.robot.model.nv, kin.grasp.count
        self._size = nv + 5 * n
        self._metric = np.concatenate([1.0 / stack.scale**2, np.full(5 * n, passive_weight)])
        # where the columns of `extended_jacobian` are in q̃̇ = [q̇, ξ̇ (N, 2), θ̇ (N, 3)], and the
        # mode from which on each of a finger's is a variable
        axes = [2] if kin.grasp.planar else [0, 1, 2]
        places, since = list(range(nv)), []
        for i in range(n):
            places += [nv + 2 * i + k for k in range(kin.grasp.n_xi)]
            places += [nv + 2 * n + 3 * i + k for k in axes]
            since += [ContactMode.SLIDING] * kin.grasp.n_xi + [ContactMode.FIXED] * len(axes)
        self._place: IntArray = np.array(places)
        self._since: IntArray = np.array(since, dtype=np.int64)

    def solve(
        self, order: IntArray, activation: Array, gradient: Array, eta: Array,
        edges: Sequence[HeldEdge] = (),
    ) -> PrintedAnswer:  # fmt: skip
        """The law at the configuration last evaluated.

        Args:
            order: levels from the highest priority down.
            activation: (L,) ρ of each level.
            gradient: (nv,) k_∇ ∇C.
            eta: (L,) filled: share of its gain each level has, 0 where it is not in force.
            edges: rows of the main task beside (35), as in `ExtendedKinematics.hold`.
        """
        rows, rhs = extended_jacobian(self._kin)
        if edges:
            rows = np.vstack([rows, *(self._across(edge) for edge in edges)])
            rhs = np.append(rhs, [edge.rate for edge in edges])
        live = self._live()
        rows, free = rows[:, live], self._place[live]
        in_force = [k for k in order if self._in_force(k, activation)]
        levels = [self._level(k, activation, free) for k in in_force]
        descent = np.zeros(self._size)
        descent[: len(gradient)] = gradient
        found = solve_printed(rows, rhs, self._metric[free], levels, descent[free])
        eta[:] = 0.0
        eta[in_force] = found.eta
        main, total = np.zeros(self._size), np.zeros(self._size)
        main[free], total[free] = found.main, found.total
        return PrintedAnswer(main, total, found.rank, _independence(rows, found.rank))

    def _across(self, edge: HeldEdge) -> Array:
        """The row of ξ̇ across an edge, over the columns of `extended_jacobian`."""
        row = np.zeros(self._size)
        first = self._kin.robot.model.nv + 2 * edge.finger
        row[first : first + 2] = edge.direction
        picked: Array = row[self._place]
        return picked

    def _live(self) -> BoolArray:
        """Which columns of `extended_jacobian` are variables: contacts hold some of them."""
        n = self._kin.grasp.count
        mode = np.repeat(self._kin.state.mode, len(self._since) // n if n else 0)
        joints = np.ones(len(self._place) - len(self._since), dtype=np.bool_)
        return np.concatenate([joints, mode >= self._since])

    def _in_force(self, level: int, activation: Array) -> bool:
        first = self._stack.level_start[level]
        return bool(activation[level] * self._stack.row_activation[first] > 0.0)

    def _level(self, level: int, activation: Array, free: IntArray) -> PrintedLevel:
        stack, nv = self._stack, self._kin.robot.model.nv
        start = stack.level_start[level]
        mine = slice(start, start + stack.level_size[level])
        jacobian = np.zeros((stack.level_size[level], self._size))
        over = stack.jacobian_ext[mine]
        jacobian[:, : over.shape[1]] = over
        # the settled law's right-hand side, before what ξ̇ does without q̇ was taken off
        rhs = stack.rhs[mine] + over[:, nv:] @ self._kin.xi_drift.ravel()
        return PrintedLevel(jacobian[:, free], rhs, float(activation[level]))


def _independence(rows: Array, rank: int) -> float:
    if rank == 0:
        return 1.0
    values = np.linalg.svd(rows, compute_uv=False)
    return float(values[-1] / values[0])
