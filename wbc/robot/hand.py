"""A hand within a robot: its joints by the names of a posture, its palm, and its links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
import pinocchio as pin

from wbc.arrays import Array, IntArray
from wbc.errors import WbcError, did_you_mean
from wbc.robot.model import RobotModel


@final
@dataclass(frozen=True)
class Hand:
    """The joints that a posture names, and the part of the robot that they move.

    Attributes:
        model: the robot.
        joints: (n,) places of a posture's joints in q.
        palm: frame of the link from which all of them hang; the last one, if there are several.
        links: names of the links that hang from the palm, itself included.
        fingers: (n,) number of each joint's finger, from 0 as the posture goes: joints are of one
            finger where the same joint carries them from the palm.
    """

    model: RobotModel
    joints: IntArray
    palm: int
    links: frozenset[str]
    fingers: tuple[int, ...]

    @classmethod
    def of(cls, model: RobotModel, joints: Sequence[str], prefix: str = "") -> Hand:
        """The hand whose joints have the given names.

        Args:
            prefix: of every name in the robot, e.g. ``right_``.

        Raises:
            WbcError: the robot has no such joint, or it follows another; one line.
        """
        names = [prefix + joint for joint in joints]
        missing = [name for name in names if name not in model.full_names]
        if missing:
            others = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
            remedy = did_you_mean(missing[0], model.joint_names)
            raise WbcError(f"{model.path}: no joint '{missing[0]}'{others}{remedy}")
        places = np.array([model.joint(name) for name in names], dtype=np.int64)
        places.setflags(write=False)
        palm = _common_link(model, names)
        frames = model.pin_model.frames
        links = (
            str(f.name) for k, f in enumerate(frames) if _is_link(f) and palm in _way(model, k)
        )
        roots = [_root(model, palm, model.full_names.index(name)) for name in names]
        order = list(dict.fromkeys(roots))
        fingers = tuple(order.index(root) for root in roots)
        return cls(model, places, palm, frozenset(links), fingers)

    def body_fingers(self) -> dict[str, int]:
        """The fingers, as in `fingers`, of all bodies that they carry, by the names of joints."""
        model, roots = self.model, {}
        for place, finger in zip(self.joints, self.fingers, strict=True):
            roots[_root(model, self.palm, int(model.own[place]))] = finger
        found = {n: _root(model, self.palm, k) for k, n in enumerate(model.full_names)}
        return {name: roots[root] for name, root in found.items() if root in roots}

    def configurations(self, postures: Array) -> Array:
        """(m, nv) configurations of postures (m, n); joints that no posture names are mid-range."""
        model = self.model
        middle = 0.5 * (model.lower + model.upper)
        q: Array = np.tile(np.where(np.isfinite(middle), middle, 0.0), (len(postures), 1))
        q[:, self.joints] = postures
        return q

    def poses(self, postures: Array) -> Array:
        """Where everything is at postures (m, n), seen from the palm.

        Returns:
            (m, 1 + n_full, 4, 4): of each posture the world's pose in the palm's frame, then those
            of the bodies of all joints in Pinocchio's order.
        """
        model: Any = self.model.pin_model
        data, frame = model.createData(), model.frames[self.palm]
        out = np.empty((len(postures), model.njoints, 4, 4))
        for row, q in zip(out, self.configurations(postures), strict=True):
            pin.forwardKinematics(model, data, self.model.full(q))
            world = (data.oMi[frame.parentJoint] * frame.placement).inverse()
            for k in range(model.njoints):
                row[k] = (world * data.oMi[k]).homogeneous
        return out


def _is_link(frame: Any) -> bool:
    return "BODY" in str(frame.type)


def _way(model: RobotModel, frame: int) -> list[int]:
    """The links from a frame to the root, by their frames; a link itself first."""
    frames, links = model.pin_model.frames, []
    while frame > 0:
        if _is_link(frames[frame]):
            links.append(frame)
        frame = frames[frame].parentFrame
    return links


def _root(model: RobotModel, palm: int, joint: int) -> int:
    """The first joint after the palm among those that carry a joint, by its place among all; -1
    where the palm does not carry it."""
    carrier = int(model.pin_model.frames[palm].parentJoint)
    above = model.chain(carrier)
    chain = model.chain(joint + 1)
    if chain[: len(above)] != above or len(chain) == len(above):
        return -1
    return chain[len(above)]


def _common_link(model: RobotModel, joints: Sequence[str]) -> int:
    """The last link that carries all of the named joints."""
    frames = model.pin_model.frames
    # a link may have the name of a joint
    at = {f.name: k for k, f in enumerate(frames) if str(f.type) == "JOINT"}
    ways = [_way(model, at[name]) for name in joints]
    return next(link for link in ways[0] if all(link in way for way in ways))
