"""Grasping-force optimization: how hard each contact must press (section 1 of the chapter).

Usable without a robot model: a `GraspForceProblem` in, a `GraspForceSolution` out.
"""

from wbc.forces.problem import POINT, SOFT_FINGER, GraspForceProblem
from wbc.forces.solution import ForceStatus, GraspForceSolution

__all__ = ["POINT", "SOFT_FINGER", "ForceStatus", "GraspForceProblem", "GraspForceSolution"]
