"""Kinematic classification of a grasp after (33), and how much friction it needs to hold.

The chapter calls a grasp redundant when some extended finger can move with the object locked, and
indeterminate when the object can move with all active joints locked; it takes unit frictionless
equilibrium (44)-(45) for force closure, which holds for any nonzero friction. Here the least
friction that closes a grasp is computed, of which that is the limit: 0.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import linprog

from wbc.arrays import Array
from wbc.contact.extended_finger import ExtendedKinematics, extended_jacobian, finger_jacobians
from wbc.contact.grasp import ContactMode, GraspClass, equilibrium_residuals

_RANK = 1e-9  # share of the largest singular value below which one counts as zero
_EDGES = 24  # of a friction cone in space: the pyramid inside it is at most 0.9 % narrower
_LEAST_FRICTION, _MOST_FRICTION = 1e-4, 10.0
_HALVINGS = 22
_STRICT = 1e-7  # least share of each edge of a cone for a force to count as inside it


def classify(kin: ExtendedKinematics) -> GraspClass:
    """The grasp formed by the fingers in contact at `kin`."""
    grasp = kin.grasp
    touching = [i for i in range(grasp.count) if kin.state.mode[i] != ContactMode.FREE]
    jacobian = extended_jacobian(kin)[0][:, _columns(kin, touching)]
    singular = np.linalg.svd(jacobian, compute_uv=False) if len(touching) else np.zeros(1)
    smallest = float(singular[-1]) if jacobian.shape[1] >= jacobian.shape[0] else 0.0
    points, normals = kin.charts[touching, 0], kin.frame[touching, :, 2]
    return GraspClass(
        fingers=tuple(grasp.fingers[i] for i in touching),
        rows=jacobian.shape[0],
        columns=jacobian.shape[1],
        rank=_rank(_scaled_rows(jacobian, kin)),
        smallest_singular_value=smallest,
        condition=float(singular[0]) / smallest if smallest > 0.0 else math.inf,
        redundant_fingers=tuple(grasp.fingers[i] for i in touching if _is_redundant(kin, i)),
        free_motions=_free_motions(kin, touching),
        residuals=equilibrium_residuals(points, normals, grasp.share[touching]),
        friction_needed=friction_needed(points, normals, planar=grasp.planar),
    )


def _axes(kin: ExtendedKinematics) -> tuple[list[int], int, list[int]]:
    """Rows of a twist, number of chart coordinates and pivot axes that the grasp's kind has."""
    if kin.grasp.planar:
        return [0, 1, 5], 1, [2]
    return [0, 1, 2, 3, 4, 5], 2, [0, 1, 2]


def _columns(kin: ExtendedKinematics, touching: list[int]) -> list[int]:
    """Columns of `extended_jacobian` that belong to joints or to contact variables free to move."""
    _, n_xi, pivots = _axes(kin)
    nv, width = kin.robot.model.nv, n_xi + len(pivots)
    columns = list(range(nv))
    for i in touching:
        held = n_xi if kin.state.mode[i] != ContactMode.SLIDING else 0
        columns += range(nv + width * i + held, nv + width * (i + 1))
    return columns


def _passive(kin: ExtendedKinematics, i: int) -> tuple[Array, Array, Array]:
    """J_F, J_η and Gᵀ of finger i with the rows and the variables it has."""
    rows, n_xi, pivots = _axes(kin)
    j_f, j_xi, j_theta, _, g_t = finger_jacobians(kin, i)
    sliding = bool(kin.state.mode[i] == ContactMode.SLIDING)
    j_eta = np.hstack([j_xi[:, : n_xi if sliding else 0], j_theta[:, pivots]])
    return j_f[rows], j_eta[rows], g_t[np.ix_(rows, rows)]


def _is_redundant(kin: ExtendedKinematics, i: int) -> bool:
    """Whether [J_F J_η] over the finger's own joints has a null space."""
    model = kin.robot.model
    own = np.flatnonzero(model.support(model.frame(kin.robot.frames[i])))
    j_f, j_eta, _ = _passive(kin, i)
    both = _scaled_rows(np.hstack([j_f[:, own], j_eta]), kin)
    return _rank(both) < int(both.shape[1])


def _free_motions(kin: ExtendedKinematics, touching: list[int]) -> int:
    """Dimension of the common null space of all [−J_η Gᵀ], over every η̇_i and one v_o."""
    size = len(_axes(kin)[0])
    if not len(touching):
        return size
    parts = [_passive(kin, i) for i in touching]
    stacked = np.hstack([-block_diag(*(p[1] for p in parts)), np.vstack([p[2] for p in parts])])
    return int(stacked.shape[1] - _rank(_scaled_rows(stacked, kin)))


def _scaled_rows(matrix: Array, kin: ExtendedKinematics) -> Array:
    """Angular rows in metres at the object's size, so that a rank does not depend on units."""
    if not matrix.shape[0]:
        return matrix
    length = _size(kin.charts[:, 0])
    one = [1.0, 1.0, length] if kin.grasp.planar else [1.0, 1.0, 1.0, length, length, length]
    scaled: Array = matrix * np.tile(one, matrix.shape[0] // len(one))[:, None]
    return scaled


def _size(points: Array) -> float:
    """A length for the object: how far the contact points lie from their middle, [m]."""
    if not len(points):
        return 1.0
    size = float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())
    return size if size > 0.0 else max(float(np.linalg.norm(points[0])), 1e-3)


def _rank(matrix: Array) -> int:
    """Numerical rank after every column was brought to unit length."""
    norms = np.linalg.norm(matrix, axis=0)
    columns = matrix[:, norms > 0.0] / norms[norms > 0.0]
    if not columns.size:
        return 0
    singular = np.linalg.svd(columns, compute_uv=False)
    return int((singular > _RANK * singular[0]).sum())


def friction_needed(points: Array, normals: Array, *, planar: bool) -> float:
    """Least friction coefficient with which point contacts hold against any small wrench.

    Args:
        points: (n, 3) contact points, [m].
        normals: (n, 3) outward unit normals.

    Returns:
        0 where any nonzero friction will do, inf where no coefficient up to 10 does.
    """
    if len(points) < 2:
        return math.inf
    # about their middle and in units of their size: closure depends on neither
    arms = (points - points.mean(axis=0)) / _size(points)
    full = np.hstack([_wrenches(arms, _cone(normals, 1.0, planar, k), planar) for k in range(3)])
    if _rank(full.T) < full.shape[0] or not _closed(arms, normals, _MOST_FRICTION, planar):
        return math.inf
    if _closed(arms, normals, _LEAST_FRICTION, planar):
        return 0.0
    low, high = math.atan(_LEAST_FRICTION), math.atan(_MOST_FRICTION)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if _closed(arms, normals, math.tan(middle), planar):
            high = middle
        else:
            low = middle
    return math.tan(high)


def _closed(arms: Array, normals: Array, mu: float, planar: bool) -> bool:
    """Whether forces strictly inside all friction cones balance: 0 is inside the wrenches' hull."""
    edges = 2 if planar else _EDGES
    wrenches = np.hstack(
        [_wrenches(arms, _cone(normals, mu, planar, k), planar) for k in range(edges)]
    )
    count = wrenches.shape[1]
    # find shares s_j >= t that sum to 1 and balance, with t as large as possible
    equal = np.zeros((wrenches.shape[0] + 1, count + 1))
    equal[:-1, :count], equal[-1, :count] = wrenches, 1.0
    right = np.zeros(len(equal))
    right[-1] = 1.0
    above = np.hstack([-np.eye(count), np.ones((count, 1))])
    found = linprog(
        np.append(np.zeros(count), -1.0), A_ub=above, b_ub=np.zeros(count), A_eq=equal, b_eq=right,
        bounds=[(0.0, None)] * count + [(None, None)], method="highs",
    )  # fmt: skip
    return bool(found.success and found.x[-1] > _STRICT)


def _cone(normals: Array, mu: float, planar: bool, k: int) -> Array:
    """Edge k of every friction cone, pointing into the object: (n, 3)."""
    if planar:
        tangents = np.column_stack((-normals[:, 1], normals[:, 0], np.zeros(len(normals))))
        return (mu if k % 2 else -mu) * tangents - normals
    helper = np.where(np.abs(normals[:, 2:]) < 0.9, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    first = np.cross(helper, normals)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    angle = 2.0 * math.pi * k / _EDGES
    across = math.cos(angle) * first + math.sin(angle) * np.cross(normals, first)
    edge: Array = mu * across - normals
    return edge


def _wrenches(arms: Array, forces: Array, planar: bool) -> Array:
    """Columns (f, c × f) of unit size: (6, n), or (3, n) of x, y and the moment in the plane."""
    columns = np.vstack([forces.T, np.cross(arms, forces).T])
    columns = columns[[0, 1, 5]] if planar else columns
    return np.asarray(columns / np.linalg.norm(forces, axis=1))
