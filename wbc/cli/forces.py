"""``wbc forces``: one grasp force problem, solved."""

from __future__ import annotations

import argparse

import numpy as np

from wbc.forces import GraspForceProblem, solve


def forces_command(arguments: argparse.Namespace) -> int:
    """Solve, write the result whatever the verdict, and say it in one line; 1 if not usable."""
    problem = GraspForceProblem.load(arguments.problem)
    solution = solve(problem, arguments.method, load_factor=True)
    solution.save(arguments.out)
    text = f"{solution.status.value}: {problem.contacts} contacts, sum of normal forces "
    text += f"{solution.sum_normal:.4g} N, least margin of a cone {solution.min_cone_margin:.3g} N"
    if np.isfinite(solution.min_torque_margin):
        text += f", of a torque {solution.min_torque_margin:.3g} Nm"
    if not np.isnan(solution.load_factor):
        text += f", load factor {solution.load_factor:.4g}"
    print(text)
    return 0 if solution.status.usable else 1
