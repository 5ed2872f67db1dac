"""`Law` asked for the published form: on robots, against the settled one and the chains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conformance.robots import SETTINGS, robot
from conformance.worlds import FIXED, FREE, SLIDING, World, make_world, seeded

from wbc.arrays import Array
from wbc.contact.extended_finger import ExtendedKinematics, finger_jacobians
from wbc.contact.grasp import ContactState, ObjectReference, no_grasp
from wbc.control.law import Law, Motion
from wbc.control.task_stack import TaskStack
from wbc.robot.kinematics import Kinematics
from wbc.tasks import EquilibriumForce, EquilibriumMoment, TipPosition
from wbc.tasks.posture import Posture

MODES = {
    "planar": [(FIXED, FIXED, SLIDING, SLIDING), (SLIDING, FREE, FIXED, FREE), (FREE,) * 4],
    "hand": [(FIXED, SLIDING), (SLIDING, SLIDING), (FIXED, FREE)],
}
CASES = pytest.mark.parametrize(("robot_name", "modes"), [(r, m) for r in MODES for m in MODES[r]])


class Pair:
    """The settled and the printed law of one world, with the same tasks and the same metric."""

    def __init__(self, world: World, passive_weight: float = 1.0) -> None:
        self.world = world
        rng = seeded("metric", world.robot_name)
        tasks = [
            EquilibriumForce("force", 10.0, 0.3),
            EquilibriumMoment("moment", 10.0, 0.3),
            TipPosition("tip", 5.0, np.inf, 1, world.planar),
        ]
        stack = TaskStack(tasks, world.grasp.count, rng.uniform(0.5, 2.0, world.nv))
        self.settled = Law(world.kin, stack, (), None, 0.1)
        self.printed = Law(
            world.kin, stack, (), None, 0.1, printed=True, passive_weight=passive_weight
        )
        self.order = stack.level_order(range(len(tasks)))
        target = rng.normal(size=6)
        for law in (self.settled, self.printed):
            law.evaluate(
                world.q, world.state, world.reference, [None, None, target], [True] * len(tasks)
            )
            law.gradient[:] = seeded("gradient", world.robot_name).normal(size=world.nv)

    def gains(self, *rho: float) -> Array:
        return np.array(rho)[self.settled.stack.level_task]


def residuals(world: World, motion: Array) -> list[Array]:
    """(6,) of (34) per finger in contact: J_F q̇ + J_ξ ξ̇ + J_θ θ̇ + J_Δl Δl̇ − Gᵀ(v_od + K_o e_o)."""
    n = world.grasp.count
    v, passive = motion[: world.nv], motion[world.nv :]
    xi, theta = passive[: 2 * n].reshape(n, 2), passive[2 * n :].reshape(n, 3)
    found = []
    for i in range(n):
        if world.state.mode[i] == FREE:
            assert not xi[i].any() and not theta[i].any()
            continue
        if world.state.mode[i] == FIXED:
            assert not xi[i].any()
        j_f, j_xi, j_theta, j_dl, g_t = finger_jacobians(world.kin, i)
        rate = -j_dl[:, 0] * world.reference.reach_rate[i]
        found.append(
            j_f @ v + j_xi @ xi[i] + j_theta @ theta[i] + rate - g_t @ world.kin.twist_cmd[i]
        )
    return found


@CASES
def test_with_passive_joints_that_cost_nothing_the_main_tasks_agree(robot_name, modes):
    """The settled rows are (33) solved with a metric that charges ξ and θ nothing."""
    for seed in range(3):
        pair = Pair(make_world(robot_name, modes=modes, seed=seed), passive_weight=1e-12)
        settled = pair.settled.solve(pair.order, pair.gains(0, 0, 0)).main
        printed = pair.printed.solve(pair.order, pair.gains(0, 0, 0)).main
        assert pair.settled.independence > 0.01, "not a regular configuration"
        assert printed.shape == settled.shape
        np.testing.assert_allclose(printed, settled, atol=1e-8 * (1 + np.abs(settled).max()))


@CASES
@pytest.mark.parametrize("weight", [1.0, 1e-3])
def test_every_part_keeps_the_object_on_its_way(robot_name, modes, weight):
    """Main task alone and whole law satisfy (34) finger by finger; held variables stand still."""
    pair = Pair(make_world(robot_name, modes=modes), weight)
    motion = pair.printed.solve(pair.order, pair.gains(1, 0.5, 1))
    size = 1.0 + np.abs(motion.total).max()
    for part in motion:
        for residual in residuals(pair.world, part):
            np.testing.assert_allclose(residual, 0.0, atol=1e-9 * size)
    assert np.linalg.norm(motion.total - motion.main) > 1e-3
    if pair.world.planar:  # one chart coordinate, one pivot angle
        n, nv = pair.world.grasp.count, pair.world.nv
        assert not motion.total[nv : nv + 2 * n].reshape(n, 2)[:, 1].any()
        assert not motion.total[nv + 2 * n :].reshape(n, 3)[:, :2].any()


def test_lower_levels_are_not_seen_by_those_above():
    pair = Pair(make_world("planar", modes=(FIXED, FIXED, SLIDING, SLIDING)))
    law, stack = pair.printed, pair.printed.stack
    first = law.solve(pair.order, pair.gains(1, 0, 0)).total
    law.gradient[:] *= -3.0
    for rho in (0.0, 0.3, 1.0):
        changed = law.solve(pair.order, pair.gains(1, rho, rho)).total - first
        seen = stack.jacobian_ext[0] @ changed[: stack.jacobian_ext.shape[1]]
        assert abs(seen) < 1e-10 * (1.0 + np.linalg.norm(changed))


def test_a_level_converges_at_the_share_reported_as_its_freedom():
    """What the level adds to its own velocity is η K e, whatever the main task does to it (37)."""
    pair = Pair(make_world("planar", modes=(FIXED, FIXED, SLIDING, SLIDING)))
    law, stack = pair.printed, pair.printed.stack
    law.gradient[:] = 0.0
    motion: Motion = law.solve(pair.order, pair.gains(1, 0, 0))
    added = stack.jacobian_ext[0] @ (motion.total - motion.main)[: stack.jacobian_ext.shape[1]]
    wanted = 10.0 * np.clip(stack.error[0], -0.3, 0.3)
    eta = law.freedom[0]
    assert 0.0 < eta < 0.9
    assert added == pytest.approx(eta * wanted, rel=1e-9)
    np.testing.assert_array_equal(law.freedom[1:], 0.0)


def test_levels_out_of_force_leave_the_augmented_jacobian():
    pair = Pair(make_world("planar", modes=(FIXED, FIXED, SLIDING, SLIDING)))
    law = pair.printed
    without = law.solve(pair.order[1:], pair.gains(0, 1, 0)).total
    np.testing.assert_array_equal(law.solve(pair.order, pair.gains(0, 1, 0)).total, without)
    held = law.solve(pair.order, pair.gains(1e-12, 1, 0)).total
    assert np.abs(held - without).max() > 1e-3  # as printed: rows in J^A whatever ρ
    law.stack.row_activation[0] = 0.0
    np.testing.assert_array_equal(law.solve(pair.order, pair.gains(1, 1, 0)).total, without)


def test_near_a_rank_loss_it_says_so_and_is_finite():
    world = make_world("planar", modes=(FIXED,) * 4)
    straight = replace(world, q=np.zeros(world.nv))
    pair = Pair(straight)
    motion = pair.printed.solve(pair.order, pair.gains(1, 1, 1))
    assert np.isfinite(motion.total).all()
    assert pair.printed.independence < 0.1
    regular = Pair(world)
    regular.printed.solve(regular.order, regular.gains(1, 1, 1))
    assert regular.printed.rank == 12


def test_without_an_object_only_the_tasks_remain():
    model = robot("planar", prismatic=False)
    kin = ExtendedKinematics(Kinematics(model, SETTINGS["planar"].tips), no_grasp(True), 1.0)
    none = np.zeros(0)
    contact = ContactState.planned(kin.grasp, np.zeros(0, dtype=np.int64))
    reference = ObjectReference(np.zeros(3), np.eye(3), np.zeros(6), none, none)
    kin.update(np.zeros(model.nv), contact, reference)
    goal = np.linspace(-0.5, 0.5, model.nv)
    stack = TaskStack([Posture("posture", 2.0, np.inf, np.arange(model.nv), goal)], 0, goal + 1.0)
    stack.jacobian_ext[:], stack.rhs[:] = np.eye(model.nv), 2.0 * goal
    law = Law(kin, stack, (), None, 0.1, printed=True)
    motion = law.solve(stack.level_order([0]), np.ones(len(stack.level_start)))
    np.testing.assert_allclose(motion.total, 2.0 * goal, atol=1e-12)
    np.testing.assert_array_equal(motion.main, 0.0)
    assert (law.rank, law.independence) == (0, 1.0)
