"""What independent packages say of a grasping-force problem: Clarabel, with second-order cones, and
DAQP, with pyramids in their place.

Everything is solved in numbers without units: forces in multiples of `Units.force`, moments in
those times `Units.arm`, torques in half widths of their limits, tangential components over μ.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any, Final, Literal, NamedTuple, final

import clarabel
import daqp
import numpy as np
from scipy import sparse
from scipy.spatial import HalfspaceIntersection

from wbc.arrays import Array, IntArray
from wbc.forces import GraspForceProblem
from wbc.forces.cost import moment_arm

Kind = Literal["exact", "margin", "load"]

TIGHT: Final = 1e-10
"""Tolerance of Clarabel where it is the judge; where it is timed it has its own, 1e-8."""
CAP: Final = 1.0
"""Largest margin that is looked for: without torque limits internal forces grow for ever."""


class Units(NamedTuple):
    """What makes a problem's numbers free of units."""

    force: float  # [N]
    arm: float  # [m]

    @classmethod
    def of(cls, problem: GraspForceProblem) -> Units:
        """The wrench's size; without a wrench, the force that the joints' limits allow."""
        arm = moment_arm(problem)
        force, moment = np.linalg.norm(problem.h_e[:3]), np.linalg.norm(problem.h_e[3:])
        size = float(np.hypot(force, moment / arm))
        if size == 0.0 and len(j := problem.limited):
            lever = np.linalg.norm(problem.J[:, j], axis=0)
            width = (problem.tau_max - problem.tau_min)[j]
            size = float(np.median(width[lever > 0.0] / lever[lever > 0.0]))
        return cls(size or 1.0, arm)


class ConeAnswer(NamedTuple):
    """What Clarabel says.

    Attributes:
        c: (M,) contact forces, [N], [Nm].
        value: Σ c_z [N], the margin or the load factor, by the kind of program.
        status: Clarabel's word.
    """

    c: Array
    value: float
    status: str


@final
class ConeProgram:
    """One of three second-order-cone programs over the forces of a problem, for Clarabel.

    exact: min Σ c_z with G c = h_e, the cones (2)-(3) and the torque limits (5).
    margin: max t ≤ 1 with G c = h_e, c_z − |s| ≥ t F₀, τ at least t Δ/2 away from each limit, Δ its
        width: how far inside the problem is feasible, or, below zero, how far it is from it.
    load: max λ with G c = λ h_e, the cones and the limits.

    The instance keeps Clarabel's solver; `update` hands it the numbers of another problem with the
    same contacts, limits and zeros of J.
    """

    def __init__(
        self, problem: GraspForceProblem, kind: Kind = "exact", *, limits: bool = True,
        tolerance: float | None = TIGHT,
    ) -> None:  # fmt: skip
        self.kind, self.problem, self.units = kind, problem, Units.of(problem)
        self._j = problem.limited if limits else np.zeros(0, dtype=np.int64)
        self._half = 0.5 * (problem.tau_max - problem.tau_min)[self._j]
        rows, columns = np.nonzero(problem.J[:, self._j])
        self._in_j = rows, self._j[columns]
        self._levers = problem.scale[rows] * self.units.force / self._half[columns]
        self._rows = np.repeat([1.0, 1.0 / self.units.arm], 3)[:, None] * problem.scale
        self._entries(rows, columns)
        self._cost()
        self.settings = _settings(tolerance)
        self.solver = self.fresh(problem.G, problem.J, problem.tau_e, problem.h_e)

    def _entries(self, rows: IntArray, columns: IntArray) -> None:
        """Where every number stands in Clarabel's A, and those that no problem changes."""
        problem, l_joints = self.problem, len(self._j)
        m, extra = problem.size, int(self.kind != "exact")
        capped = int(self.kind == "margin")
        grid = np.indices((6, m)).reshape(2, -1)
        first_cone = 6 + 2 * l_joints + capped
        # Clarabel's cone has its axis first
        cone = np.concatenate([np.r_[k + 2, k : k + 2, k + 3 : k + d] for k, d in self._blocks()])
        axes = first_cone + problem.first
        along = np.arange(6, first_cone)
        parts = [
            (*grid, np.zeros(6 * m)),
            (6 + columns, rows, np.zeros(len(rows))),
            (6 + l_joints + columns, rows, np.zeros(len(rows))),
            (first_cone + np.arange(m), cone, np.full(m, -1.0)),
        ]
        if self.kind == "margin":
            parts += [(along, np.full(len(along), m), np.ones(len(along)))]
            parts += [(axes, np.full(len(axes), m), np.ones(len(axes)))]
        if self.kind == "load":
            parts += [(np.arange(6), np.full(6, m), np.zeros(6))]
        i, j, self._flat = (np.concatenate([np.asarray(p[k]) for p in parts]) for k in range(3))
        marks = sparse.csc_matrix((1.0 + np.arange(len(i)), (i, j)), (first_cone + m, m + extra))
        self._order = np.asarray(np.rint(marks.data) - 1.0, dtype=np.int64)
        self._pattern = marks
        self._b = np.zeros(first_cone + m)
        if capped:
            self._b[first_cone - 1] = CAP
        self._cones: list[Any] = [clarabel.ZeroConeT(6)]
        if first_cone > 6:
            self._cones.append(clarabel.NonnegativeConeT(first_cone - 6))
        self._cones += [clarabel.SecondOrderConeT(int(d)) for d in problem.dims]

    def _blocks(self) -> Iterator[tuple[int, int]]:
        return zip(self.problem.first.tolist(), self.problem.dims.tolist(), strict=True)

    def _cost(self) -> None:
        self._q = np.zeros(self._pattern.shape[1])
        if self.kind == "exact":
            self._q[self.problem.normal] = 1.0
        else:
            self._q[-1] = -1.0

    def _fill(self, g: Array, jacobian: Array, tau_e: Array, h_e: Array) -> Array:
        """Put a problem into A and b; returns the numbers of A in Clarabel's order."""
        problem, l_joints, flat = self.problem, len(self._j), self._flat
        m, levers = 6 * problem.size, self._levers * jacobian[self._in_j]
        end = m + len(levers)
        flat[:m] = (self._rows * g).ravel()
        flat[m:end] = -levers
        flat[end : end + len(levers)] = levers
        h = h_e / self.units.force
        h[3:] /= self.units.arm
        if self.kind == "load":
            flat[-6:] = -h
        else:
            self._b[:6] = h
        j, here = self._j, tau_e[self._j]
        self._b[6 : 6 + l_joints] = (here - problem.tau_min[j]) / self._half
        self._b[6 + l_joints : 6 + 2 * l_joints] = (problem.tau_max[j] - here) / self._half
        return flat[self._order]

    def fresh(self, g: Array, jacobian: Array, tau_e: Array, h_e: Array) -> Any:
        """A new solver of Clarabel, for these numbers."""
        data = self._fill(g, jacobian, tau_e, h_e)
        a = sparse.csc_matrix(
            (data, self._pattern.indices, self._pattern.indptr), self._pattern.shape
        )
        none = sparse.csc_matrix((a.shape[1], a.shape[1]))
        return clarabel.DefaultSolver(none, self._q, a, self._b, self._cones, self.settings)

    def update(self, g: Array, jacobian: Array, tau_e: Array, h_e: Array) -> None:
        """Another problem with the same contacts, limits and zeros of J, by Clarabel's update."""
        self.solver.update(A=self._fill(g, jacobian, tau_e, h_e), b=self._b)

    def solve(self) -> ConeAnswer:
        """Solve; c has nothing to say where the status is not of a solved problem."""
        solution = self.solver.solve()
        status, x = str(solution.status), np.array(solution.x)
        m = self.problem.size
        c = self.units.force * self.problem.scale * x[:m]
        if self.kind == "exact":
            return ConeAnswer(c, float(c[self.problem.normal].sum()), status)
        if status == "PrimalInfeasible":
            return ConeAnswer(c, -np.inf, status)
        if status == "DualInfeasible":
            return ConeAnswer(c, np.inf, status)
        return ConeAnswer(c, float(x[m]), status)


def _settings(tolerance: float | None) -> Any:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.presolve_enable = False  # it would drop rows, and with them the update
    settings.max_threads = 1
    if tolerance is not None:
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    return settings


def exact(problem: GraspForceProblem, *, limits: bool = True) -> ConeAnswer:
    """The forces with the least Σ c_z, [N]."""
    return ConeProgram(problem, "exact", limits=limits).solve()


def margin(problem: GraspForceProblem, *, limits: bool = True) -> ConeAnswer:
    """How far inside (above zero) or outside the problem's constraints the best point is."""
    return ConeProgram(problem, "margin", limits=limits).solve()


def load_factor(problem: GraspForceProblem, *, limits: bool = True) -> ConeAnswer:
    """The largest λ with G c = λ h_e; inf where nothing bounds it, -inf where no λ will do."""
    return ConeProgram(problem, "load", limits=limits).solve()


def facets(dim: int) -> tuple[Array, float]:
    """Normals (k, dim − 1) and distance of the faces of a polytope within the unit ball.

    8 sides for a point contact; for a soft finger 26, the cube's faces, edges and corners.
    """
    if dim == 3:
        angle = 0.25 * np.pi * np.arange(8)
        return np.column_stack([np.cos(angle), np.sin(angle)]), float(np.cos(np.pi / 8))
    normals = np.array([n for n in product((-1.0, 0.0, 1.0), repeat=3) if any(n)])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    faces = np.column_stack([normals, -np.ones(len(normals))])
    corners = HalfspaceIntersection(faces, np.zeros(3)).intersections
    return normals, float(1.0 / np.linalg.norm(corners, axis=1).max())


@final
class Pyramids:
    """min Σ c_z + ε |x|²/2 with pyramids inside the friction cones, for DAQP; warm from solve to
    solve."""

    def __init__(self, problem: GraspForceProblem, *, epsilon: float = 1e-5) -> None:
        self.problem, self.units, self._j = problem, Units.of(problem), problem.limited
        m, n = problem.size, problem.contacts
        half = 0.5 * (problem.tau_max - problem.tau_min)[self._j]
        cones = []
        for i in range(n):
            normals, distance = facets(int(problem.dims[i]))
            rows = np.zeros((len(normals), m))
            k = problem.first[i]
            rows[:, k : k + 2] = normals[:, :2]
            rows[:, k + 3 : k + problem.dims[i]] = normals[:, 2:]
            rows[:, k + 2] = -distance
            cones.append(rows)
        self._balance = np.repeat([1.0, 1.0 / self.units.arm], 3)[:, None] * problem.scale
        self._levers = problem.scale * self.units.force / half[:, None]
        self._half = half
        fixed = np.vstack(cones)
        end = 6 + len(half)
        self._a = np.ascontiguousarray(np.vstack([np.zeros((end, m)), fixed]))
        self._upper = np.zeros(len(self._a))
        self._lower = np.zeros(len(self._a))
        self._lower[end:] = -1e30
        sense = np.zeros(len(self._a), dtype=np.int32)
        sense[:6] = 5
        f = np.zeros(m)
        f[problem.normal] = 1.0
        self._fill(problem.G, problem.J, problem.tau_e, problem.h_e)
        self._fixed = epsilon * np.eye(m), f, sense
        self.model = daqp.Model()
        self.model.setup(*self._fixed[:2], self._a, self._upper, self._lower, sense)

    def _fill(self, g: Array, jacobian: Array, tau_e: Array, h_e: Array) -> None:
        j, end = self._j, 6 + len(self._j)
        np.multiply(self._balance, g, out=self._a[:6])
        np.multiply(self._levers, jacobian.T[j], out=self._a[6:end])
        h = h_e / self.units.force
        h[3:] /= self.units.arm
        self._upper[:6] = self._lower[:6] = h
        self._upper[6:end] = (self.problem.tau_max - tau_e)[j] / self._half
        self._lower[6:end] = (self.problem.tau_min - tau_e)[j] / self._half

    def update(self, g: Array, jacobian: Array, tau_e: Array, h_e: Array) -> None:
        """Another problem with the same contacts and limits."""
        self._fill(g, jacobian, tau_e, h_e)
        self.model.update(A=self._a, bupper=self._upper, blower=self._lower)

    def single(
        self, g: Array, jacobian: Array, tau_e: Array, h_e: Array, start: Array
    ) -> tuple[Array, Array]:
        """x (M,) and the multipliers by one call of `daqp.solve`, from the multipliers `start`."""
        self._fill(g, jacobian, tau_e, h_e)
        h, f, sense = self._fixed
        x, _, _, info = daqp.solve(
            h, f, self._a, self._upper, self._lower, sense.copy(), dual_start=start
        )
        return x, info["lam"]

    def solve(self) -> ConeAnswer:
        """Forces, Σ c_z [N], and DAQP's exit flag, 1 for solved."""
        x, _, flag, _ = self.model.solve()
        c = self.units.force * self.problem.scale * x
        return ConeAnswer(c, float(c[self.problem.normal].sum()), str(flag))
