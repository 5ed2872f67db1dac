"""One problem, one answer, by the method named."""

from __future__ import annotations

from typing import Final, Literal, TypeAlias

import numpy as np

from wbc.arrays import Array
from wbc.errors import WbcError, did_you_mean
from wbc.forces.problem import GraspForceProblem
from wbc.forces.solution import GraspForceSolution
from wbc.forces.solver import ForceSolver

Method: TypeAlias = Literal["newton", "exact"]
METHODS: Final[tuple[Method, ...]] = ("newton", "exact")


def solve(
    problem: GraspForceProblem,
    method: Method = "newton",
    *,
    start: Array | None = None,
    load_factor: bool = False,
) -> GraspForceSolution:
    """Solve one problem. For many in a row, one tick after the other: `ForceSolver`.

    Args:
        method: newton, the optimum of the cost (15); exact, the least Σ c_z with a certificate.
        start: (M,) forces to start from.
        load_factor: also find the largest λ with G c = λ h_e.

    Raises:
        WbcError: no such method, or a start of the wrong size.
    """
    if method not in METHODS:
        raise WbcError(f"unknown method '{method}'{did_you_mean(method, METHODS)}")
    if start is not None and np.shape(start) != (problem.size,):
        raise WbcError(f"start has shape {np.shape(start)}, expected ({problem.size},)")
    solver = ForceSolver(problem)
    given = (problem.G, problem.J, problem.tau_e, problem.h_e)
    step = solver.exact(*given) if method == "exact" else solver.solve(*given, start)
    return GraspForceSolution(
        **step._asdict(), load_factor=solver.load_factor(*given) if load_factor else np.nan
    )
