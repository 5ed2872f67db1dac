"""Grasping-force optimization: how hard each contact must press (section 1 of the chapter).

Usable without a robot model: a `GraspForceProblem` in, a `GraspForceSolution` out (`solve`), or
tick after tick (`ForceSolver`).
"""

from wbc.forces.blocks import HandJacobian
from wbc.forces.methods import METHODS, solve
from wbc.forces.problem import POINT, SOFT_FINGER, GraspForceProblem
from wbc.forces.solution import ForceStatus, GraspForceSolution
from wbc.forces.solver import ForceSolver, ForceStep

__all__ = [
    "METHODS",
    "POINT",
    "SOFT_FINGER",
    "ForceSolver",
    "ForceStatus",
    "ForceStep",
    "GraspForceProblem",
    "GraspForceSolution",
    "HandJacobian",
    "solve",
]
