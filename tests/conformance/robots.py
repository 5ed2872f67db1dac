"""The robots of the suite: the planar pair that ships with the project and a small hand in space,
with all its joints free and with some that follow others.

Both can be built anew with their base moved or with all lengths scaled, by editing the URDF's text.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from wbc.resources import find
from wbc.robot.model import RobotModel, load_robot
from wbc.rotations import exp_so3, rotation_from_rpy


@dataclass(frozen=True)
class Motion:
    """A rigid motion of the whole world: rotation vector [rad] and translation [m]."""

    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def rotation(self) -> np.ndarray:
        return exp_so3(np.array(self.turn))

    @property
    def translation(self) -> np.ndarray:
        return np.array(self.shift)


STILL = Motion()
IN_PLANE = Motion((0.0, 0.0, 2.3), (0.7, -1.9, 0.0))
IN_SPACE = Motion((0.9, -1.7, 0.6), (0.7, -1.9, 0.4))


@dataclass(frozen=True)
class Setting:
    """Where a robot's fingers and palms are, by frame name."""

    urdf: str
    tips: tuple[str, ...]
    others: tuple[str, ...]
    motion: Motion


SETTINGS = {
    "planar": Setting(
        find("urdf", "planar_bimanual").read_text(),
        ("left_tip_a", "left_tip_b", "right_tip_a", "right_tip_b"),
        ("left_palm", "right_palm"),
        IN_PLANE,
    ),
    "hand": Setting("", ("tip_a", "tip_b"), ("palm", "forearm"), IN_SPACE),
    "coupled": Setting("", ("tip_a", "tip_b"), ("palm", "forearm"), IN_SPACE),
}


def _link(name: str, length: float, mass: float) -> str:
    """A slender link along x with its centre of mass off the axis."""
    small, large = 0.02 * mass * length**2, 0.09 * mass * length**2
    return f"""
  <link name="{name}"><inertial><origin xyz="{0.45 * length} {0.1 * length} {-0.07 * length}"/>
    <mass value="{mass}"/>
    <inertia ixx="{small}" ixy="0" ixz="0" iyy="{large}" iyz="0" izz="{large}"/>
  </inertial></link>"""


def _joint(
    name: str,
    parent: str,
    child: str,
    xyz: str,
    axis: str,
    rpy: str = "0 0 0",
    kind: str = "revolute",
    follows: str = "",
) -> str:
    lower, upper = (-0.15, 0.2) if kind == "prismatic" else (-1.9, 2.1)
    return f"""
  <joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
    <origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{follows}
    <limit lower="{lower}" upper="{upper}" effort="20" velocity="3"/></joint>"""


def _fixed(name: str, parent: str, child: str, xyz: str, rpy: str = "0 0 0") -> str:
    return f"""
  <link name="{child}"/>
  <joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/>
    <origin xyz="{xyz}" rpy="{rpy}"/></joint>"""


def _finger(side: str, y: float, roll: str, coupled: bool) -> str:
    last = f'<mimic joint="{side}2" multiplier="0.7" offset="0.1"/>' if coupled else ""
    return (
        _link(f"knuckle_{side}", 0.05, 0.2)
        + _link(f"proximal_{side}", 0.14, 0.15)
        + _link(f"distal_{side}", 0.1, 0.1)
        + _joint(f"{side}1", "palm", f"knuckle_{side}", f"0.08 {y} 0.01", "0 0.2 0.9", roll)
        + _joint(f"{side}2", f"knuckle_{side}", f"proximal_{side}", "0.05 0 0", "0.1 1 0")
        + _joint(
            f"{side}3", f"proximal_{side}", f"distal_{side}", "0.14 0 0", "0 1 0", follows=last
        )
        + _fixed(f"{side}_end", f"distal_{side}", f"tip_{side}", "0.1 0 0.01", "0.4 -0.3 0.2")
    )


def hand_urdf(*, prismatic: bool = True, coupled: bool = False) -> str:
    """An arm of five joints (the third slides if `prismatic`) and two fingers of three.

    Where `coupled`, each finger's last joint follows the one before it, and s4 follows s2.
    """
    third = "prismatic" if prismatic else "revolute"
    fourth = '<mimic joint="s2" multiplier="-1"/>' if coupled else ""
    return f"""<robot name="hand">
  <link name="world"/>{_fixed("base", "world", "pedestal", "0.1 -0.2 0.3", "0.2 0.1 -0.4")}
  {_link("shoulder", 0.3, 2.0)}{_link("upper_arm", 0.3, 1.5)}{_link("forearm", 0.25, 1.2)}
  {_link("wrist", 0.08, 0.6)}{_link("palm", 0.1, 0.5)}
  {_joint("s1", "pedestal", "shoulder", "0 0 0.2", "0 0 1")}
  {_joint("s2", "shoulder", "upper_arm", "0.1 0 0.1", "0 1 0", "0.3 0 0")}
  {_joint("s3", "upper_arm", "forearm", "0.3 0 0", "1 0 0.2", kind=third)}
  {_joint("s4", "forearm", "wrist", "0.25 0 0", "0 0.6 0.8", follows=fourth)}
  {_joint("s5", "wrist", "palm", "0.08 0 0", "1 0 0", "0 0.2 0")}
  {_finger("a", 0.05, "0.2 0 0.1", coupled)}{_finger("b", -0.05, "-0.3 0.1 -0.1", coupled)}
</robot>"""


def _triple(values: np.ndarray) -> str:
    return " ".join(repr(float(v)) for v in values)


def _rpy(rotation: np.ndarray) -> np.ndarray:
    """Roll, pitch, yaw of a rotation away from pitch = ±90°."""
    return np.array(
        [
            np.arctan2(rotation[2, 1], rotation[2, 2]),
            -np.arcsin(rotation[2, 0]),
            np.arctan2(rotation[1, 0], rotation[0, 0]),
        ]
    )


def _edited(text: str, motion: Motion, scale: float) -> str:
    """The URDF with every length times `scale` and what is on link `world` carried by `motion`."""
    robot = ET.fromstring(text)
    for origin in robot.iter("origin"):
        xyz = np.array([float(v) for v in origin.get("xyz", "0 0 0").split()])
        origin.set("xyz", _triple(scale * xyz))
    for joint in robot.iter("joint"):
        parent = joint.find("parent")
        if parent is None or parent.get("link") != "world":
            continue
        origin = joint.find("origin")
        assert origin is not None
        xyz = np.array([float(v) for v in origin.get("xyz", "0 0 0").split()])
        rpy = np.array([float(v) for v in origin.get("rpy", "0 0 0").split()])
        origin.set("xyz", _triple(motion.rotation @ xyz + motion.translation))
        origin.set("rpy", _triple(_rpy(motion.rotation @ rotation_from_rpy(rpy))))
    return ET.tostring(robot, encoding="unicode")


@cache
def robot(
    name: str, motion: Motion = STILL, scale: float = 1.0, *, prismatic: bool = True
) -> RobotModel:
    """The robot `name`, moved and scaled."""
    text = SETTINGS[name].urdf or hand_urdf(prismatic=prismatic, coupled=name == "coupled")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.urdf"
        path.write_text(_edited(text, motion, scale))
        return load_robot(path)
