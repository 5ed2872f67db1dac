"""The first-stage law (35), (37): from a configuration and gains to the velocity of q̃."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.contact.extended_finger import ExtendedKinematics, HeldEdge
from wbc.contact.grasp import ContactState, ObjectReference
from wbc.control.printed_law import PrintedLaw
from wbc.control.task_stack import TaskStack
from wbc.costs import Cost
from wbc.robot.distances import Distances
from wbc.robot.kinematics import Kinematics
from wbc.rotations import exp_so3, multiply
from wbc.stack.projection import solve_weighted


class Motion(NamedTuple):
    """Velocity of q̃ for one evaluation of the law, in two parts that the limit filter may separate.

    Attributes:
        main: (nv + 5N,) of the main task alone: q̇, then ξ̇ (N, 2), then θ̇ (N, 3, turning rate of the
            contact frame in the fingertip's axes).
        total: (nv + 5N,) of the whole law.
    """

    main: Array
    total: Array


class Sight(NamedTuple):
    """How the last solve went.

    Attributes:
        independence: smallest independent share of the main task's rows, 1 = orthogonal or none.
        freedom: (L,) share of freedom each level found, 1 = all.
    """

    independence: float
    freedom: Array


class Locks(NamedTuple):
    """What may not move in a tick.

    Attributes:
        joints: (nv,) 0 for joints that are to stand still, else 1; None: all may move.
        edges: sliding contacts that come to the edge of their face.
    """

    joints: Array | None = None
    edges: tuple[HeldEdge, ...] = ()


UNLOCKED = Locks()


@final
class Law:
    """Workspaces and evaluation of the law; holds no state between evaluations.

    Attributes:
        kin: the tick's kinematics.
        stack: the tasks' rows.
        cost: C_Σ at the last evaluation (38).
        gradient: (nv,) ∇C_Σ over the joints.
        rank, independence: of the main task's rows at the last solve.
        freedom: (L,) share of freedom each level found.
    """

    def __init__(
        self,
        kin: ExtendedKinematics,
        stack: TaskStack,
        costs: Sequence[Cost],
        distances: Distances | None,
        gradient_gain: float,
        *,
        printed: bool = False,
        passive_weight: float = 1.0,
    ) -> None:
        """With `printed`, `solve` gives the published law (37) instead, to compare.

        `passive_weight` is then the metric of ξ and θ beside the joints'; `freedom` and
        `independence` are what `PrintedLaw` says of them.
        """
        self._printed = PrintedLaw(kin, stack, passive_weight) if printed else None
        self.kin = kin
        self.stack = stack
        self.costs = tuple(costs)
        self.distances = distances
        self.gradient_gain = gradient_gain
        nv, n = kin.robot.model.nv, kin.grasp.count
        rows, levels = len(stack.error), len(stack.level_start)
        self.cost, self._pace = 0.0, 1.0
        self.gradient: Array = np.zeros(nv)
        self.freedom: Array = np.ones(levels)
        self.rank, self.independence = 0, 1.0
        self._basis: Array = np.zeros((3 * n + rows, nv))
        self._taken: Array = np.zeros((rows, nv))
        self._share: Array = np.zeros(rows)
        self._main: Array = np.zeros(nv)
        self._rest: Array = np.zeros(nv)

    def evaluate(
        self, q: Array, contact: ContactState, reference: ObjectReference,
        targets: Sequence[Array | None], active: Sequence[bool], pace: float = 1.0,
    ) -> None:  # fmt: skip
        """Kinematics, tasks and costs at one configuration.

        Args:
            pace: share of their speed with which costs, and tasks but for the tips, descend.
        """
        kin = self.kin.update(q, contact, reference)
        self.stack.evaluate(kin, targets, active, pace)
        self._pace = pace
        self.gradient.fill(0.0)
        if self.distances is not None:
            self.distances.update(kin.robot, kin.object_position, kin.object_rotation)
        self.cost = 0.0
        for cost in self.costs:
            self.cost += cost.weight * cost.add_gradient(kin.robot, self.distances, self.gradient)

    def solve(self, order: IntArray, activation: Array, locks: Locks = UNLOCKED) -> Motion:
        """The law with the given gains, (L,), at the configuration last evaluated.

        The published law locks no joints.
        """
        if self._printed is not None:
            descent = self._pace * self.gradient_gain * self.gradient
            answer = self._printed.solve(order, activation, descent, self.freedom, locks.edges)
            self.rank, self.independence = answer.rank, answer.independence
            return Motion(answer.main, answer.total)
        kin, stack = self.kin, self.stack
        jacobian, scale, speed = stack.jacobian, stack.scale, self._pace * self.gradient_gain
        kin.hold(locks.edges)
        if locks.joints is not None:
            jacobian, scale = jacobian * locks.joints, scale * locks.joints
        self.rank, self.independence = solve_weighted(
            kin.rows[: kin.row_count], kin.rhs, jacobian, stack.rhs, stack.row_activation,
            stack.level_start, stack.level_size, stack.exact, order, activation, self.gradient,
            speed, scale, self._basis, self._taken, self._share, self._main,
            self._rest, self.freedom,
        )  # fmt: skip
        return Motion(*kin.extend(self._main, self._rest))

    def sight(self) -> Sight:
        """How the last solve went, copied out of the workspaces."""
        return Sight(self.independence, self.freedom.copy())


@final
@dataclass(frozen=True)
class CostForecast:
    """C_Σ at another q, with the object where it is: for the supervisor's predictions.

    Attributes:
        kin, distances: workspaces of their own, so that the tick's stay fresh.
    """

    costs: tuple[Cost, ...]
    kin: Kinematics
    distances: Distances | None

    def at(self, q: Array, now: Law) -> float:
        """C_Σ at q, (nv,).

        A joint moves no point of the robot further than its reach times its motion: where no pair
        can have come near since the law was evaluated, the distances need no second look.
        """
        distances, known = self.distances, now.distances
        if distances is not None and known is not None:
            least = known.least_after(now.kin.robot.q, q)
            distances = None if least > distances.near else distances
        if distances is None:
            self.kin.q[:] = q
        else:
            self.kin.update_placements(q)
            distances.update(self.kin, now.kin.object_position, now.kin.object_rotation)
        return sum(c.weight * c.value(self.kin, distances) for c in self.costs)


@kernel
def _move(
    q: Array, xi: Array, pivot: Array, rate: Array, time: float,
    q_out: Array, xi_out: Array, pivot_out: Array,
) -> None:  # fmt: skip
    nv, n = q.shape[0], xi.shape[0]
    q_out[:] = q + time * rate[:nv]
    for i in range(n):
        for k in range(2):
            xi_out[i, k] = xi[i, k] + time * rate[nv + 2 * i + k]
        turn = rate[nv + 2 * n + 3 * i : nv + 2 * n + 3 * i + 3]
        multiply(exp_so3(time * turn), pivot[i], pivot_out[i])


def moved(q: Array, contact: ContactState, rate: Array, time: float) -> tuple[Array, ContactState]:
    """q and η after moving at `rate` (nv + 5N,), a velocity of q̃ as in `Motion`, for a time."""
    q_out, xi, pivot = np.empty_like(q), np.empty_like(contact.xi), np.empty_like(contact.pivot)
    _move(q, contact.xi, contact.pivot, rate, time, q_out, xi, pivot)
    return q_out, contact._replace(xi=xi, pivot=pivot)
