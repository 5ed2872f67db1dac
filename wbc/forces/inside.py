"""Between a problem as it is given and the coordinates inside, in which it is solved.

Inside, components are divided by `scale`, so that every friction cone is z ≥ |s|; contacts and
joints stand in the order of `Blocks`; moments are divided by a length. What stays the same from
tick to tick is packed into one array of integers and one of doubles: handing an array to compiled
code costs about as much as a Newton step on one finger.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.forces.arrow import Shape, largest, largest_term, unbalanced
from wbc.forces.blocks import Blocks, HandJacobian, pattern
from wbc.forces.cones import cone_margins
from wbc.forces.cost import moment_arm
from wbc.forces.newton import Barrier, Constraints
from wbc.forces.problem import GraspForceProblem

# places in `Inside.layout`
_N, _B, _L, _OWN, _SHARED, _ROWS = range(6)
_HEAD = 6
# places in `Inside.fixed`
_PRESS, REST = range(2)
_FIXED = 2


class Inside(NamedTuple):
    """What of a problem stays: sizes and order, limits, friction and weights, packed.

    Attributes:
        layout: sizes, then contact, block, joint, rows, order, joints, own_at, shared_at, and which
            of the problem's joints have limits.
        fixed: 2 w_p, the force c_z = √(w_bF μ / w_p) at rest, then scale (M,) inside, limits
            (2, l'), barrier weights of the limits (2, l'), 2 w_bF μ (n,), factors of G's rows (6,).
    """

    layout: IntArray
    fixed: Array


def pack(problem: GraspForceProblem, blocks: Blocks) -> Inside:
    """Pack what stays of a problem."""
    own_at, shared_at = pattern(problem, blocks)
    sizes = [
        problem.contacts, len(blocks.block) - 1, len(blocks.joints), len(own_at), len(shared_at),
        problem.size,
    ]  # fmt: skip
    layout = np.concatenate(
        [
            np.array(sizes), blocks.contact, blocks.block, blocks.joint, blocks.rows,
            blocks.order, blocks.joints, own_at, shared_at.ravel(),
            np.isin(np.arange(problem.joints), blocks.joints),
        ]
    )  # fmt: skip
    j = blocks.joints
    limit = np.array([problem.tau_min[j], problem.tau_max[j]])
    weight = np.tile(problem.w_bT * (limit[1] - limit[0]), (2, 1))
    rows = np.repeat([1.0, 1.0 / moment_arm(problem)], 3)
    rest = np.sqrt(problem.w_bF * problem.mu.mean() / problem.w_p)
    fixed = np.concatenate(
        [
            [2.0 * problem.w_p, rest], problem.scale[blocks.rows], limit.ravel(),
            weight.ravel(), 2.0 * problem.w_bF * problem.mu[blocks.order], rows,
        ]
    )  # fmt: skip
    return Inside(layout.astype(np.int64), np.ascontiguousarray(fixed))


@kernel
def orders_of(layout: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """rows, order and joints of a layout, as in `Blocks`."""
    a = _HEAD + layout[_N] + 2 * layout[_B] + 3
    b = a + layout[_ROWS]
    c = b + layout[_N]
    return layout[a:b], layout[b:c], layout[c : c + layout[_L]]


@kernel
def entries_of(layout: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """own_at and shared_at of a layout, as `pattern` gives them, and which joints have limits."""
    a = _HEAD + 2 * layout[_N] + 2 * layout[_B] + 3 + layout[_ROWS] + layout[_L]
    b = a + layout[_OWN]
    c = b + layout[_SHARED] * layout[_ROWS]
    return layout[a:b], layout[b:c], layout[c:]


@kernel
def unpacked(
    layout: IntArray, fixed: Array, own: Array, shared: Array
) -> tuple[Constraints, Barrier, Array]:
    """Constraints with room for G, τ_e and h, the cost's weights, and the scale (M,)."""
    n, blocks, joints, m = layout[_N], layout[_B], layout[_L], layout[_ROWS]
    a = _HEAD
    b = a + n + 1
    c = b + blocks + 1
    shape = Shape(layout[a:b], layout[b:c], layout[c : c + blocks + 1])
    a = _FIXED + m
    b = a + 2 * joints
    c = b + 2 * joints
    given = Constraints(
        shape, HandJacobian(own, shared), np.empty((m, 6)), np.empty(joints),
        fixed[a:b].reshape(2, joints), np.empty(6),
    )  # fmt: skip
    barrier = Barrier(fixed[_PRESS], fixed[c : c + n], fixed[b:c].reshape(2, joints))
    return given, barrier, fixed[_FIXED : _FIXED + m]


@kernel
def take_jacobian(layout: IntArray, jacobian: Array, into: HandJacobian) -> bool:
    """Fill the blocks from J (M, l); False where J has an entry beside them."""
    own_at, shared_at, limited = entries_of(layout)
    own, shared = into
    flat = jacobian.reshape(jacobian.size)
    found, size = 0, shared.shape[1]
    for k in range(len(own)):
        own[k] = flat[own_at[k]]
        found += own[k] != 0.0
    for a in range(shared.shape[0]):
        for i in range(size):
            shared[a, i] = flat[shared_at[a * size + i]]
            found += shared[a, i] != 0.0
    for i in range(jacobian.shape[0]):
        for j in range(jacobian.shape[1]):
            found -= limited[j] != 0 and jacobian[i, j] != 0.0
    return bool(found == 0)


@kernel
def take(
    layout: IntArray, fixed: Array, grasp: Array, tau_e: Array, h_e: Array, given: Constraints
) -> bool:
    """Fill Gᵀ, τ_e and h of given and scale its J; False where a number is not finite."""
    rows, _, joints = orders_of(layout)
    scale, factors = fixed[_FIXED:], fixed[-6:]
    own, shared = given.jacobian
    contact, block, joint = given.shape
    total = 0.0
    for k in range(6):
        given.h[k] = factors[k] * h_e[k]
        total += given.h[k]
    for i in range(len(rows)):
        for k in range(6):
            given.gt[i, k] = grasp[k, rows[i]] * factors[k] * scale[i]
            total += given.gt[i, k]
    for j in range(len(joints)):
        given.tau_e[j] = tau_e[joints[j]]
        total += given.tau_e[j]
    value = 0
    for b in range(len(block) - 1):
        first = contact[block[b]]
        size = contact[block[b + 1]] - first
        for _ in range(joint[b], joint[b + 1]):
            for i in range(size):
                own[value + i] *= scale[first + i]
                total += own[value + i]
            value += size
    for a in range(shared.shape[0]):
        for i in range(shared.shape[1]):
            shared[a, i] *= scale[i]
            total += shared[a, i]
    return bool(np.isfinite(total))


@kernel
def margins(
    layout: IntArray, given: Constraints, u: Array, tau: Array, cone_margin: Array,
    torque_margin: Array,
) -> float:  # fmt: skip
    """Fill margins of cones (n,) and torques (l,), in the problem's order; inf without a limit.

    Returns:
        The smallest of all, as a share of c_z or of half the torque range.
    """
    room, contact, limit = np.inf, given.shape.contact, given.limit
    _, order, joints = orders_of(layout)
    torque_margin[:] = np.inf
    for j in range(len(joints)):
        margin = min(tau[j] - limit[0, j], limit[1, j] - tau[j])
        torque_margin[joints[j]] = margin
        room = min(room, 2.0 * margin / (limit[1, j] - limit[0, j]))
    cones = np.empty(len(order))
    cone_margins(contact, u, cones)
    for i in range(len(order)):
        z = u[contact[i] + 2]
        cone_margin[order[i]] = cones[i]
        room = min(room, cones[i] / z if z > 0.0 else cones[i])
    return room


@kernel
def add_unlimited(layout: IntArray, jacobian: Array, c: Array, tau: Array) -> None:
    """Add Jᵀ c to the torques of joints without limits, which are not inside."""
    _, _, limited = entries_of(layout)
    for i in range(jacobian.shape[0]):
        for j in range(jacobian.shape[1]):
            if limited[j] == 0:
                tau[j] += jacobian[i, j] * c[i]


@kernel
def imbalance(given: Constraints, u: Array) -> float:
    """|G u − h| over the largest of |h| and |G_i u_i|, entries of components."""
    rest = np.empty(6)
    unbalanced(given.gt, u, given.h, rest)
    return largest(rest) / largest_term(given.gt, u, given.h)
