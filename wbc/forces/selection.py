"""Fewer torque bounds in the cost: those that the last tick came near to (1.4 of the chapter)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.arrays import Array, BoolArray
from wbc.compiled import kernel
from wbc.forces import cost
from wbc.forces.flow_kernels import Fixed, Tick, Tracked, assemble, fixed, tick
from wbc.forces.flows import METHODS, MOST, TOLERANCE, finished, tracked
from wbc.forces.problem import GraspForceProblem
from wbc.forces.solution import GraspForceSolution

HYSTERESIS = 0.1
"""How far below the threshold a bound stays active, as a fraction of the limit."""


class Selected(NamedTuple):
    """A solution with some of the torque bounds.

    Attributes:
        solution: evaluated with all of them.
        active: (k,) the bounds that were in the cost, as `select` orders them.
        rounds: how often it was solved: more than once where a bound left out broke.
    """

    solution: GraspForceSolution
    active: BoolArray
    rounds: int


def select(
    problem: GraspForceProblem, tau: Array, sigma: float,
    active: BoolArray | None = None, hysteresis: float = HYSTERESIS,
) -> BoolArray:  # fmt: skip
    """(k,) which bounds are active: the lower ones of the limited joints, then the upper ones.

    A bound is active where the last torque uses at least the fraction σ_τ of it, from the middle
    between both, so |τ| ≥ σ_τ limit for the usual limits; with σ_τ = 0 one of each joint's two.
    One that was active stays so down to σ_τ − hysteresis, the double threshold of the chapter.

    Args:
        tau: (l,) joint torques of the last tick, [Nm].
        sigma: σ_τ.
        active: (k,) the choice of the last tick; None: there was none.
    """
    j = problem.limited
    middle = 0.5 * (problem.tau_min[j] + problem.tau_max[j])
    half = 0.5 * (problem.tau_max[j] - problem.tau_min[j])
    used = (tau[j] - middle) / half
    load = np.concatenate([-used, used])
    chosen: BoolArray = load >= sigma
    if active is not None:
        chosen |= active & (load >= sigma - hysteresis)
    return chosen


def track_selected(
    previous: GraspForceProblem, previous_c: Array, problem: GraspForceProblem, active: BoolArray,
    method: str = "flow18", *, tolerance: float = TOLERANCE, most: int = MOST,
) -> Selected:  # fmt: skip
    """`wbc.forces.flows.track` with the active bounds only, and what that breaks put back.

    (21) keeps inside all bounds. After the solve those left out are checked; while one is broken,
    it is made active and the tick is solved again from the same first point: no limit is ever
    broken, where the chapter leaves it at the choice.

    Args:
        active: (k,) of `select`.
    """
    fix = fixed(problem)
    c = np.ascontiguousarray(previous_c, dtype=np.float64)
    found, active, rounds = tracked_selected(
        fix, tick(previous), tick(problem), active, c, METHODS[method], tolerance, most
    )
    return Selected(finished(problem, found), active, rounds)


@kernel
def tracked_selected(
    fix: Fixed, before: Tick, now: Tick, active: BoolArray, c: Array,
    method: int, tolerance: float, most: int,
) -> tuple[Tracked, BoolArray, int]:  # fmt: skip
    """As `track_selected`: what was found, with which bounds, in how many rounds."""
    active, inverse = active.copy(), np.ones(len(fix.scale))
    printed = bool(0)  # the constant False would compile all that is called anew
    rows = assemble(fix, now)
    steps, rounds = 0, 0
    while True:
        rounds += 1
        found = tracked(fix, before, now, active, c, inverse, method, printed, tolerance, most)
        steps += found.steps
        slack = rows.b @ found.u + rows.free
        broken = ~active & ~(slack > 0.0)
        if found.gamma < 1.0 or not broken.any():
            break
        active |= broken
    return Tracked(found.u, found.gamma, steps, found.code), active, rounds


def active_after(
    problem: GraspForceProblem, c: Array, sigma: float, active: BoolArray | None = None,
    hysteresis: float = HYSTERESIS,
) -> BoolArray:  # fmt: skip
    """(k,) `select` from the torques that forces c (M,) need."""
    return select(problem, cost.torques(problem, c), sigma, active, hysteresis)
