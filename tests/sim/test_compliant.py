"""The compliant simulation: energy, momentum, order, and the contact law."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from tests.sim.worlds import PROBE, grippers, holding, pads, probe
from wbc import resources
from wbc.arrays import Array
from wbc.contact.grasp import ContactMode
from wbc.contact.surfaces.box import Box
from wbc.contact.surfaces.sphere import Sphere
from wbc.robot.dynamics import InverseDynamics
from wbc.robot.model import RobotModel, load_robot
from wbc.rotations import exp_so3
from wbc.sim.compliant import CompliantPlant, FreeBody, Physics
from wbc.sim.plant import Sensed

STEPS = (1e-3, 5e-4, 2.5e-4)
WALL = FreeBody(1e12, np.zeros(3), np.full(3, 1e12))
"""An object that nothing moves."""


def order(errors: list[float]) -> float:
    """Least order of errors that belong to steps halved each time."""
    return min(np.log2(a / b) for a, b in pairwise(errors))


def jogged(step: float) -> tuple[CompliantPlant, Sensed, float]:
    """40 ms of the grippers under uneven torques, tips stuck; and the energy they began with."""
    assembly, plant = grippers(step)
    tau = holding(assembly, plant) + 2.0 * np.random.default_rng(0).normal(size=assembly.model.nv)
    plant.reset(assembly.start.q, np.zeros(assembly.model.nv), np.zeros(3), np.eye(3))
    energy = plant.energy
    for _ in range(20):
        sensed = plant.step(tau, 2e-3)
    return plant, sensed, energy


def test_energy_is_what_the_torques_put_in_less_what_is_lost() -> None:
    errors = []
    for step in STEPS:
        plant, sensed, energy = jogged(step)
        assert np.array_equal(sensed.slip, np.zeros(4))
        assert plant.work > 0.1 and plant.lost > 1e-4
        errors.append(abs(plant.energy - energy - plant.work + plant.lost))
    assert errors[1] < 1e-7  # [J]: of 0.16 put in
    assert order(errors) > 3.8


def test_order_of_the_rule_on_smooth_contact() -> None:
    _, fine, _ = jogged(3.125e-5)
    errors = [float(np.linalg.norm(jogged(step)[1].q - fine.q)) for step in STEPS]
    assert order(errors) > 3.7


def test_order_of_the_rule_without_contact() -> None:
    def swung(step: float) -> Array:
        assembly, plant = grippers(step)
        away = np.array([50.0, 0.0, 0.0])
        rng = np.random.default_rng(1)
        plant.reset(assembly.start.q, rng.normal(size=assembly.model.nv), away, np.eye(3))
        tau = 5.0 * rng.normal(size=assembly.model.nv)
        for _ in range(10):
            sensed = plant.step(tau, 0.02)
        assert not sensed.force.any()
        return sensed.q

    fine = swung(1.25e-3)
    errors = [float(np.linalg.norm(swung(step) - fine)) for step in (2e-2, 1e-2, 5e-3)]
    assert order(errors) > 3.7


def test_free_object_keeps_its_momentum() -> None:
    errors = []
    for step in (4e-3, 2e-3, 1e-3):
        body = FreeBody(1.0, np.array([0.02, 0.0, 0.01]), np.array([1e-3, 2e-3, 2.5e-3]))
        plant = probe(Sphere(0.05), body, step)
        away, twist = np.array([1.0, 0.0, 0.0]), np.array([0.1, -0.2, 0.3, 3.0, 1.0, -2.0])
        plant.reset(away, np.zeros(3), np.zeros(3), exp_so3(np.ones(3)), twist)
        before = plant.momentum
        plant.step(np.zeros(3), 4e-3)
        energy = plant.energy
        for _ in range(100):
            plant.step(np.zeros(3), 4e-3)
        assert plant.momentum[:3] == pytest.approx(before[:3], rel=1e-14)
        errors.append(float(np.linalg.norm(plant.momentum[3:] - before[3:])))
        assert plant.energy == pytest.approx(energy, rel=1e-7)
    assert errors[-1] < 1e-12
    assert order(errors) > 3.7


def test_object_takes_the_impulse_that_the_tips_sense() -> None:
    assembly, plant = grippers(2.5e-4)
    tau = holding(assembly, plant) + 2.0 * np.random.default_rng(2).normal(size=assembly.model.nv)
    sensed = plant.reset(assembly.start.q, 0.0 * tau, np.zeros(3), np.eye(3))
    before, push, turn = plant.momentum, [], []
    for k in range(161):
        push.append(sensed.force.sum(axis=0))
        kin = assembly.controller.law.kin.robot.update(sensed.q)
        turn.append(np.cross(kin.position[:4], sensed.force).sum(axis=0))
        if k < 160:
            sensed = plant.step(tau, 2.5e-4)
    weights = np.full(161, 2.0)
    weights[1::2], weights[[0, -1]] = 4.0, 1.0  # Simpson
    got = np.concatenate([weights @ np.array(push), weights @ np.array(turn)]) * 2.5e-4 / 3.0
    change = plant.momentum - before
    assert np.linalg.norm(change) > 0.01
    assert change == pytest.approx(got, abs=1e-7)


def test_forces_stay_in_the_cone_and_never_pull() -> None:
    assembly, plant = grippers(5e-4, friction=0.3)
    rng, tau = np.random.default_rng(3), holding(assembly, plant)
    sensed = plant.reset(assembly.start.q, 0.0 * tau, np.zeros(3), np.eye(3))
    touched = slid = 0
    for k in range(400):
        if k % 10 == 0:
            jolt = 20.0 * rng.normal(size=len(tau))
        sensed = plant.step(tau + jolt, 1e-3)
        foot = plant.feet.records[:, :3] @ sensed.object_rotation.T
        normal = np.cross(foot[:, 1], foot[:, 2])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        press = -np.einsum("ir,ir->i", normal, sensed.force)
        across = np.linalg.norm(sensed.force + press[:, None] * normal, axis=1)
        assert (press >= -1e-12).all()
        assert (across <= 0.3 * press * (1.0 + 1e-9) + 1e-12).all()
        touched += int((press > 0.0).sum())
        slid += int((across > 0.299 * press).sum())
    assert touched > 50 and slid > 10  # the test has seen what it is about
    assert np.isfinite(sensed.q).all()


def pressed(across: float, friction: float = 0.8) -> list[Sensed]:
    """1.5 s of a tip pressed on a wall's top with 10 N, pushed sideways ever harder for 0.5 s."""
    plant = probe(Box((100.0, 100.0, 1.0)), WALL, 1e-3, friction)
    sensed = plant.reset(np.array([0.0, 0.0, 0.5048]), np.zeros(3), np.zeros(3), np.eye(3))
    found = [sensed]
    for k in range(1500):
        aside = across * min(k / 500.0, 1.0)
        sensed = plant.step(np.array([aside, 0.0, -10.0 - 30.0 * sensed.v[2]]), 1e-3)
        found.append(sensed)
    return found


def test_a_loaded_tip_sticks_and_does_not_creep() -> None:
    found = pressed(7.5)
    rest, end = found[1000], found[-1]
    assert end.slip[0] == 0.0
    assert end.force[0, 0] == pytest.approx(7.5, abs=1e-6)
    assert abs(end.q[0] - rest.q[0]) < 1e-9
    assert end.q[0] == pytest.approx(7.5 / 2e4, abs=1e-8)


def test_a_tip_pushed_beyond_its_cone_slides_as_coulomb_says() -> None:
    found = pressed(9.0)
    press = -found[-1].force[0, 2]
    assert found[-1].force[0, 0] == pytest.approx(0.8 * press, rel=1e-9)
    speeds = np.array([sensed.v[0] for sensed in found])
    assert (speeds[1400] - speeds[600]) == pytest.approx(0.8 * (9.0 - 8.0) / 0.5, rel=1e-3)
    assert found[-1].slip[0] == pytest.approx(found[-1].q[0] - 8.0 / 2e4, rel=1e-3)


def test_tips_that_slide_on_purpose_have_their_own_friction_and_no_slip() -> None:
    plant = probe(Box((1.0, 1.0, 1.0)), WALL, 1e-3)
    plant.reset(np.array([0.0, 0.0, 0.5048]), np.zeros(3), np.zeros(3), np.eye(3))
    plant.treat(np.array([ContactMode.SLIDING]))
    sensed = plant.step(np.array([1.0, 0.0, -10.0]), 1e-3)
    assert sensed.slip[0] == 0.0
    assert abs(sensed.force[0, 0]) < 1e-12 and sensed.force[0, 2] < -1.0


def test_a_tip_that_comes_from_afar_touches_a_round_body_and_leaves_it() -> None:
    plant = probe(Sphere(0.035), WALL, 1e-3)
    start = np.array([0.3, 0.1, 0.2])
    sensed = plant.reset(start, -start, np.zeros(3), np.eye(3))
    touched, energy = [], 0.25 * float(start @ start)
    for _ in range(1500):
        sensed = plant.step(np.zeros(3), 1e-3)
        depth = 0.035 + 5e-3 - float(np.linalg.norm(sensed.q))
        touched.append(bool(sensed.force.any()))
        if abs(depth) > 5e-5:  # a pad that opens faster than its damper lets go early
            assert touched[-1] == (depth > 0.0)
    first, last = touched.index(True), 1500 - touched[::-1].index(True)
    assert 0.85 < first * 1e-3 < 0.92 and last - first < 30
    assert plant.energy == pytest.approx(energy - plant.lost, rel=3e-3)
    assert 0.0 < plant.lost < 0.2 * energy


@pytest.fixture(scope="module")
def hands() -> tuple[RobotModel, CompliantPlant]:
    """Two arms with hands whose finger joints follow each other, and a ball far away."""
    model = load_robot(resources.find("urdf", "dual_arm"))
    assert model.n_full > model.nv
    one, none = np.ones(1), np.zeros(model.nv)
    given = Physics(1e-3, 0.8 * one, 0.0 * one, none, none)
    body = FreeBody(0.2, np.zeros(3), np.full(3, 1e-4))
    plant = CompliantPlant(model, ("right_thumb_tip",), Sphere(0.035), body, pads(1), given)
    return model, plant


def test_joints_that_follow_others_carry_their_share(
    hands: tuple[RobotModel, CompliantPlant],
) -> None:
    model, plant = hands
    rng = np.random.default_rng(7)
    q = 0.5 * (model.lower + model.upper) + 0.1 * rng.normal(size=model.nv)
    v, tau = 0.5 * rng.normal(size=model.nv), 0.02 * rng.normal(size=model.nv)
    plant.reset(q, v, np.array([9.0, 0.0, 0.0]), np.eye(3))
    h = 1e-7
    a = (plant.step(tau, h).v - v) / h
    found = InverseDynamics(model).torques(q, v, a)
    assert np.abs(a).max() > 10.0
    assert found == pytest.approx(tau, abs=1e-4)


def test_energy_of_a_robot_in_space_with_coupled_joints(
    hands: tuple[RobotModel, CompliantPlant],
) -> None:
    model, plant = hands
    q = 0.5 * (model.lower + model.upper)
    sensed = plant.reset(q, np.zeros(model.nv), np.array([9.0, 0.0, 0.0]), np.eye(3))
    energy = plant.energy
    tau = InverseDynamics(model).torques(q, sensed.v, sensed.v)
    tau += 1e-3 * np.random.default_rng(8).normal(size=model.nv)
    for _ in range(50):
        sensed = plant.step(tau, 1e-3)
    assert np.abs(sensed.v).max() > 0.1
    assert plant.energy == pytest.approx(energy + plant.work - plant.lost, abs=1e-9)


def test_armature_and_joint_friction() -> None:
    model = load_robot(Path("probe.urdf"), text=PROBE)
    model.pin_model.gravity.linear = np.zeros(3)
    armature, rubbing = np.array([0.5, 1.5, 0.0]), np.array([0.0, 0.0, 2.0])
    given = Physics(1e-3, np.ones(1), np.zeros(1), armature, rubbing)
    plant = CompliantPlant(model, ("tip",), Sphere(0.05), WALL, pads(1), given)
    plant.reset(np.ones(3), np.array([0.0, 0.0, 1.0]), np.zeros(3), np.eye(3))
    for _ in range(100):
        sensed = plant.step(np.array([1.0, 1.0, 0.0]), 1e-3)
    assert sensed.v == pytest.approx([0.1 / 1.0, 0.1 / 2.0, np.exp(-0.1 * 2.0 / 0.5)], rel=1e-9)
    assert plant.lost == pytest.approx(0.25 * (1.0 - sensed.v[2] ** 2), rel=1e-9)


def test_a_push_and_a_lost_contact() -> None:
    assembly, plant = grippers(5e-4)
    tau = holding(assembly, plant)
    sensed = plant.reset(assembly.start.q, 0.0 * tau, np.zeros(3), np.eye(3))
    before, energy = plant.momentum, plant.energy
    plant.disturb(np.array([3.0, 0.0, 0.0]), np.ones(4, dtype=np.bool_))
    for _ in range(50):
        sensed = plant.step(0.0 * tau, 2e-3)
    assert not sensed.force.any()
    assert plant.momentum - before == pytest.approx([0.3, 0.0, 0.0, 0.0, 0.0, 0.0], abs=1e-12)
    assert sensed.object_position[0] == pytest.approx(0.5 * 3.0 * 0.1**2, rel=1e-9)
    assert plant.energy == pytest.approx(energy + plant.work - plant.lost - 0.008, abs=1e-6)
    sensed = plant.reset(assembly.start.q, 0.0 * tau, np.zeros(3), np.eye(3))
    assert sensed.force.any()  # nothing of it is left


def test_steps_are_reproducible() -> None:
    a, b = jogged(1e-3)[1], jogged(1e-3)[1]
    for one, other in zip(a, b, strict=True):
        assert np.array_equal(one, other)


NO_NUMBERS = [
    [np.nan, 0.0, 0.0], [0.0, np.inf, 0.0], [np.inf, -np.inf, np.nan], [1e300, 0.0, 0.0],
    [1e308, 1e308, 1e308], [0.0, 1e160, 0.0],
]  # fmt: skip


@pytest.mark.parametrize("feedback", [False, True])
@pytest.mark.parametrize("tau", NO_NUMBERS)
def test_numbers_that_are_none_do_not_raise(tau: list[float], feedback: bool) -> None:
    plant = probe(Sphere(0.05), FreeBody(0.3, np.zeros(3), np.full(3, 1e-3)), 5e-4)
    away, still = np.array([0.0, 0.0, 0.5]), np.zeros(3)

    def step(torques: Array) -> Sensed:
        if feedback:
            return plant.step_feedback(lambda _, measured: torques + 0.0 * measured.q, 2e-3)
        return plant.step(torques, 2e-3)

    plant.reset(still, still, away, np.eye(3))
    first, later = step(np.array(tau)), step(still)  # for good
    for values in (*first, *later):
        assert np.isnan(values).all()
    seen = plant.reset(still, still, away, np.eye(3))
    again = step(still)
    for values in (*seen, *again):
        assert np.isfinite(values).all()


def test_pushes_and_states_that_are_no_numbers_do_not_raise() -> None:
    plant = probe(Sphere(0.05), FreeBody(0.3, np.zeros(3), np.full(3, 1e-3)), 5e-4)
    still, lost = np.zeros(3), np.zeros(1, dtype=np.bool_)
    plant.reset(still, still, np.array([0.0, 0.0, 0.054]), np.eye(3))
    plant.disturb(np.array([0.0, np.nan, 0.0]), lost)
    assert np.isnan(plant.step(still, 2e-3).object_position).all()
    assert np.isnan(plant.reset(still, np.full(3, np.nan), still, np.eye(3)).q).all()


def test_what_diverges_is_said_and_does_not_begin_anew() -> None:
    """Joints with more friction than the step can bear: the rule goes to infinity by itself."""
    model = load_robot(Path("probe.urdf"), text=PROBE)
    physics = Physics(5e-4, np.full(1, 0.8), np.zeros(1), np.zeros(3), np.full(3, 1e5))
    body = FreeBody(0.3, np.zeros(3), np.full(3, 1e-3))
    plant = CompliantPlant(model, ("tip",), Sphere(0.05), body, pads(1), physics)
    plant.reset(np.zeros(3), np.array([0.1, 0.0, 0.0]), np.array([0.0, 0.0, 0.5]), np.eye(3))
    seen = [plant.step(np.zeros(3), 2e-3) for _ in range(50)]
    gone = np.array([[bool(np.isnan(values).all()) for values in one] for one in seen])
    first = int(np.argmax(gone.any(axis=1)))
    assert gone[first:].all() and not gone[:first].any()
    assert all(np.isfinite(values).all() for one in seen[:first] for values in one)
