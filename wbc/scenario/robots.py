"""The robot in a file: a URDF as it is, or one of parts, put together in memory."""

from __future__ import annotations

from pathlib import Path

from wbc.robot.assembly import assemble
from wbc.robot.model import RobotModel, load_robot
from wbc.scenario.parts import load_parts


def read_robot(file: Path, *, capsules: bool = True) -> RobotModel:
    """The robot in `file`, a URDF or, where its name ends in .yaml, a file of parts.

    Args:
        capsules: as in `load_robot`.

    Raises:
        UrdfError: every fault of the robot.
        ScenarioError: every fault of a file of parts.
    """
    text = None
    if file.suffix in (".yaml", ".yml"):
        text = assemble(*load_parts(file))
    return load_robot(file, text=text, capsules=capsules)
