"""Check of one ``<joint>`` of a URDF."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import cos, hypot, sin
from typing import NamedTuple, final

import numpy as np

from wbc.arrays import Array
from wbc.robot.strict_xml import Faults, Node, Scope, shown

MOVING = ("revolute", "continuous", "prismatic")
TYPES = (*MOVING, "fixed")
TURNS = 1e3
"""A continuous joint is taken as a revolute one of this range to both sides, [rad]: Pinocchio would
give it two numbers, cosine and sine, and no joint turns this far in a run."""
UNLIMITED = 1e9
"""Speed [rad/s] and torque [Nm] of a continuous joint whose file gives no limit."""
_UNSUPPORTED = ("floating", "planar")
_PARTS = (
    "parent",
    "child",
    "origin",
    "axis",
    "limit",
    "mimic",
    "dynamics",
    "calibration",
    "safety_controller",
)
_SHORTEST_AXIS = 1e-6


@final
@dataclass(frozen=True, eq=False)
class Frame:
    """A placement: rotation 3x3 and position [m] in the parent frame."""

    rotation: Array = field(default_factory=lambda: np.eye(3))
    position: Array = field(default_factory=lambda: np.zeros(3))


class Limits(NamedTuple):
    """What a joint is allowed: positions [rad] or [m], and speed."""

    lower: float
    upper: float
    velocity: float


@final
@dataclass(frozen=True, eq=False)
class Joint:
    """What the check of the tree needs to know of a joint; None where the file is at fault."""

    node: Node
    name: str | None
    type: str | None
    parent: str | None
    parent_node: Node
    child: str | None
    child_node: Node
    frame: Frame
    """Where the child lies in the parent."""
    limits: Limits | None
    """Of a revolute or prismatic joint."""
    multiplier: float
    """Of the joint it mimics, if it mimics one."""
    offset: float

    @property
    def where(self) -> str:
        """How faults name this joint."""
        return "a joint without name" if self.name is None else f"joint '{shown(self.name)}'"

    @property
    def moves(self) -> bool:
        """Whether the joint has a degree of freedom."""
        return self.type in MOVING


def check_joint(node: Node, faults: Faults) -> Joint:
    """Note the faults of one joint by itself."""
    name = Scope(faults, "a joint").text(node, "name", "name the joint")
    scope = Scope(faults, "a joint without name" if name is None else f"joint '{shown(name)}'")
    scope.known(node, _PARTS)
    type_ = _check_type(node, scope)
    ends: dict[str, tuple[str | None, Node]] = {}
    for role in ("parent", "child"):
        end = scope.only(node, role)
        if end is None:
            scope.fault(node, f"no <{role}>", f'write <{role} link="..."/>')
            ends[role] = (None, node)
        else:
            ends[role] = (scope.text(end, "link", f"name the {role} link"), end)
    frame = check_origin(node, scope)
    if type_ in MOVING:
        _check_axis(node, scope)
    limits = _check_limit(node, type_, scope)
    multiplier, offset = _check_mimic(node, scope)
    _check_extras(node, scope)
    return Joint(
        node, name, type_, *ends["parent"], *ends["child"], frame, limits, multiplier, offset
    )


def check_origin(node: Node, scope: Scope) -> Frame:
    """Check the optional ``<origin xyz rpy>`` of a joint, inertial, visual or collision."""
    origin = scope.only(node, "origin")
    if origin is None:
        return Frame()
    scope.known(origin, optional=("xyz", "rpy"))
    position = scope.vector(origin, "xyz", 3) or (0.0, 0.0, 0.0)
    roll, pitch, yaw = scope.vector(origin, "rpy", 3) or (0.0, 0.0, 0.0)
    x = np.array([[1, 0, 0], [0, cos(roll), -sin(roll)], [0, sin(roll), cos(roll)]])
    y = np.array([[cos(pitch), 0, sin(pitch)], [0, 1, 0], [-sin(pitch), 0, cos(pitch)]])
    z = np.array([[cos(yaw), -sin(yaw), 0], [sin(yaw), cos(yaw), 0], [0, 0, 1]])
    return Frame(z @ y @ x, np.array(position))


def _check_type(node: Node, scope: Scope) -> str | None:
    type_ = scope.text(node, "type", f"write one of {', '.join(TYPES)}")
    if type_ is None or type_ in TYPES:
        return type_
    if type_ in _UNSUPPORTED:
        remedy = "model it by prismatic and revolute joints"
        scope.fault(node, f"joint type '{type_}' is not supported", remedy)
    else:
        what = f"unknown joint type '{shown(type_)}'{scope.faults.hint(type_, TYPES)}"
        scope.fault(node, what, f"write one of {', '.join(TYPES)}")
    return None


def _check_axis(node: Node, scope: Scope) -> None:
    """Pinocchio normalises the axis, but takes a vanishing one as it is."""
    axis = scope.only(node, "axis")
    if axis is None:
        return  # by the format, the axis is x then
    values = scope.vector(axis, "xyz", 3, 'write e.g. <axis xyz="0 0 1"/>')
    if values is not None and hypot(*values) < _SHORTEST_AXIS:
        scope.fault(axis, "the axis has no length", 'write a unit vector, e.g. "0 0 1"')


def _check_limit(node: Node, type_: str | None, scope: Scope) -> Limits | None:
    """The limits of a moving joint."""
    bounded = type_ in ("revolute", "prismatic")
    limit = scope.only(node, "limit")
    if limit is None:
        if bounded:
            remedy = 'write <limit lower="..." upper="..." effort="..." velocity="..."/>'
            scope.fault(node, f"no <limit>, which a {type_} joint needs", remedy)
        return Limits(-TURNS, TURNS, UNLIMITED) if type_ == "continuous" else None
    ranged = "without it Pinocchio locks the joint at 0" if bounded else ""
    lower = scope.number(limit, "lower", ranged)
    upper = scope.number(limit, "upper", ranged)
    effort = scope.number(limit, "effort", "write the largest torque [Nm] or force [N]")
    velocity = scope.number(limit, "velocity", "write the largest speed [rad/s or m/s]")
    for name in ("acceleration", "deceleration", "jerk"):
        scope.number(limit, name)
    if not bounded:
        scope.known(limit, optional=("lower", "upper"))
    if bounded and lower is not None and upper is not None and lower > upper:
        scope.fault(limit, f"lower {lower:g} is above upper {upper:g}", "swap them")
    if type_ in MOVING and effort is not None and effort < 0:
        scope.fault(limit, f"effort {effort:g} is negative", "write its magnitude")
    if type_ in MOVING and velocity is not None and velocity <= 0:
        scope.fault(limit, f"velocity {velocity:g} is not positive", "write the largest speed")
    if type_ == "continuous" and velocity is not None and velocity > 0:
        return Limits(-TURNS, TURNS, velocity)
    if not bounded or lower is None or upper is None or velocity is None:
        return None
    return Limits(lower, upper, velocity) if lower <= upper and velocity > 0 else None


def _check_mimic(node: Node, scope: Scope) -> tuple[float, float]:
    """Multiplier and offset; 1 and 0 by the format where they are not written."""
    mimic = scope.only(node, "mimic")
    if mimic is None:
        return 1.0, 0.0
    scope.known(mimic, optional=("multiplier", "offset"))
    scope.text(mimic, "joint", "name the joint to follow")
    multiplier = scope.number(mimic, "multiplier", largest=1e9)
    offset = scope.number(mimic, "offset", largest=1e9)
    return 1.0 if multiplier is None else multiplier, 0.0 if offset is None else offset


def _check_extras(node: Node, scope: Scope) -> None:
    """The optional parts, whose garbage would make Pinocchio refuse the file without a cause."""
    dynamics = scope.only(node, "dynamics")
    if dynamics is not None:
        found = [scope.number(dynamics, name) for name in ("damping", "friction")]
        if not {"damping", "friction"} & dynamics.attributes.keys():
            what = "<dynamics> has neither 'damping' nor 'friction'"
            scope.fault(dynamics, what, "write one of them, or remove <dynamics>")
        for value in found:
            if value is not None and value < 0:
                scope.fault(dynamics, f"<dynamics> value {value:g} is negative", "write it >= 0")
    safety = scope.only(node, "safety_controller")
    if safety is not None:
        scope.number(safety, "k_velocity", "write the velocity gain")
        for name in ("k_position", "soft_lower_limit", "soft_upper_limit"):
            scope.number(safety, name)
    calibration = scope.only(node, "calibration")
    if calibration is not None:
        for name in ("rising", "falling"):
            scope.number(calibration, name)
