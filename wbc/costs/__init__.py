"""Costs: scalars that grow towards a constraint, descended in the freedom that tasks leave."""

from wbc.costs.base import Cost
from wbc.costs.collision import Collision
from wbc.costs.joint_limits import JointLimits

__all__ = ["Collision", "Cost", "JointLimits"]
