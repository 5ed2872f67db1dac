"""A robot: names, index maps and limits around a Pinocchio model, fixed once loaded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from wbc.arrays import Array, IntArray, read_only
from wbc.errors import UnknownNameError, UrdfError, WbcError, follower_refusal
from wbc.robot.prepare import prepared
from wbc.robot.rounding import rounded
from wbc.robot.urdf import read_urdf
from wbc.robot.urdf_joint import Limits
from wbc.robot.urdf_mimic import Coupling


def frame_id(model: Any, name: str) -> int:
    """Index of the frame `name`: the one place that asks Pinocchio for a frame.

    Pinocchio answers an unknown name with an index out of range, and later crashes the process.

    Raises:
        UnknownNameError: with the nearest valid name.
    """
    if not model.existFrame(name):
        raise UnknownNameError("frame", name, (f.name for f in model.frames))
    return int(model.getFrameId(name))


@dataclass(frozen=True)
class RobotModel:
    """A fixed-base robot of revolute and prismatic joints, some of which may follow others.

    q and v are of the independent joints. Pinocchio's model has every joint of the URDF: its
    configuration is ratio · q[master] + offset, `full`, and its Jacobians are summed in the same
    way. What is of all joints, n_full of them, is in Pinocchio's order, joint k + 1 of its own.

    Attributes:
        path: the URDF, or the file of parts that it is made of.
        text: the URDF itself, as checked.
        pin_model: the Pinocchio model of all joints; never changed after loading.
        geometry: collision shapes, all convex (pin.GeometryModel).
        joint_names: independent joints in the order of q and v, which is Pinocchio's.
        lower, upper: position limits, shape (nv,), [rad] or [m]; where other joints follow one,
            such that these keep theirs.
        velocity: velocity limits in the same way, shape (nv,), [rad/s] or [m/s].
        effort: torque limits of the independent joints themselves, shape (nv,), [Nm] or [N].
        planar: every joint keeps the robot in its xy-plane.
        master: (n_full,) which of the independent joints drives each joint (an independent one
            drives itself).
        ratio: (n_full,) its motion per unit of the master's; 1 for an independent joint.
        offset: (n_full,) its position where the master's is 0; 0 for an independent joint.
        own: (nv,) place of the independent joints among all.
    """

    path: Path
    text: str
    pin_model: Any
    geometry: Any
    joint_names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    effort: Array
    planar: bool
    master: IntArray
    ratio: Array
    offset: Array
    own: IntArray

    @property
    def nv(self) -> int:
        """Number of independent joints."""
        return len(self.joint_names)

    @property
    def n_full(self) -> int:
        """Number of all joints."""
        return len(self.master)

    @property
    def full_names(self) -> tuple[str, ...]:
        """Names of all joints, in Pinocchio's order."""
        return tuple(str(name) for name in self.pin_model.names)[1:]

    @property
    def followers(self) -> dict[str, str]:
        """The joints that follow another, each with the independent joint that drives it."""
        driven = zip(self.full_names, (self.joint_names[m] for m in self.master), strict=True)
        return {name: master for name, master in driven if name != master}

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Names of all frames of the URDF (links and joints)."""
        return tuple(f.name for f in self.pin_model.frames)

    def full(self, q: Array) -> Array:
        """Positions of all joints, (n_full,), at the independent ones q, (nv,)."""
        everything: Array = self.ratio * np.asarray(q, dtype=np.float64)[self.master] + self.offset
        return everything

    @property
    def bodies(self) -> tuple[Any, ...]:
        """Pinocchio's frames of the links."""
        return tuple(f for f in self.pin_model.frames if "BODY" in str(f.type))

    def frame(self, name: str) -> int:
        """Index of a frame. Raises UnknownNameError."""
        return frame_id(self.pin_model, name)

    def joint(self, name: str) -> int:
        """Position of an independent joint in q and v.

        Raises:
            UnknownNameError: no such joint.
            WbcError: the joint follows another, which is named.
        """
        if name in self.joint_names:
            return self.joint_names.index(name)
        if (master := self.followers.get(name)) is not None:
            raise WbcError(follower_refusal(name, master))
        raise UnknownNameError("joint", name, self.joint_names)

    def is_prismatic(self, joint: int) -> bool:
        """Whether a joint of all (k of n_full) slides; it turns otherwise."""
        return "JointModelP" in self.pin_model.joints[joint + 1].shortname()

    def chain(self, joint: int) -> list[int]:
        """The joints (k of n_full) that carry Pinocchio's joint `joint`, itself included, from the
        root."""
        carriers = []
        while joint > 0:
            carriers.append(joint - 1)
            joint = self.pin_model.parents[joint]
        return carriers[::-1]

    def frame_chain(self, frame: int) -> list[int]:
        """The joints (k of n_full) that move a frame, from the root."""
        return self.chain(self.pin_model.frames[frame].parentJoint)

    def support(self, frame: int) -> Array:
        """1 for the independent joints that move `frame`, by themselves or through those that
        follow them, 0 for the others, shape (nv,)."""
        mask = np.zeros(self.nv)
        mask[self.master[self.frame_chain(frame)]] = 1.0
        return mask


def load_robot(path: Path, *, text: str | None = None, capsules: bool = True) -> RobotModel:
    """Load a URDF that passes the strict check; ``<mimic>`` couples joints exactly.

    Args:
        path: the file. Meshes are looked for as `wbc.robot.packages` says.
        text: the URDF, where `path` only says what it was made of.
        capsules: take capsules for the collision shapes that they fit, see `wbc.robot.rounding`.

    Raises:
        UrdfError: every fault of the file, one line each; or a mesh that is not found.
    """
    found = read_urdf(path, text)
    # from the checked text, not the file: what was checked is what is loaded
    ready = prepared(found.text, path)
    # every joint is one of its own to Pinocchio: its mimic joints cannot have a master further out,
    # and several of its algorithms are wrong or refuse them
    model = pin.buildModelFromXML(ready)
    names = [str(name) for name in model.names][1:]
    free = [name for name in names if name not in found.couplings]
    own = np.array([names.index(name) for name in free], dtype=np.int64)
    ties = [found.couplings.get(name, Coupling(name, 1.0, 0.0)) for name in names]
    master = np.array([free.index(tie.master) for tie in ties], dtype=np.int64)
    for indices in (own, master):
        indices.setflags(write=False)
    limits = [
        found.limits.get(
            name,
            Limits(
                model.lowerPositionLimit[k], model.upperPositionLimit[k], model.velocityLimit[k]
            ),
        )
        for k, name in zip(own, free, strict=True)
    ]
    return RobotModel(
        path=path,
        text=found.text,
        pin_model=model,
        geometry=_collision_shapes(model, ready, path, capsules),
        joint_names=tuple(free),
        lower=read_only([x.lower for x in limits]),
        upper=read_only([x.upper for x in limits]),
        velocity=read_only([x.velocity for x in limits]),
        effort=read_only(np.array(model.effortLimit)[own]),
        planar=_is_planar(model),
        master=master,
        ratio=read_only([tie.ratio for tie in ties]),
        offset=read_only([tie.offset for tie in ties]),
        own=own,
    )


def _collision_shapes(model: Any, text: str, path: Path, capsules: bool) -> Any:
    try:
        shapes = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION)
    except (ValueError, RuntimeError) as error:
        reason = (str(error).splitlines() or ["unknown"])[-1]
        raise UrdfError(f"{path}: a collision mesh cannot be read: {reason}") from None
    try:
        return rounded(shapes, capsules=capsules)
    except WbcError as error:
        raise UrdfError(f"{path}: {error}") from None


def _is_planar(model: Any) -> bool:
    """Whether no joint moves anything out of the world's xy-plane.

    Asked of every joint, followers too: were it asked of the coupled motions, two that cancel each
    other would hide a link between them that tilts.
    """
    data = model.createData()
    jacobian = pin.computeJointJacobians(model, data, pin.neutral(model))
    # of a single joint Pinocchio returns a vector
    out_of_plane = np.reshape(jacobian, (6, model.nv))[[2, 3, 4], :]
    return model.nv > 0 and bool(np.all(np.abs(out_of_plane) < 1e-12))
