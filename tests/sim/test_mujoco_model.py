"""MuJoCo's model against Pinocchio's, and against MuJoCo's own reader of the same URDF."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from tests.conformance.robots import robot as suite_robot
from tests.scenario.own_robots import ROBOTS as EXAMPLES
from tests.scenario.own_robots import need_example_robots
from tests.sim.mujoco_worlds import FAR, TIPS, model, stools, table_below
from wbc import resources
from wbc.contact.surfaces import SURFACES, Surface
from wbc.errors import WbcError
from wbc.robot.dynamics import InverseDynamics
from wbc.robot.model import RobotModel, load_robot
from wbc.robot.packages import locate
from wbc.sim.mujoco_model import MujocoModel, rotor_defaults
from wbc.sim.mujoco_plant import MujocoPlant
from wbc.sim.mujoco_shapes import even_inertia

mujoco = pytest.importorskip("mujoco")

ROBOTS = ("dual_arm", "hand", "coupled")
GRAVITY = 9.81


def _robot(name: str) -> tuple[RobotModel, list[str]]:
    if name == "dual_arm":
        return load_robot(resources.find("urdf", name)), TIPS
    return suite_robot(name), ["tip_a", "tip_b"]


def _at(made: MujocoModel, q: np.ndarray, v: np.ndarray) -> Any:
    """MuJoCo's data at a state of the robot."""
    data, robot = mujoco.MjData(made.model), made.robot
    data.qpos[made.position] = robot.full(q)
    data.qvel[made.velocity] = robot.ratio * v[robot.master]
    data.qpos[made.object_position :][:3] = FAR
    mujoco.mj_forward(made.model, data)
    return data


def _mass_matrix(mjmodel: Any, data: Any) -> np.ndarray:
    out = np.zeros((mjmodel.nv, mjmodel.nv))
    mujoco.mj_fullM(mjmodel, data, out)
    return out


def _symmetric(upper: np.ndarray) -> np.ndarray:
    return np.triu(upper) + np.triu(upper, 1).T


@pytest.mark.parametrize("name", ROBOTS)
def test_inertia_and_bias_are_those_of_pinocchio(name: str) -> None:
    robot, tips = _robot(name)
    made = model(robot, tips)
    rng = np.random.default_rng(3)
    tree, work = robot.pin_model, robot.pin_model.createData()
    moving = [body for body in range(1, made.model.nbody) if body != made.object_body]
    for _ in range(5):
        low, high = np.maximum(robot.lower, -3.0), np.minimum(robot.upper, 3.0)
        q, v = rng.uniform(low, high), rng.normal(size=robot.nv)
        data, full = _at(made, q, v), robot.full(q)
        speeds = robot.ratio * v[robot.master]
        chosen = np.ix_(made.velocity, made.velocity)
        mass = _symmetric(pin.crba(tree, work, full))
        assert np.abs(_mass_matrix(made.model, data)[chosen] - mass).max() < 1e-9
        bias = pin.nonLinearEffects(tree, work, full, speeds)
        assert np.abs(data.qfrc_bias[made.velocity] - bias).max() < 1e-9
        pin.centerOfMass(tree, work, full)
        masses = made.model.body_mass[moving]
        com = masses @ data.xipos[moving] / masses.sum()
        assert masses.sum() == pytest.approx(work.mass[0] or pin.computeTotalMass(tree), rel=1e-12)
        assert np.abs(com - work.com[0]).max() < 1e-9


def test_inertia_is_that_of_an_independent_reader() -> None:
    """MuJoCo reads the URDF itself; nothing of that goes through Pinocchio."""
    path = resources.find("urdf", "dual_arm")
    robot = load_robot(path)
    made = model(robot, TIPS)
    text = path.read_text(encoding="utf-8").replace(
        '<robot name="dual_arm">',
        '<robot name="dual_arm"><mujoco><compiler fusestatic="true" strippath="false"/></mujoco>',
    )
    other = mujoco.MjModel.from_xml_string(text)
    there = [mujoco.mj_name2id(other, mujoco.mjtObj.mjOBJ_JOINT, n) for n in robot.full_names]
    assert min(there) >= 0
    rng = np.random.default_rng(4)
    q = rng.uniform(robot.lower, robot.upper)
    data = mujoco.MjData(other)
    data.qpos[other.jnt_qposadr[there]] = robot.full(q)
    mujoco.mj_forward(other, data)
    theirs = _mass_matrix(other, data)[np.ix_(other.jnt_dofadr[there], other.jnt_dofadr[there])]
    ours = _mass_matrix(made.model, _at(made, q, np.zeros(robot.nv)))
    assert np.abs(ours[np.ix_(made.velocity, made.velocity)] - theirs).max() < 1e-9


def _motion(
    robot: RobotModel, q: np.ndarray, v: np.ndarray, tau: np.ndarray, duration: float,
    armature: np.ndarray, damping: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """q and v after `duration`, by Pinocchio and Runge-Kutta's rule in steps of 0.5 ms."""
    tree, work = robot.pin_model, robot.pin_model.createData()
    spread = np.zeros((robot.n_full, robot.nv))
    spread[np.arange(robot.n_full), robot.master] = robot.ratio

    def acceleration(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        full = robot.full(q)
        mass = spread.T @ _symmetric(pin.crba(tree, work, full)) @ spread + np.diag(armature)
        bias = spread.T @ pin.nonLinearEffects(tree, work, full, spread @ v)
        out: np.ndarray = np.linalg.solve(mass, tau - damping * v - bias)
        return out

    h = 5e-4
    for _ in range(round(duration / h)):
        a = acceleration(q, v)
        b = acceleration(q + h / 2 * v, v + h / 2 * a)
        c = acceleration(q + h / 2 * (v + h / 2 * a), v + h / 2 * b)
        d = acceleration(q + h * (v + h / 2 * b), v + h * c)
        q, v = q + h * v + h * h / 6 * (a + b + c), v + h / 6 * (a + 2 * b + 2 * c + d)
    return q, v


@pytest.mark.parametrize("name", ROBOTS)
def test_free_motion_is_that_of_pinocchio(name: str) -> None:
    """Also where joints follow others, with rotors and friction in the joints."""
    robot, tips = _robot(name)
    armature, damping = rotor_defaults(robot)
    made = model(robot, tips, armature=armature, joint_damping=damping)
    made.model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    rng = np.random.default_rng(5)
    q = 0.5 * (np.maximum(robot.lower, -1.0) + np.minimum(robot.upper, 1.0))
    v, tau = 0.2 * rng.normal(size=robot.nv), 0.002 * robot.effort * rng.normal(size=robot.nv)
    tau += _gravity(robot, q)
    expected_q, expected_v = _motion(robot, q, v, tau, 0.2, armature, damping)
    assert np.all((robot.lower < expected_q) & (expected_q < robot.upper))
    plant = MujocoPlant(made)
    plant.reset(q, v, FAR, np.eye(3))
    for _ in range(20):
        seen = plant.step(tau, 0.01)
    assert np.abs(seen.q - expected_q).max() < 1e-6
    assert np.abs(seen.v - expected_v).max() < 1e-5
    assert np.abs(plant.data.qpos[made.position] - robot.full(seen.q)).max() < 1e-8


def _gravity(robot: RobotModel, q: np.ndarray) -> np.ndarray:
    still = np.zeros(robot.nv)
    return InverseDynamics(robot).torques(q, still, still)


def test_first_order_of_the_plants_own_integrator() -> None:
    """Half the step, half the error: what is left is the integrator's, not the model's."""
    robot, tips = _robot("hand")
    armature, damping = np.full(robot.nv, 0.02), np.full(robot.nv, 0.1)
    q, v = 0.5 * (robot.lower + robot.upper), np.full(robot.nv, 0.2)
    tau = _gravity(robot, q)
    expected, _ = _motion(robot, q, v, tau, 0.2, armature, damping)
    errors = []
    for step in (1e-3, 5e-4):
        plant = MujocoPlant(model(robot, tips, armature=armature, joint_damping=damping, step=step))
        plant.reset(q, v, FAR, np.eye(3))
        for _ in range(100):
            seen = plant.step(tau, 2e-3)
        errors.append(np.abs(seen.q - expected).max())
    assert errors[0] < 2e-3
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)


def test_joints_are_found_by_name(tmp_path: Path) -> None:
    """Whatever the order in the file, a torque moves the joint it is for."""
    for order in ((0, 1, 2), (2, 0, 1), (1, 2, 0)):
        robot = stools(tmp_path, order)
        made = model(robot, ["tip_0", "tip_1", "tip_2"])
        assert robot.joint_names == ("lift_0", "lift_1", "lift_2")
        plant = MujocoPlant(made)
        plant.reset(np.array([0.01, 0.02, 0.03]), np.zeros(3), FAR, np.eye(3))
        masses = np.array([0.1, 0.2, 0.3])
        push = np.array([0.0, 0.0, 0.6])
        seen = plant.step(GRAVITY * masses + push, 1e-3)
        assert np.allclose(seen.q[:2], [0.01, 0.02], atol=1e-9)
        assert seen.v == pytest.approx([0.0, 0.0, 0.6 / 0.3 * 1e-3], abs=1e-9)


def test_mimic_robot_needs_no_torque_of_its_own() -> None:
    """What a follower weighs is carried by its master's motor."""
    robot, tips = _robot("coupled")
    plant = MujocoPlant(model(robot, tips, joint_damping=np.full(robot.nv, 0.05)))
    q = 0.5 * (robot.lower + robot.upper)
    plant.reset(q, np.zeros(robot.nv), FAR, np.eye(3))
    for _ in range(50):
        seen = plant.step(_gravity(robot, q), 2e-3)
    assert np.abs(seen.q - q).max() < 1e-6


def test_gravity_compensation_keeps_the_robot_still() -> None:
    robot, tips = _robot("dual_arm")
    armature, damping = rotor_defaults(robot)
    made = model(robot, tips, armature=armature, joint_damping=damping, torque=robot.effort)
    plant = MujocoPlant(made)
    q = 0.5 * (np.maximum(robot.lower, -0.5) + np.minimum(robot.upper, 0.5))
    plant.reset(q, np.zeros(robot.nv), FAR, np.eye(3))
    for _ in range(100):
        seen = plant.step(_gravity(robot, q), 2e-3)
    assert np.abs(seen.q - q).max() < 1e-8


def test_motors_end_at_their_limits(tmp_path: Path) -> None:
    robot = stools(tmp_path)
    made = model(robot, ["tip_0"], torque=np.array([2.0, 3.0, np.inf]))
    plant = MujocoPlant(made)
    plant.reset(np.zeros(3), np.zeros(3), FAR, np.eye(3))
    plant.step(np.array([50.0, -50.0, 50.0]), 1e-3)
    assert plant.data.qfrc_actuator[made.velocity] == pytest.approx([2.0, -3.0, 50.0])


BODIES = {
    "box": {"size": (0.1, 0.06, 0.04)},
    "cylinder": {"radius": 0.03, "length": 0.2},
    "sphere": {"radius": 0.04},
    "spheroid": {"a": 0.03, "b": 0.05},
    "superellipsoid": {"ax": 0.03, "ay": 0.04, "az": 0.05, "p": 4.0},
}


@pytest.mark.parametrize("kind", BODIES)
def test_object_has_its_shape_and_inertia(kind: str, tmp_path: Path) -> None:
    """A body that is told nothing but its mass weighs as MuJoCo finds for the same shape."""
    surface: Surface = SURFACES[kind](**BODIES[kind])
    made = model(stools(tmp_path), ["tip_0"], surface, 0.25)
    spec = made.spec.copy()
    body = spec.body("object")
    body.explicitinertial = False
    spec.geom("object").mass = 0.25
    theirs = spec.compile()
    assert made.model.body_mass[made.object_body] == 0.25
    inertia = even_inertia(surface, 0.25)
    assert np.sort(theirs.body_inertia[made.object_body]) == pytest.approx(
        np.sort(inertia), rel=1e-9 if kind in ("box", "cylinder") else 2e-3
    )


def test_overrides_reach_the_model(tmp_path: Path) -> None:
    robot = stools(tmp_path)
    made = model(
        robot, ["tip_0", "tip_1"], mass=0.7, com=(0.01, 0.0, -0.02), inertia=(3e-4, 2e-4, 4e-4),
        friction=np.array([0.3, 0.5]), table=table_below(FAR, 0.1),
    )  # fmt: skip
    body = made.object_body
    assert made.model.body_mass[body] == 0.7
    assert made.model.body_ipos[body] == pytest.approx([0.01, 0.0, -0.02])
    assert np.sort(made.model.body_inertia[body]) == pytest.approx([2e-4, 3e-4, 4e-4])
    assert made.model.geom_friction[made.pad_geom, 0] == pytest.approx([0.3, 0.5])
    top = made.model.geom("table")
    assert FAR[2] + top.pos[2] + top.size[2] == pytest.approx(0.1)


def test_what_mujoco_refuses_is_one_line(tmp_path: Path) -> None:
    robot = stools(tmp_path)
    weightless = tmp_path / "weightless.urdf"
    weightless.write_text(robot.text.replace('mass value="0.1"', 'mass value="1e-20"'))
    with pytest.raises(WbcError, match="MuJoCo refuses") as refusal:
        model(load_robot(weightless), ["tip_0"])
    assert "\n" not in str(refusal.value)


def test_hands_collide_with_each_other_and_the_object_only() -> None:
    robot, _ = _robot("dual_arm")
    made = model(robot, TIPS)

    def meet(one: str, other: str) -> bool:
        a, b = (made.model.geom(name) for name in (one, other))
        return bool((a.contype & b.conaffinity) | (b.contype & a.conaffinity))

    assert meet("pad right_thumb_tip", "object")
    assert meet("right_palm_0", "object") and meet("left_index_prox_link_0", "object")
    assert meet("right_palm_0", "left_palm_0")
    assert meet("pad right_index_tip", "left_ring_med_link_0")
    assert not meet("right_thumb_prox_link_0", "right_index_prox_link_0")
    assert not meet("pad right_thumb_tip", "pad right_index_tip")
    assert not meet("right_thumb_dist_link_0", "object")  # its pad stands for it
    assert not meet("torso_pitch_1_link_0", "object")
    assert not meet("right_arm_4_link_0", "left_arm_4_link_0")


OTHERS = (
    "allegro_hand_description/urdf/allegro_right_hand.urdf",
    "panda_description/urdf/panda.urdf",
    "baxter_description/urdf/baxter.urdf",
    "ur_description/urdf/ur5_robot.urdf",
)


@pytest.mark.parametrize("name", OTHERS)
def test_robots_of_others_convert(name: str) -> None:
    """With their meshes; or else they are refused by one line that says what is wrong."""
    need_example_robots()
    robot = load_robot(locate(f"{EXAMPLES}/{name}", Path.cwd()))
    ends = {robot.pin_model.parents[k + 1] for k in range(robot.n_full)}
    leaves = [f.name for f in robot.bodies if f.parentJoint > 0 and f.parentJoint not in ends]
    try:
        made = model(robot, leaves[:2])
    except WbcError as refusal:
        assert "MuJoCo refuses" in str(refusal) and "\n" not in str(refusal)
        return
    assert made.model.nu == robot.nv
    q = np.clip(np.zeros(robot.nv), robot.lower, robot.upper)
    work = robot.pin_model.createData()
    mass = _symmetric(pin.crba(robot.pin_model, work, robot.full(q)))
    data = _at(made, q, np.zeros(robot.nv))
    chosen = np.ix_(made.velocity, made.velocity)
    assert np.abs(_mass_matrix(made.model, data)[chosen] - mass).max() < 1e-9
