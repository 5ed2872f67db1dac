"""One problem, one answer, by the method named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from wbc.arrays import Array
from wbc.errors import WbcError, did_you_mean
from wbc.forces.flows import flow18, flow19, flow20
from wbc.forces.problem import GraspForceProblem
from wbc.forces.solution import GraspForceSolution
from wbc.forces.solver import ForceSolver

_FLOWS: Final[dict[str, Callable[..., GraspForceSolution]]] = {
    "flow18": flow18,
    "flow19": flow19,
    "flow20": flow20,
}
METHODS: Final = ("newton", "exact", *_FLOWS)
"""What `solve` may be told: the optimum of the cost (15) by Newton's method; the least Σ c_z with a
certificate; and the chapter's flows (18), (19), (20), for comparison."""
_TOLERANCE, _MOST = 1e-9, 50_000  # of a flow from a cold start


def solve(
    problem: GraspForceProblem,
    method: str = "newton",
    *,
    start: Array | None = None,
    load_factor: bool = False,
) -> GraspForceSolution:
    """Solve one problem. For many in a row, one tick after the other: `ForceSolver`.

    Args:
        method: one of METHODS.
        start: (M,) forces to start from; not used by ``"exact"``.
        load_factor: also find the largest λ with G c = λ h_e.

    Returns:
        The solution; read its status before its forces.

    Raises:
        WbcError: no such method, or a start of the wrong size.
    """
    if method not in METHODS:
        raise WbcError(f"unknown method '{method}'{did_you_mean(method, METHODS)}")
    if start is not None and np.shape(start) != (problem.size,):
        raise WbcError(f"start has shape {np.shape(start)}, expected ({problem.size},)")
    solver = ForceSolver(problem)
    given = (problem.G, problem.J, problem.tau_e, problem.h_e)
    factor = solver.load_factor(*given) if load_factor else np.nan
    if method in _FLOWS and start is None:
        first = solver.inside(*given)
        if not first.status.usable:
            return GraspForceSolution(**first._asdict(), load_factor=factor)
        start = first.c
    if method in _FLOWS:
        found = _FLOWS[method](problem, start, tolerance=_TOLERANCE, most=_MOST)
        return replace(found, load_factor=factor)
    step = solver.exact(*given) if method == "exact" else solver.solve(*given, start)
    return GraspForceSolution(**step._asdict(), load_factor=factor)
