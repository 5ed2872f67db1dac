"""``wbc robot``: what is in a robot's file, as the scenarios see it."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pinocchio as pin

from wbc.cli.check import robot_lines
from wbc.robot.model import RobotModel
from wbc.scenario.places import robot_file
from wbc.scenario.robots import read_robot


def robot_command(arguments: argparse.Namespace) -> int:
    """Print joints, ends and bodies of a robot; a fault of its file is raised."""
    model = read_robot(robot_file(arguments.robot, Path()))
    for title, lines in (
        ("robot", robot_lines(model)),
        ("ends: links that carry no other, at x y z [mm] with every joint mid-range", _ends(model)),
        ("bodies that can collide", _bodies(model)),
    ):
        print(title)
        for line in lines:
            print(f"  {line}")
    return 0


def _ends(model: RobotModel) -> Iterable[str]:
    """The leaves of the tree and where they are, in the frame of the root link."""
    inner = {_carrier(model, f) for f in model.bodies}
    ends = [f.name for f in model.bodies if f.name not in inner]
    data = model.pin_model.createData()
    middle = model.full(0.5 * (model.lower + model.upper))
    pin.framesForwardKinematics(model.pin_model, data, middle)
    width = max(map(len, ends), default=0)
    for name in ends:
        x, y, z = np.round(1e3 * data.oMf[model.frame(name)].translation) + 0.0
        yield f"{name:<{width}}  {x:6.0f} {y:6.0f} {z:6.0f}"


def _carrier(model: RobotModel, frame: object) -> str:
    """Link from which a link hangs, over the joint between them."""
    joint = model.pin_model.frames[frame.parentFrame]  # type: ignore[attr-defined]
    return str(model.pin_model.frames[joint.parentFrame].name)


def _bodies(model: RobotModel) -> Iterable[str]:
    kinds = Counter(type(o.geometry).__name__.lower() for o in model.geometry.geometryObjects)
    yield ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items())) or "none"
