"""Statics of the hands in a tick: grasp matrix and hand Jacobian of (1) and (4), forces back.

Contact frame for forces: z is the inward normal, so that c_z > 0 presses; x and y span the tangent
plane. c is the force that the finger exerts on the object; on the finger acts −c, so that holding
it takes actuator torques Jᵀ c beside those of the motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.arrays import Array, IntArray
from wbc.compiled import kernel
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.robot.kinematics import Kinematics
from wbc.rotations import cross


class Touches(NamedTuple):
    """Where the contacts are, in the world's axes.

    Attributes:
        arm: (N, 3) from the object's origin to the contact point [m].
        frame: (N, 3, 3) columns x, y, z, z the inward normal.
        pad: (N, 3) from the tip frame's origin to the contact point [m].
    """

    arm: Array
    frame: Array
    pad: Array


@kernel
def _touches(
    rotation: Array, charts: Array, gauss: Array, reach: Array, arm: Array, frame: Array, pad: Array
) -> None:  # fmt: skip
    for i in range(charts.shape[0]):
        arm[i] = rotation @ charts[i, 0]
        axes = rotation @ gauss[i]
        frame[i, :, 0] = axes[:, 0]
        frame[i, :, 1] = -axes[:, 1]
        frame[i, :, 2] = -axes[:, 2]
        pad[i] = -reach[i] * axes[:, 2]


def touches(kin: ExtendedKinematics) -> Touches:
    """The contacts of the last `kin.update`; those of free fingers are where they would touch."""
    n = kin.grasp.count
    out = Touches(np.empty((n, 3)), np.empty((n, 3, 3)), np.empty((n, 3)))
    _touches(kin.object_rotation, kin.charts, kin.frame, kin.reference.reach, *out)
    return out


def touches_at(points: Array, normals: Array, tips: Array, origin: Array) -> Touches:
    """The same from a log, which has points and normals but no tangents: any pair will do.

    Args:
        points, normals: (N, 3) contact points [m] and outward normals in the world.
        tips: (N, 3) origins of the tip frames in the world [m].
        origin: (3,) of the object [m].
    """
    frame = np.empty((len(points), 3, 3))
    for i, z in enumerate(-normals):
        least = np.eye(3)[int(np.argmin(np.abs(z)))]
        x = np.cross(least, z)
        x /= np.linalg.norm(x)
        frame[i] = np.column_stack([x, np.cross(z, x), z])
    return Touches(points - origin, frame, points - tips)


@kernel
def _statics(
    fingers: IntArray, joints: IntArray, soft: bool, arm: Array, frame: Array, pad: Array,
    linear: Array, angular: Array, g: Array, jacobian: Array,
) -> None:  # fmt: skip
    m = 4 if soft else 3
    for k in range(fingers.shape[0]):
        i = fingers[k]
        for c in range(3):
            axis = frame[i, :, c]
            g[:3, m * k + c] = axis
            g[3:, m * k + c] = cross(arm[i], axis)
        if soft:
            g[:3, m * k + 3] = 0.0
            g[3:, m * k + 3] = frame[i, :, 2]
        for r in range(joints.shape[0]):
            j = joints[r]
            x, y, z = angular[i, 0, j], angular[i, 1, j], angular[i, 2, j]
            # the pad moves with the tip: its end has the velocity v + ω × d
            u = linear[i, 0, j] + y * pad[i, 2] - z * pad[i, 1]
            v = linear[i, 1, j] + z * pad[i, 0] - x * pad[i, 2]
            w = linear[i, 2, j] + x * pad[i, 1] - y * pad[i, 0]
            for c in range(3):
                jacobian[m * k + c, r] = (
                    frame[i, 0, c] * u + frame[i, 1, c] * v + frame[i, 2, c] * w
                )
            if soft:
                jacobian[m * k + 3, r] = (
                    frame[i, 0, 2] * x + frame[i, 1, 2] * y + frame[i, 2, 2] * z
                )


def statics(
    robot: Kinematics, touch: Touches, fingers: IntArray, joints: IntArray, soft: bool
) -> tuple[Array, Array]:
    """G (6, M) of (1), about the object's origin, world axes, and J (M, l) of (4).

    The force acts at the contact point: the pad between it and the tip frame is part of the lever.

    Args:
        robot: fresh; tracked frame i is finger i's tip.
        fingers: (n,) those in contact, in the order of c.
        joints: (l,) independent joints, in the order of τ.
        soft: contacts have a fourth component, the moment about the inward normal.
    """
    size = (4 if soft else 3) * len(fingers)
    g, jacobian = np.empty((6, size)), np.empty((size, len(joints)))
    _statics(
        fingers, joints, soft, touch.arm, touch.frame, touch.pad, robot.linear, robot.angular, g,
        jacobian,
    )  # fmt: skip
    return g, jacobian


@kernel
def _loads(
    c: Array, mode: IntArray, mu: Array, mu_t: Array, frame: Array, pad: Array, linear: Array,
    angular: Array, tau_min: Array, tau_max: Array, force: Array, cone: Array, tau: Array,
    room: Array,
) -> None:  # fmt: skip
    for i in range(c.shape[0]):
        force[i] = frame[i] @ c[i, :3]
        if mode[i] == 0:
            cone[i] = np.nan
            continue
        x, y, t = c[i, 0] / mu[i], c[i, 1] / mu[i], c[i, 3] / mu_t[i]
        cone[i] = c[i, 2] - np.sqrt(x * x + y * y + t * t)
        if c[i, 2] == 0.0:
            continue
        moment = cross(pad[i], force[i]) + c[i, 3] * frame[i, :, 2]
        for j in range(tau.shape[0]):
            for r in range(3):
                tau[j] += linear[i, r, j] * force[i, r] + angular[i, r, j] * moment[r]
    for j in range(tau.shape[0]):
        room[j] = min(tau[j] - tau_min[j], tau_max[j] - tau[j])


class Loads(NamedTuple):
    """What contact forces come to.

    Attributes:
        force: (N, 3) on the object, world axes [N].
        cone_margin: (N,) c_z − |(x/μ, y/μ, t/μ_t)| [N]; NaN where a finger is free.
        torque: (nv,) τ = Jᵀ c + τ_e (4) [Nm].
        torque_margin: (nv,) distance of τ to its nearer limit [Nm]; inf without one.
    """

    force: Array
    cone_margin: Array
    torque: Array
    torque_margin: Array


def loads(
    robot: Kinematics, touch: Touches, mode: IntArray, c: Array, tau_e: Array,
    friction: tuple[Array, Array], limits: tuple[Array, Array],
) -> Loads:  # fmt: skip
    """Forces, torques and margins of planned contact forces.

    Args:
        robot: fresh, as for `statics`.
        mode: (N,) ContactMode of each finger.
        c: (N, 4) components of every finger in its contact frame, 0 where it is free.
        tau_e: (nv,) torques without contact forces.
        friction: (N,) μ and (N,) μ_t.
        limits: (nv,) τ_min and (nv,) τ_max.
    """
    n = len(c)
    out = Loads(np.empty((n, 3)), np.empty(n), tau_e.copy(), np.empty(len(tau_e)))
    _loads(
        c, mode, *friction, touch.frame, touch.pad, robot.linear[:n], robot.angular[:n], *limits,
        *out,
    )  # fmt: skip
    return out
