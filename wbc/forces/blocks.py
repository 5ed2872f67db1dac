"""The sparsity of a hand: which joints move which fingers, and the order that makes use of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.arrays import Array, BoolArray, IntArray
from wbc.forces.problem import GraspForceProblem

_MOST_ROWS = 12
"""Components in one block: four point contacts of one finger. Its cost grows with the cube."""


class Blocks(NamedTuple):
    """Contacts in blocks that share no joint, but for a few joints that move many blocks.

    A joint that moves contacts of one block only is that block's own; the others (arms, torso) are
    shared. Inside, contacts and joints stand in the order of the blocks, shared joints last.

    Attributes:
        contact: (n + 1,) first component of each contact, inside.
        block: (B + 1,) first contact of each block, inside.
        joint: (B + 1,) first own joint of each block, inside; from joint[B] on they are shared.
        rows: (M,) component of c at each place inside.
        order: (n,) contact of the problem at each place inside.
        joints: (l',) joint of the problem at each place inside; only those with limits.
    """

    contact: IntArray
    block: IntArray
    joint: IntArray
    rows: IntArray
    order: IntArray
    joints: IntArray

    @property
    def shared(self) -> int:
        """Number of shared joints, n_a."""
        return len(self.joints) - int(self.joint[-1])


def find_blocks(problem: GraspForceProblem, moves: BoolArray | None = None) -> Blocks:
    """Blocks of a problem's contacts, by which joints move them.

    Args:
        moves: (l, n) whether joint j can ever move contact i; found from J's zeros if not given.
    """
    n = problem.contacts
    if moves is None:
        moves = np.logical_or.reduceat(problem.J != 0.0, problem.first, axis=0).T
    limited = problem.limited
    group = np.arange(n)  # of each contact: the lowest contact of its block
    support = [np.flatnonzero(moves[j]) for j in limited]
    for k in sorted(range(len(limited)), key=lambda k: len(support[k])):
        together = np.isin(group, group[support[k]])
        if len(support[k]) > 1 and problem.dims[together].sum() <= _MOST_ROWS:
            group[together] = group[together].min()
    order = np.argsort(group, kind="stable")
    starts = np.flatnonzero(np.diff(group[order], prepend=-1))
    block = np.append(starts, n)
    number = np.zeros(n, dtype=np.int64)  # of each contact: its block
    number[order] = np.searchsorted(starts, np.arange(n), side="right") - 1
    own: list[list[int]] = [[] for _ in starts]
    shared = []
    for j, contacts in zip(limited, support, strict=True):
        blocks = set(number[contacts].tolist())
        if len(blocks) > 1:
            shared.append(int(j))
        else:  # one that moves no contact goes anywhere
            own[blocks.pop() if blocks else 0].append(int(j))
    counts = [len(joints) for joints in own]
    dims = problem.dims[order]
    return Blocks(
        contact=np.append(0, np.cumsum(dims)),
        block=block.astype(np.int64),
        joint=np.append(0, np.cumsum(counts)).astype(np.int64),
        rows=np.concatenate(
            [problem.first[i] + np.arange(m) for i, m in zip(order, dims, strict=True)]
        ),
        order=order.astype(np.int64),
        joints=np.array([j for joints in own for j in joints] + shared, dtype=np.int64),
    )


def pattern(problem: GraspForceProblem, blocks: Blocks) -> tuple[IntArray, IntArray]:
    """Where the Jacobian's entries are taken from: indices into J's M·l entries in C order.

    Returns:
        Those of the blocks' own joints, joint by joint over its block's components; and (n_a, M)
        those of the shared joints.
    """
    l_joints = problem.joints
    own = []
    for b in range(len(blocks.block) - 1):
        first, last = (blocks.contact[blocks.block[b + k]] for k in range(2))
        for j in blocks.joints[blocks.joint[b] : blocks.joint[b + 1]]:
            own.append(blocks.rows[first:last] * l_joints + j)
    shared = blocks.joints[blocks.joint[-1] :]
    none = np.zeros(0, dtype=np.int64)
    return (
        np.concatenate(own) if own else none,
        blocks.rows[None, :] * l_joints + shared[:, None],
    )


class HandJacobian(NamedTuple):
    """J in the form of its blocks, for hands whose M·l entries would be mostly zeros.

    Joints without limits have no entries: of the τ that a solution reports, theirs is then τ_e.

    Attributes:
        own: entries of the blocks' own joints, joint by joint over its block's components.
        shared: (n_a, M) rows of the shared joints, columns in the order inside.
    """

    own: Array
    shared: Array
