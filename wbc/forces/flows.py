"""The chapter's own methods, for comparison: gradient flow (18), Dikin (19), decomposed (20).

They end where `wbc.forces.solver` does, after tens to thousands of steps. What was mended in print:

- ξ holds (√2 x/μ, √2 y/μ, √2 z, √2 t/μ_t) in place of c: only so is (17) a gradient flow.
- (19): plus in place of minus, which climbs; the root of the trace, which is the square of a norm;
  and the norm of the projected step, the one that is taken: then α < 1 cannot leave the cones.
- (20): the printed product of two projectors is not symmetric and stops short of the optimum, by
  how much depends on the units. (I − G†G) stands on both sides of the other one here.
- α_k, left open for (18) and (20), minimises Φ along the step, as for (19).
"""

from __future__ import annotations

import numpy as np

from wbc.arrays import Array, BoolArray, read_only_view
from wbc.compiled import kernel
from wbc.forces import cost
from wbc.forces.flow_kernels import (
    DONE,
    FLOW18,
    FLOW19,
    FLOW20,
    MOST_STEPS,
    RANK,
    STALE,
    STUCK,
    Fixed,
    Tick,
    Tracked,
    assemble,
    fixed,
    flow,
    picked,
    tick,
)
from wbc.forces.initial_point import arrived
from wbc.forces.problem import GraspForceProblem
from wbc.forces.solution import ForceStatus, GraspForceSolution

METHODS = {"flow18": FLOW18, "flow19": FLOW19, "flow20": FLOW20}
TOLERANCE = 1e-6
"""Relative decrease of Φ in a step below which a flow stops."""
MOST = 2000
"""Steps after which it stops in any case."""

_STATUS = {
    DONE: ForceStatus.SOLVED,
    MOST_STEPS: ForceStatus.NOT_BALANCED,
    STALE: ForceStatus.STALE_START,
    RANK: ForceStatus.RANK_DEFICIENT,
    STUCK: ForceStatus.NOT_BALANCED,
}
_BALANCED = 1e-10


def flow18(
    problem: GraspForceProblem, start: Array, *, tolerance: float = TOLERANCE, most: int = MOST
) -> GraspForceSolution:
    """The linearly constrained gradient flow (17) by Euler steps (18).

    Args:
        start: (M,) inside all cones and limits; where it does not balance h_e, (21) leads there.
        tolerance: stop where a step lowers Φ by less than this, relative.
        most: stop after so many steps, with the status NOT_BALANCED unless optimal.
    """
    return _flow(problem, start, FLOW18, False, tolerance, most)


def flow19(
    problem: GraspForceProblem, start: Array,
    *, tolerance: float = TOLERANCE, most: int = MOST, printed: bool = False,
) -> GraspForceSolution:  # fmt: skip
    """The Dikin-type flow (19), its steps no longer than the Dikin ellipsoid; as `flow18`.

    Args:
        printed: with the printed sign and norm: it cannot take a step, for every step climbs.
    """
    return _flow(problem, start, FLOW19, printed, tolerance, most)


def flow20(
    problem: GraspForceProblem, start: Array,
    *, tolerance: float = TOLERANCE, most: int = MOST, printed: bool = False,
) -> GraspForceSolution:  # fmt: skip
    """The decomposed flow (20), which inverts 6 x 6 and 2l x 2l in place of 6 + 2l; as `flow18`.

    Args:
        printed: with the printed product of projectors, which stops elsewhere.
    """
    return _flow(problem, start, FLOW20, printed, tolerance, most)


def track(
    previous: GraspForceProblem, previous_c: Array, problem: GraspForceProblem,
    method: str = "flow18", *, tolerance: float = TOLERANCE, most: int = MOST,
) -> GraspForceSolution:  # fmt: skip
    """One tick of 1.4: the first point out of the last forces by (21), then the flow.

    Where γ_0 < 1 a step of the flow is taken at each γ_j: the barrier leads away from what stopped
    it, until γ = 1. The status is STALE_START if `previous_c` is outside the cones or limits,
    NOT_BALANCED if γ does not reach 1.

    Args:
        previous: the tick before; same contacts and joints, (M,) forces `previous_c`.
        problem: the new tick; limits, friction and weights are taken from here.
        method: ``"flow18"``, ``"flow19"`` or ``"flow20"``.
    """
    fix = fixed(problem)
    found = tracked(
        fix, tick(previous), tick(problem), np.ones(len(fix.joint), dtype=np.bool_),
        np.ascontiguousarray(previous_c, dtype=np.float64), np.ones(problem.size),
        METHODS[method], False, tolerance, most,
    )  # fmt: skip
    return finished(problem, found)


def finished(problem: GraspForceProblem, found: Tracked) -> GraspForceSolution:
    """The solution that `tracked` found."""
    status = _STATUS[found.code]
    return cost.solution(problem, status, problem.scale * found.u, found.steps)


def _flow(
    problem: GraspForceProblem, start: Array, method: int, printed: bool, tolerance: float,
    most: int,
) -> GraspForceSolution:  # fmt: skip
    start = np.ascontiguousarray(start, dtype=np.float64)
    fix, now = fixed(problem), tick(problem)
    before = now
    if not cost.balance_error(problem, start) < _BALANCED:
        before = Tick(now.G, now.J, now.tau_e, read_only_view(problem.G @ start))
    found = tracked(
        fix, before, now, np.ones(len(fix.joint), dtype=np.bool_), start, np.ones(problem.size),
        method, printed, tolerance, most,
    )  # fmt: skip
    return finished(problem, found)


@kernel
def tracked(
    fix: Fixed, before: Tick, now: Tick, active: BoolArray, c: Array, inverse: Array,
    method: int, printed: bool, tolerance: float, most: int,
) -> Tracked:  # fmt: skip
    """(21) and the flow of one tick.

    Args:
        active: (k,) bounds that are in the cost; (21) keeps inside all.
        c: (M,) forces of the tick before.
        inverse: (M,) diagonal of W_G⁻¹ (22).
    """
    then, here = assemble(fix, before), assemble(fix, now)
    start = arrived(fix, then, here, c, inverse, method, printed, most)
    if start.code != DONE:
        return start
    rows, barrier = picked(here, active), fix.barrier[active]
    left = most - start.steps
    u, done, taken = flow(fix, rows, barrier, start.u, method, printed, tolerance, left)
    return Tracked(u, 1.0, start.steps + taken, DONE if done else MOST_STEPS)
