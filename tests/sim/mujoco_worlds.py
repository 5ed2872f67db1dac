"""Robots and objects for the tests of MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tests.sim.worlds import pads
from wbc.arrays import Array
from wbc.contact.surfaces import Surface
from wbc.contact.surfaces.box import Box
from wbc.robot.model import RobotModel, load_robot
from wbc.sim.compliant import FreeBody, Physics
from wbc.sim.mujoco_model import MujocoModel, MujocoSettings, build_mujoco
from wbc.sim.mujoco_table import Table

PAD = 5e-3
TIPS = [f"{side}_{finger}_tip" for side in ("right", "left") for finger in ("thumb", "index")]
FAR = np.array([9.0, 0.0, 1.0])
"""Where an object is out of everyone's way."""
BOX = Box((0.1, 0.1, 0.04))
_STRAIGHT = np.eye(3)


def model(
    robot: RobotModel,
    tips: Sequence[str],
    surface: Surface = BOX,
    mass: float = 0.3,
    *,
    com: Sequence[float] = (0.0, 0.0, 0.0),
    inertia: Sequence[float] = (0.0, 0.0, 0.0),
    torque: np.ndarray | None = None,
    table: Table | None = None,
    **other: Any,
) -> MujocoModel:
    """No rotors, no friction in the joints, no torque limits, unless `other` says so."""
    n = len(tips)
    given: dict[str, Any] = {
        "step": 1e-3,
        "friction": np.full(n, 0.8),
        "sliding_friction": np.full(n, 0.05),
        "armature": np.zeros(robot.nv),
        "joint_damping": np.zeros(robot.nv),
    }
    free = np.full(robot.nv, np.inf)
    return build_mujoco(
        robot,
        tips,
        pads(n, PAD),
        surface,
        FreeBody(mass, np.array(com), np.array(inertia)),
        Physics(**{**given, **other}),
        MujocoSettings(free if torque is None else torque, table=table),
    )


def table_below(
    position: Sequence[float], top: float | None = None, posts: Sequence[Sequence[float]] = (),
    rotation: Array = _STRAIGHT,
) -> Table:  # fmt: skip
    """A table half a metre wide."""
    plan = np.array(posts, dtype=np.float64).reshape(-1, 2)
    return Table(np.array(position), rotation, top, np.array([0.5, 0.5]), plan)


def stools(folder: Path, order: Sequence[int] = (0, 1, 2)) -> RobotModel:
    """Three posts that slide up and down, at the corners of a triangle; joints in the file as in
    `order`."""
    corners = [(0.03, 0.0), (-0.02, 0.03), (-0.02, -0.03)]
    inertia = '<inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/>'
    links = "".join(
        f'<link name="post_{k}"><inertial><mass value="{0.1 + 0.1 * k}"/>{inertia}'
        "</inertial></link>"
        f'<link name="tip_{k}"/>'
        for k in range(3)
    )
    joints = "".join(
        f'<joint name="lift_{k}" type="prismatic"><parent link="base"/><child link="post_{k}"/>'
        f'<origin xyz="{corners[k][0]} {corners[k][1]} 0.2"/><axis xyz="0 0 1"/>'
        '<limit lower="-0.1" upper="0.1" effort="20" velocity="1"/></joint>'
        f'<joint name="end_{k}" type="fixed"><parent link="post_{k}"/><child link="tip_{k}"/>'
        "</joint>"
        for k in order
    )
    path = folder / "stools.urdf"
    path.write_text(f'<robot name="stools"><link name="base"/>{links}{joints}</robot>')
    return load_robot(path)
