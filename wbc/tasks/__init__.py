"""Task functions (the scenarios in the top-level folder ``tasks/`` choose among them).

A new task is one file here and one row of the scenario's table.
"""

from wbc.tasks.base import Task, TaskRows, empty_rows
from wbc.tasks.equilibrium import EquilibriumForce, EquilibriumMoment
from wbc.tasks.manipulability import Manipulability
from wbc.tasks.palm_distance import PalmDistance
from wbc.tasks.tip_position import TipPosition

__all__ = [
    "EquilibriumForce",
    "EquilibriumMoment",
    "Manipulability",
    "PalmDistance",
    "Task",
    "TaskRows",
    "TipPosition",
    "empty_rows",
]
