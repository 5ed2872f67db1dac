"""Task functions (the scenarios in the top-level folder ``tasks/`` choose among them).

A new task is one file here and one row of the scenario's table.
"""

from wbc.tasks.base import Task, TaskRows, empty_rows
from wbc.tasks.center_of_mass import CenterOfMass
from wbc.tasks.equilibrium import EquilibriumForce, EquilibriumMoment
from wbc.tasks.frame import FrameOrientation, FramePose, FramePosition, RelativePose, pose_target
from wbc.tasks.manipulability import Manipulability
from wbc.tasks.palm_distance import PalmDistance
from wbc.tasks.posture import Posture
from wbc.tasks.synergy import Synergy
from wbc.tasks.tip_position import TipPosition

__all__ = [
    "CenterOfMass",
    "EquilibriumForce",
    "EquilibriumMoment",
    "FrameOrientation",
    "FramePose",
    "FramePosition",
    "Manipulability",
    "PalmDistance",
    "Posture",
    "RelativePose",
    "Synergy",
    "Task",
    "TaskRows",
    "TipPosition",
    "empty_rows",
    "pose_target",
]
