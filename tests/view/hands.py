"""The dual-arm robot and its object as a scene, in postures made by hand: nothing is simulated."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from wbc import resources
from wbc.contact.grasp import Grasp
from wbc.contact.surfaces.cylinder import Cylinder
from wbc.control.force_control import TorqueStatus
from wbc.robot.model import RobotModel, load_robot
from wbc.view import Scene
from wbc.view.from_robot import robot_scene

TIPS = {
    f"{side[0]}_{finger}": f"{side}_{finger}_tip"
    for side in ("right", "left")
    for finger in ("thumb", "index", "middle")
}
PLACE = np.array([0.62, 0.0, 0.60])


def dual_arm() -> tuple[RobotModel, Grasp, Scene]:
    model = load_robot(resources.find("urdf", "dual_arm"))
    six, nothing = np.zeros(6), np.zeros((6, 2))
    face = six.astype(int)
    grasp = Grasp(Cylinder(0.025, 0.3), tuple(TIPS), nothing, face, six, six, six + 1.0, False)
    q = postures(model, 2).q
    scene = robot_scene(
        model,
        grasp,
        title="two hands",
        tips=list(TIPS.values()),
        task_names=("object", "force", "moment", "posture"),
        phase_names=tuple(f"phase {k}" for k in range(10)),
        shown=[(q[0], PLACE), (q[-1], PLACE + np.array([0.0, 0.1, 0.05]))],
    )
    return model, grasp, scene


@dataclass(frozen=True)
class Rows:
    """What a log holds, as far as a picture needs it."""

    t: np.ndarray
    q: np.ndarray
    object_pose: np.ndarray
    contact_points: np.ndarray
    contact_normals: np.ndarray
    contact_mode: np.ndarray
    in_stack: np.ndarray
    activation: np.ndarray
    phase: np.ndarray
    eps_f: np.ndarray
    eps_m: np.ndarray
    object_error: np.ndarray
    min_distance: np.ndarray
    status: np.ndarray
    # of planned forces: none, unless `with_forces` makes some
    contact_force_plan: np.ndarray = field(default_factory=lambda: np.zeros((0, 6, 3)))
    torque_margin: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    wrench_plan: np.ndarray = field(default_factory=lambda: np.zeros((0, 6)))
    object_mass: np.ndarray = field(default_factory=lambda: np.zeros(0))
    object_com: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    force_status: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    # of torques: none, unless `under_torques` makes some
    tau: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    torque_status: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    contact_force_meas: np.ndarray = field(default_factory=lambda: np.zeros((0, 6, 3)))


def postures(model: RobotModel, count: int) -> Rows:
    """A smooth motion within the limits; the six fingers go from free to fixed to sliding."""
    t = np.linspace(0.0, 3.0, count)
    middle, half = 0.5 * (model.lower + model.upper), 0.5 * (model.upper - model.lower)
    away = np.sin(t[:, None] + np.arange(len(middle)))
    pose = np.zeros((count, 7))
    pose[:, :3] = PLACE
    pose[:, 3], pose[:, 6] = np.sin(0.2 * t), np.cos(0.2 * t)
    normals = np.tile([0.0, 0.0, 1.0], (count, 6, 1))
    normals[:, 0] = -normals[:, 0]
    mode = np.minimum(t.astype(int), 2)[:, None] * np.ones(6, dtype=int)
    error = np.where(mode[..., None] > 0, 1e-6 * np.arange(1, 7)[:, None] * (1.0, 2.0), np.nan)
    return Rows(
        t=t,
        q=middle + 0.3 * half * away,
        object_pose=pose,
        contact_points=PLACE + 0.02 * normals,
        contact_normals=normals,
        contact_mode=mode,
        in_stack=np.ones((count, 4), dtype=bool),
        activation=np.ones((count, 4)),
        phase=np.minimum(t.astype(int), 9),
        eps_f=0.1**t,
        eps_m=0.1**t,
        object_error=error,
        min_distance=np.full(count, 0.0123),
        status=np.where(t > 2.0, 1, 0),
    )


LIMIT = 0.5  # of every joint, [Nm]


def with_forces(model: RobotModel, rows: Rows) -> Rows:
    """Fingers that press with 1 N to 4 N from the touch on; from 1.5 s on a joint of the right
    index finger, which is contact 1, has reached its torque limit."""
    count = len(rows.t)
    press = (1.0 + rows.t)[:, None, None] * (rows.contact_mode > 0)[..., None]
    margin = np.full((count, model.nv), 0.5 * LIMIT)
    distal = int(np.flatnonzero(model.support(model.frame(TIPS["r_index"])))[-1])
    margin[rows.t >= 1.5, distal] = 0.04 * LIMIT
    wrench = np.tile([0.0, 0.0, 0.4 * 9.81, 0.0, 0.05, 0.0], (count, 1))
    return replace(
        rows,
        contact_force_plan=-press * rows.contact_normals,
        torque_margin=margin,
        wrench_plan=wrench,
        object_mass=np.full(count, 0.4),
        object_com=rows.object_pose[:, :3] + (0.02, 0.0, 0.0),
        force_status=np.where(rows.t > 2.5, 2, 0),
    )


def under_torques(model: RobotModel, rows: Rows) -> Rows:
    """The same by torques, and no optimizer: measured forces are 80 % of the planned ones; a joint
    of the right index finger is at its torque limit from 1.5 s on."""
    forces = with_forces(model, rows)
    tau = np.zeros((len(rows.t), model.nv))
    distal = int(np.flatnonzero(model.support(model.frame(TIPS["r_index"])))[-1])
    tau[rows.t >= 1.5, distal] = -0.98 * LIMIT
    return replace(
        rows,
        contact_force_plan=forces.contact_force_plan,
        contact_force_meas=0.8 * forces.contact_force_plan,
        tau=tau,
        torque_status=np.where(rows.t >= 1.5, TorqueStatus.SATURATED | TorqueStatus.SLOWED, 0),
    )
