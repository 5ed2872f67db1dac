"""Each hand on its own, with the load that (21) gave it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from wbc.errors import WbcError
from wbc.forces import POINT, SOFT_FINGER, ForceStatus
from wbc.forces.cost import cost
from wbc.forces.flow_kernels import assemble, fixed, tick
from wbc.forces.split import by_component, rooms, split

from . import reference
from .problems import pouring, two_hands

HANDS = np.repeat([0, 1], 5)


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("model", [POINT, SOFT_FINGER])
def test_the_sum_balances_inside_all_limits(model: str, weighted: bool) -> None:
    ticks = list(pouring(model))[:200:10]
    c = reference.optimum(ticks[0])
    for before, now in pairwise(ticks):
        found = split(before, c, now, HANDS, weighted=weighted)
        solution = found.solution
        assert solution.status is ForceStatus.SOLVED
        assert solution.balance < 1e-9
        assert solution.min_cone_margin > 0.0 and solution.min_torque_margin > 0.0
        np.testing.assert_allclose(found.share.sum(), 1.0)
        c = solution.c
        # above the common optimum: the price that the chapter names
        assert solution.phi > cost(now, reference.optimum(now)) * (1.0 - 1e-9)


def test_each_hand_is_optimal_for_its_load() -> None:
    problem = two_hands(load=1.0)
    start = reference.feasible_start(problem)
    assert start is not None
    found = split(problem, start, problem, HANDS, weighted=False, tolerance=1e-13, most=30000)
    c = found.solution.c
    for h in range(2):
        rows, joints = slice(15 * h, 15 * h + 15), slice(15 * h, 15 * h + 15)
        alone = type(problem)(
            G=problem.G[:, rows], J=problem.J[rows, joints], tau_e=problem.tau_e[joints],
            tau_min=problem.tau_min[joints], tau_max=problem.tau_max[joints],
            mu=problem.mu[:5], h_e=problem.G[:, rows] @ start[rows],
        )  # fmt: skip
        best = cost(alone, reference.optimum(alone, start[rows]))
        assert cost(alone, c[rows]) / best - 1.0 < 1e-5


def test_mirrored_hands_carry_the_same() -> None:
    """Two hands that are each other's half turn, with a load that is too: mirrored forces."""
    problem = two_hands()
    turn = np.diag([-1.0, -1.0, 1.0])
    one = problem.G[:, :15]
    other = np.vstack([turn @ one[:3], turn @ one[3:]])
    jacobian = np.zeros_like(problem.J)
    jacobian[:15, :15] = jacobian[15:, 15:] = problem.J[:15, :15]
    both = problem.with_(
        G=np.hstack([one, other]), J=jacobian, tau_e=np.tile(problem.tau_e[:15], 2),
        h_e=np.array([0.0, 0.0, 2.0, 0.0, 0.0, 0.0]),
    )  # fmt: skip
    half = reference.feasible_start(both)
    assert half is not None
    start = reference.optimum(both, half)
    np.testing.assert_allclose(start[:15], start[15:], atol=1e-6)
    found = split(both, start, both, HANDS)
    np.testing.assert_allclose(found.solution.c[:15], found.solution.c[15:], atol=1e-4)
    np.testing.assert_allclose(found.share, 0.5, atol=1e-6)


def test_weights_send_a_new_load_to_the_hand_with_more_room() -> None:
    """(22) (23): the hand nearer to its limits takes less of a change of the load."""
    problem = two_hands(load=1.0)
    c = reference.optimum(problem)
    rows = assemble(fixed(problem), tick(problem))
    slack = rows.b @ (c / problem.scale) + rows.free
    delta = rooms(rows.b, slack, by_component(problem, HANDS))
    # the first hand is made weaker, down to a fifth of its room
    joint = np.arange(30)
    tau = problem.J.T @ c + problem.tau_e
    less = 0.8 * delta[0] * np.sign(tau) * (joint < 15)
    weak = problem.with_(tau_e=problem.tau_e + less)
    if reference.feasible_start(weak) is None:
        pytest.skip("not feasible")
    heavier = weak.with_(h_e=1.02 * problem.h_e)
    loads = {}
    for weighted in (False, True):
        found = split(weak, c, heavier, HANDS, weighted=weighted)
        assert found.solution.status is ForceStatus.SOLVED
        assert found.share[0] < 0.5
        change = problem.G[:3, :15] @ (found.solution.c[:15] - c[:15])
        loads[weighted] = change @ problem.h_e[:3]
    assert loads[True] < loads[False]


def test_no_room_and_no_limits() -> None:
    """δ → 0 divides by zero in (22) as printed; without limits there is no δ at all."""
    hand = np.repeat([0, 1], 3)
    b = np.kron(np.eye(2), np.ones((1, 3)))
    np.testing.assert_allclose(rooms(b, np.array([0.0, 2.0]), hand), [2e-3, 2.0])
    np.testing.assert_allclose(rooms(b, np.array([1e-300, 2.0]), hand), [2e-3, 2.0])
    np.testing.assert_allclose(rooms(b[:1], np.array([0.3]), hand), [0.3, 0.3])
    np.testing.assert_allclose(rooms(b[:0], np.zeros(0), hand), [1.0, 1.0])


@pytest.mark.parametrize("seed", range(4))
def test_shared_arm_joints_keep_their_limits(seed: int) -> None:
    """Joints that move both hands: each hand may use half of what room they have."""
    problem = two_hands(load=1.0, arms=2, seed=seed)
    jacobian = np.array(problem.J)
    jacobian[:15, 32:] = 0.3 * jacobian[15:, 32:]  # the second arm's joints move the first too
    c = reference.optimum(problem)
    tau = jacobian.T @ c + problem.tau_e
    limit = np.array(problem.tau_max)
    limit[30:] = abs(tau[30:]) + 0.02
    shared = problem.with_(J=jacobian, tau_min=-limit, tau_max=limit)
    start = reference.feasible_start(shared)
    assert start is not None
    found = split(shared, start, shared, HANDS, tolerance=1e-9, most=20000).solution
    assert found.status is ForceStatus.SOLVED and found.balance < 1e-9
    assert found.min_torque_margin > 0.0
    assert found.phi < cost(shared, start)


def test_a_hand_that_cannot_answer_every_wrench() -> None:
    problem = two_hands(load=1.0)
    c = reference.optimum(problem)
    hands = np.array([0, 0, 1, 1, 1, 1, 1, 1, 1, 1])
    assert split(problem, c, problem, hands).solution.status is ForceStatus.RANK_DEFICIENT


def test_statuses_and_refusals() -> None:
    problem = two_hands(load=1.0)
    c = reference.optimum(problem)
    assert split(problem, 50.0 * c, problem, HANDS).solution.status is ForceStatus.STALE_START
    heavy = problem.with_(h_e=100.0 * problem.h_e)
    assert split(problem, c, heavy, HANDS, most=100).solution.status is ForceStatus.NOT_BALANCED
    for bad in (HANDS[:3], HANDS.astype(float), 2 * HANDS):
        with pytest.raises(WbcError, match="hands"):
            split(problem, c, problem, bad)
