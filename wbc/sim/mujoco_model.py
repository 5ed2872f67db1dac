"""A MuJoCo model of a robot, its fingertip pads and the object, made from the same URDF.

The tree is read off Pinocchio's model, which has the checked URDF's bodies with all that is fixed
to them: same joints, placements, masses. Joints are found by name, for the two packages order them
differently.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
import pinocchio as pin

from wbc.arrays import Array, IntArray
from wbc.contact.surfaces import Surface
from wbc.errors import WbcError
from wbc.robot.model import RobotModel
from wbc.robot.urdf_joint import TURNS
from wbc.sim.compliant import FreeBody, Physics
from wbc.sim.mujoco_plane import BALL, Plates, add_contour, add_plates, found
from wbc.sim.mujoco_shapes import add_object, add_shape, mujoco
from wbc.sim.mujoco_table import TABLE, TABLE_BIT, Table, add_table
from wbc.sim.pads import Pads

OBJECT, FIXTURE = "object", "fixture"
"""Names of bodies and geoms beside those of the robot."""
OBJECT_BIT, _FIRST_HAND = 1, 4
"""What a geom is, as bits; its conaffinity says what it collides with."""
_MOST_HANDS = 24
_HARD = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # as near to rigid as MuJoCo takes it
_STIFFER = 1e-6
"""MuJoCo softens a constraint in proportion to the inverse inertia that it sees. Of a small link
that follows a torso's joint it is 1e3 times what it should be, and the coupling would give by
5e-5 rad."""


@final
@dataclass(frozen=True)
class MujocoSettings:
    """What MuJoCo is told beside robot, object, pads and physics.

    The contact values are those with which a held bar creeps least: elliptic cones, impratio 100
    and noslip iterations bring it from 0.8 mm/s to 5 µm/s.

    Attributes:
        torque: (nv,) what the motors can do, inf without limit, [Nm] or [N].
        torsion: moment about the normal per normal force, [m].
        solref, solimp: stiffness and impedance of the pads' contacts, as MuJoCo defines them.
        impratio, noslip: how much stiffer friction is than the normal, and iterations that take the
            rest of its creep away.
        table: what the object lies on; None for nothing.
    """

    torque: Array
    torsion: float = 0.005
    solref: tuple[float, float] = (0.004, 1.0)
    solimp: tuple[float, float, float, float, float] = (0.95, 0.99, 0.001, 0.5, 2.0)
    impratio: float = 100.0
    noslip: int = 3
    table: Table | None = None


@final
@dataclass(frozen=True)
class MujocoModel:
    """MuJoCo's model and where in it the robot's quantities are.

    Attributes:
        robot: where it was made from.
        spec: the editable description (mujoco.MjSpec); `spec.to_xml()` is the MJCF.
        model: mujoco.MjModel.
        position, velocity: (n_full,) places of the robot's joints, in Pinocchio's order, in qpos
            and qvel.
        motor: (nv,) places of the independent joints' motors in ctrl.
        object_body: index of the object's body.
        object_position, object_velocity: first places of its joints in qpos and qvel: a free joint,
            or in the plane x, y and the angle.
        object_geom, pad_geom: (N,) the object's geom that a contact is on, and its pad. Contacts on
            the same frame share a pad.
        pad_body: (N,) the bodies that carry them.
        sliding_friction: (N,) μ of tips that slide on purpose.
        plates: what the pads press on in the plane; None in space.
        fixture: index of the weld that holds the object.
        fixture_body: index in mocap_pos of the body that it is welded to.
        table_body: index in mocap_pos of the table, below 0 where there is none.
    """

    robot: RobotModel
    spec: Any
    model: Any
    position: IntArray
    velocity: IntArray
    motor: IntArray
    object_body: int
    object_position: int
    object_velocity: int
    object_geom: IntArray
    pad_geom: IntArray
    pad_body: IntArray
    sliding_friction: Array
    plates: Plates | None
    fixture: int
    fixture_body: int
    table_body: int


def rotor_defaults(robot: RobotModel) -> tuple[Array, Array]:
    """Armature and damping, (nv,) each, of joints of which only the effort is known.

    Below 2 Nm as of the small geared motors of fingers; above in proportion, so that a joint of
    176 Nm of a light-weight arm has 0.4 kg m² and 1 N m s.
    """
    small, share = robot.effort < 2.0, robot.effort / 176.0
    return np.where(small, 1e-4, 0.4 * share), np.where(small, 2e-3, share)


def build_mujoco(
    robot: RobotModel,
    tips: Sequence[str],
    pads: Pads,
    surface: Surface,
    body: FreeBody,
    physics: Physics,
    settings: MujocoSettings,
) -> MujocoModel:
    """Make the model.

    A joint that follows another is a joint of its own, bound by an equality constraint, which
    MuJoCo treats as a very stiff spring: it gives by less than 1e-9 rad. MuJoCo has no other
    coupling. Motors sit on independent joints only, and so do armature and damping.

    Hands collide with the object, the table and other hands, not with themselves. A hand is what is
    behind the last joint that carries more than one tip. The last link of a finger that touches is
    represented by its pad, where the object is concerned.

    Args:
        tips: (N) frame of each contact's tip.
        pads: (N,) of the contacts. In space their rest length is the radius of a round pad, and the
            settings say how hard it is; in the plane they are the springs of `wbc.sim.pads`.
        body: an inertia of zeros stands for that of a body of even density.

    Raises:
        WbcError: mujoco is not installed; a post of the table has nothing to bear; MuJoCo refuses
            a body.
    """
    mj = mujoco()
    spec = mj.MjSpec()
    _options(mj, spec, robot, physics.step, settings)
    bodies = _bodies(mj, spec, robot)
    _couple(mj, spec, robot)
    _drive(mj, spec, robot, physics, settings.torque)
    hand = _hand_of_joints(robot, tips)
    _shapes(mj, spec, robot, bodies, hand, _last_joints(robot, tips))
    radius = np.full(len(tips), BALL) if surface.planar else pads.rest_length
    _pads(mj, robot, bodies, tips, radius, hand, physics.friction, settings)
    friction = float(np.max(physics.friction, initial=0.0)) or 1.0
    if surface.planar:
        for geom in spec.geoms:  # what touches whom is said by pairs alone
            geom.contype = geom.conaffinity = 0
        add_contour(mj, spec, OBJECT, body)
        add_plates(mj, spec, OBJECT, tips, physics.friction)
    else:
        add_object(mj, spec, OBJECT, surface, body, OBJECT_BIT)
        spec.geom(OBJECT).friction = [friction, settings.torsion, 1e-4]
    _fixture(mj, spec)
    if settings.table is not None:
        add_table(
            mj, spec, settings.table, surface, friction, settings.solref, settings.solimp,
            OBJECT_BIT,
        )  # fmt: skip
    return _compiled(mj, spec, robot, tips, physics.sliding_friction, surface, pads)


def _options(mj: Any, spec: Any, robot: RobotModel, step: float, settings: MujocoSettings) -> None:
    spec.modelname = robot.path.stem
    spec.compiler.degree = False
    option = spec.option
    option.timestep = step
    option.gravity = np.array(robot.pin_model.gravity.linear)
    option.integrator = mj.mjtIntegrator.mjINT_IMPLICITFAST
    option.solver = mj.mjtSolver.mjSOL_NEWTON
    option.cone = mj.mjtCone.mjCONE_ELLIPTIC
    option.impratio = settings.impratio
    option.noslip_iterations = settings.noslip
    # what diverges would otherwise begin anew at qpos0 as if nothing had happened
    option.disableflags |= mj.mjtDisableBit.mjDSBL_AUTORESET


def _bodies(mj: Any, spec: Any, robot: RobotModel) -> list[Any]:
    """A body for each of Pinocchio's joints, the world first."""
    tree = robot.pin_model
    bodies = [spec.worldbody]
    for k, name in enumerate(robot.full_names):
        joint, placement = tree.joints[k + 1], tree.jointPlacements[k + 1]
        body = bodies[tree.parents[k + 1]].add_body(name=name)
        body.pos, body.quat = placement.translation, wxyz(placement.rotation)
        inertia = tree.inertias[k + 1]
        body.explicitinertial = True
        body.mass, body.ipos = inertia.mass, inertia.lever
        i = inertia.inertia
        body.fullinertia = [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
        slides = robot.is_prismatic(k)
        hinge = mj.mjtJoint.mjJNT_SLIDE if slides else mj.mjtJoint.mjJNT_HINGE
        made = body.add_joint(name=name, type=hinge, axis=_axis(joint, slides))
        if k in robot.own:
            j = int(robot.master[k])
            low, high = robot.lower[j], robot.upper[j]
            made.limited = bool(high - low < 1.9 * TURNS)
            made.range = [low, high]
        bodies.append(body)
    return bodies


def _axis(joint: Any, slides: bool) -> Array:
    data = joint.createData()
    joint.calc(data, np.zeros(1))
    motion: Array = np.asarray(data.S, dtype=np.float64).reshape(6)
    return motion[:3] if slides else motion[3:]


def _couple(mj: Any, spec: Any, robot: RobotModel) -> None:
    for k, name in enumerate(robot.full_names):
        if k in robot.own:
            continue
        spec.add_equality(
            name=name,
            type=mj.mjtEq.mjEQ_JOINT,
            objtype=mj.mjtObj.mjOBJ_JOINT,
            name1=name,
            name2=robot.joint_names[robot.master[k]],
            data=[robot.offset[k], robot.ratio[k], *[0.0] * 10],
            solimp=_HARD,
            solref=[2.0 * spec.option.timestep, 1.0],
        )


def _drive(mj: Any, spec: Any, robot: RobotModel, physics: Physics, torque: Array) -> None:
    for j, name in enumerate(robot.joint_names):
        joint = spec.joint(name)
        joint.armature = physics.armature[j]
        joint.damping[0] = physics.joint_damping[j]
        motor = spec.add_actuator(name=name, target=name, trntype=mj.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
        most = float(torque[j])
        motor.ctrllimited = bool(np.isfinite(most))
        if motor.ctrllimited:
            motor.ctrlrange = [-most, most]


def _last_joints(robot: RobotModel, tips: Sequence[str]) -> set[int]:
    """The joints (k of n_full) that carry a tip directly."""
    return {robot.frame_chain(robot.frame(tip))[-1] for tip in tips}


def _hand_of_joints(robot: RobotModel, tips: Sequence[str]) -> IntArray:
    """(n_full,) number of the hand that a joint moves a part of, -1 for arms and torso.

    The joint that carries the palm is counted with its hand.
    """
    chains = [robot.frame_chain(robot.frame(tip)) for tip in dict.fromkeys(tips)]
    carried = np.zeros(robot.n_full, dtype=np.int64)
    for chain in chains:
        carried[chain] += 1
    roots: list[int] = []
    for chain in chains:
        shared = [k for k in chain if carried[k] > 1]
        root = shared[-1] if shared else -1
        if root not in roots:
            roots.append(root)
    if len(roots) > _MOST_HANDS:
        raise WbcError(f"{len(roots)} hands are more than the {_MOST_HANDS} that can collide")
    hand = np.full(robot.n_full, -1, dtype=np.int64)
    for k in range(robot.n_full):
        behind = [roots.index(c) for c in (*robot.chain(k + 1), -1) if c in roots]
        hand[k] = max(behind, default=-1, key=lambda n: roots[n])
    return hand


def _bits(hand: int, *, touches_object: bool) -> tuple[int, int]:
    """What a part of a hand is, and what it collides with."""
    own = _FIRST_HAND << hand
    others = (_FIRST_HAND << _MOST_HANDS) - _FIRST_HAND - own
    return own, others | TABLE_BIT | (OBJECT_BIT if touches_object else 0)


def _shapes(
    mj: Any, spec: Any, robot: RobotModel, bodies: list[Any], hand: IntArray, last: set[int]
) -> None:
    """The robot's shapes; those of arms and torso are there to be seen."""
    for shape in robot.geometry.geometryObjects:
        k = shape.parentJoint - 1
        geom = add_shape(mj, spec, bodies[k + 1], shape)
        is_hand = k >= 0 and hand[k] >= 0
        bits = _bits(int(hand[k]), touches_object=k not in last) if is_hand else (0, 0)
        geom.contype, geom.conaffinity = bits


def _pads(
    mj: Any, robot: RobotModel, bodies: list[Any], tips: Sequence[str], radius: Array,
    hand: IntArray, friction: Array, settings: MujocoSettings,
) -> None:  # fmt: skip
    done: set[str] = set()
    for i, tip in enumerate(tips):
        if tip in done:
            continue
        done.add(tip)
        frame = robot.pin_model.frames[robot.frame(tip)]
        k = int(frame.parentJoint) - 1
        pad = bodies[k + 1].add_geom(name=f"pad {tip}", type=mj.mjtGeom.mjGEOM_SPHERE)
        pad.pos, pad.size[0] = frame.placement.translation, radius[i]
        pad.contype, pad.conaffinity = _bits(int(hand[k]) if k >= 0 else 0, touches_object=True)
        pad.priority, pad.condim = 1, 4
        pad.friction = [friction[i], settings.torsion, 1e-4]
        pad.solref, pad.solimp = settings.solref, settings.solimp
        pad.rgba = [0.2, 0.6, 0.9, 1.0]


def _fixture(mj: Any, spec: Any) -> None:
    spec.worldbody.add_body(name=FIXTURE, mocap=True)
    spec.add_equality(
        name=FIXTURE,
        type=mj.mjtEq.mjEQ_WELD,
        objtype=mj.mjtObj.mjOBJ_BODY,
        name1=FIXTURE,
        name2=OBJECT,
        data=[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        solimp=_HARD,
        solref=[2.0 * spec.option.timestep, 1.0],
        active=False,
    )


def _compiled(
    mj: Any, spec: Any, robot: RobotModel, tips: Sequence[str], sliding: Array, surface: Surface,
    made: Pads,
) -> MujocoModel:  # fmt: skip
    try:
        model = spec.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise WbcError(f"{robot.path}: MuJoCo refuses the robot or the object: {reason}") from None

    def index(kind: Any, name: str) -> int:
        return int(mj.mj_name2id(model, kind, name))

    kinds = mj.mjtObj
    for name in {*robot.followers.keys(), *robot.followers.values()}:
        model.dof_invweight0[model.jnt_dofadr[index(kinds.mjOBJ_JOINT, name)]] *= _STIFFER
    joints = [index(kinds.mjOBJ_JOINT, name) for name in robot.full_names]
    pads = np.array([index(kinds.mjOBJ_GEOM, f"pad {tip}") for tip in tips], dtype=np.int64)
    free = index(kinds.mjOBJ_JOINT, OBJECT)
    table = index(kinds.mjOBJ_BODY, TABLE)
    plates = found(mj, model, surface, made, tips, pads) if surface.planar else None
    whole = np.full(len(tips), index(kinds.mjOBJ_GEOM, OBJECT))
    motors = [index(kinds.mjOBJ_ACTUATOR, name) for name in robot.joint_names]
    return MujocoModel(
        robot=robot,
        spec=spec,
        model=model,
        position=np.array(model.jnt_qposadr[joints], dtype=np.int64),
        velocity=np.array(model.jnt_dofadr[joints], dtype=np.int64),
        motor=np.array(motors, dtype=np.int64),
        object_body=index(kinds.mjOBJ_BODY, OBJECT),
        object_position=int(model.jnt_qposadr[free]),
        object_velocity=int(model.jnt_dofadr[free]),
        object_geom=whole if plates is None else plates.plate,
        pad_geom=pads,
        pad_body=np.array(model.geom_bodyid[pads], dtype=np.int64),
        sliding_friction=sliding,
        plates=plates,
        fixture=index(kinds.mjOBJ_EQUALITY, FIXTURE),
        fixture_body=int(model.body_mocapid[index(kinds.mjOBJ_BODY, FIXTURE)]),
        table_body=-1 if table < 0 else int(model.body_mocapid[table]),
    )


def wxyz(rotation: Array) -> Array:
    """A rotation matrix (3, 3) as MuJoCo's quaternion (4,), the real part first."""
    x, y, z, w = pin.Quaternion(np.asarray(rotation)).coeffs()
    return np.array([w, x, y, z])
