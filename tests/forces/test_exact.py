"""The least Σ c_z: against Clarabel, with the gap that is stated; and problems at the edge."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from wbc.arrays import Array
from wbc.forces import POINT, SOFT_FINGER, ForceStatus, GraspForceProblem, GraspForceSolution, solve

from . import oracles
from .problems import contact_frame, cylinder_points, grasp_matrix, pouring, random_grasp, two_hands
from .test_verdict import in_forces, in_lengths

GAP = 1e-6
"""What the exact mode promises: Σ c_z above its optimum, relative to it."""


def checked(problem: GraspForceProblem) -> tuple[GraspForceSolution, float]:
    """The exact solution, held against Clarabel; and Clarabel's Σ c_z."""
    found, best = solve(problem, "exact"), oracles.exact(problem)
    assert best.status in ("Solved", "AlmostSolved")
    assert found.status.usable
    assert found.balance <= 1e-9
    assert found.min_cone_margin >= 0.0 and found.min_torque_margin >= 0.0
    over = found.sum_normal / best.value - 1.0
    noise = 1e-8  # of Clarabel, on both sides
    assert -noise <= over <= found.gap + noise
    assert found.gap <= GAP
    np.testing.assert_allclose(found.sum_normal, found.c[problem.normal].sum(), rtol=1e-12)
    return found, best.value


@pytest.mark.parametrize("model", [POINT, SOFT_FINGER])
@pytest.mark.parametrize("load", [0.1, 1.0, 1.4, 2.0, 3.0])
@pytest.mark.parametrize("arms", [0, 7])
def test_two_hands(model: str, load: float, arms: int) -> None:
    checked(two_hands(model, load=load, arms=arms))


@pytest.mark.parametrize("seed", range(40))
def test_random_grasps(seed: int) -> None:
    problem = random_grasp(np.random.default_rng([5, seed]))
    if oracles.margin(problem).value > 1e-4:
        checked(problem)
    elif oracles.margin(problem).value < -1e-4:
        assert not solve(problem, "exact").status.usable


@pytest.mark.parametrize("model", [POINT, SOFT_FINGER])
@pytest.mark.parametrize("load", [1.0, 1.4])
def test_while_pouring(model: str, load: float) -> None:
    for k, problem in enumerate(pouring(model, load=load, dt=0.02)):
        if k % 5 == 0:
            checked(problem)


def test_nothing_binds() -> None:
    problem = two_hands(load=1.0)
    wide = problem.with_(tau_min=1e3 * problem.tau_min, tau_max=1e3 * problem.tau_max)
    free = np.full(problem.joints, np.inf)
    sums = [checked(p)[0].sum_normal for p in (wide, wide.with_(tau_min=-free, tau_max=free))]
    assert sums[0] == pytest.approx(sums[1], rel=2.0 * GAP)


def test_no_joints_at_all() -> None:
    problem = two_hands()
    none = np.zeros(0)
    found, _ = checked(
        problem.with_(J=np.zeros((problem.size, 0)), tau_e=none, tau_min=none, tau_max=none)
    )
    assert found.min_torque_margin == np.inf and found.tau.shape == (0,)


@pytest.mark.parametrize("model", [POINT, SOFT_FINGER])
def test_nearly_everything_binds(model: str) -> None:
    problem = two_hands(model)
    most = oracles.load_factor(problem).value
    for less in (1e-2, 1e-3):
        checked(problem.with_(h_e=(1.0 - less) * most * problem.h_e))


def test_some_joints_without_limits() -> None:
    problem = two_hands(load=1.4)
    low, high = np.array(problem.tau_min), np.array(problem.tau_max)
    low[::4], high[::4] = -np.inf, np.inf
    found, _ = checked(problem.with_(tau_min=low, tau_max=high))
    assert np.isinf(found.torque_margin[::4]).all()


def test_uneven_limits() -> None:
    problem = two_hands(load=1.4)
    checked(problem.with_(tau_min=0.3 * problem.tau_min, tau_max=2.0 * problem.tau_max))


@pytest.mark.parametrize("mu", [0.05, 0.2, 3.0, 100.0])
def test_friction_from_slippery_to_sticky(mu: float) -> None:
    problem = two_hands(mu=np.full(10, mu))
    free = np.full(problem.joints, np.inf)
    checked(problem.with_(tau_min=-free, tau_max=free))


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e3, 1e6])
def test_scale_of_forces(scale: float) -> None:
    problem = two_hands(SOFT_FINGER, load=1.4)
    found, best = checked(problem)
    scaled = solve(in_forces(problem, scale), "exact")
    assert scaled.status.usable and scaled.gap <= GAP
    assert scaled.sum_normal == pytest.approx(scale * best, rel=GAP)
    assert scaled.sum_normal == pytest.approx(scale * found.sum_normal, rel=2.0 * GAP)


@pytest.mark.parametrize("model", [POINT, SOFT_FINGER])
def test_units_of_length(model: str) -> None:
    problem = two_hands(model, load=1.4)
    found, other = checked(problem)[0], checked(in_lengths(problem, 1e3))[0]
    assert other.sum_normal == pytest.approx(found.sum_normal, rel=2.0 * GAP)


def test_order_of_contacts() -> None:
    problem = random_grasp(np.random.default_rng(3), model=SOFT_FINGER)
    assert oracles.margin(problem).value > 1e-3
    turned = np.roll(np.arange(problem.contacts), 1)
    rows = np.concatenate([np.arange(4 * i, 4 * i + 4) for i in turned])
    assert problem.mu_t is not None
    other = problem.with_(
        G=problem.G[:, rows], J=problem.J[rows], mu=problem.mu[turned], mu_t=problem.mu_t[turned]
    )
    one, two = solve(problem), solve(other)
    np.testing.assert_allclose(two.c, one.c[rows], atol=1e-6 * one.sum_normal)
    assert two.phi == pytest.approx(one.phi, rel=1e-9)


def test_both_models_in_one_grasp() -> None:
    soft = two_hands(SOFT_FINGER, load=1.4)
    keep = np.ones(soft.size, dtype=bool)
    keep[soft.first[::2] + 3] = False
    model = [POINT if i % 2 == 0 else SOFT_FINGER for i in range(10)]
    mixed = soft.with_(G=soft.G[:, keep], J=soft.J[keep], model=model)
    middle = checked(mixed)[0].sum_normal
    least = checked(soft)[0].sum_normal
    most = checked(two_hands(POINT, load=1.4))[0].sum_normal
    assert least * (1.0 - 2.0 * GAP) <= middle <= most * (1.0 + 2.0 * GAP)


def test_the_barrier_costs_what_it_must() -> None:
    """Φ's optimum presses more than the exact one, the less the smaller the weights are."""
    problem = two_hands(load=1.4)
    best = checked(problem)[1]
    over = [
        solve(problem.with_(w_bF=w, w_bT=0.1 * w)).sum_normal / best - 1.0
        for w in (1e-2, 1e-3, 1e-4)
    ]
    assert over[0] > over[1] > over[2] > 0.0
    assert over[2] < 0.2 * over[0]  # of order √w


def _grasp(points: Any, normals: Any, model: str = POINT, **changes: Any) -> GraspForceProblem:
    """Contacts without joints."""
    n, none = len(points), np.zeros(0)
    frames = np.array([contact_frame(np.asarray(z, dtype=float)) for z in normals])
    g: Array = grasp_matrix(np.asarray(points, dtype=float), frames, model)
    values: dict[str, Any] = {
        "G": g, "J": np.zeros((g.shape[1], 0)), "tau_e": none, "tau_min": none, "tau_max": none,
        "mu": np.full(n, 0.6), "mu_t": np.full(n, 0.01), "model": model,
        "h_e": [0.0, 0.0, 4.0, 0.0, 0.0, 0.0],
    }  # fmt: skip
    return GraspForceProblem(**{**values, **changes})


@pytest.mark.parametrize("method", ["newton", "exact"])
def test_two_points_cannot_stop_a_spin(method: str) -> None:
    pinch = _grasp([[0.03, 0.0, 0.0], [-0.03, 0.0, 0.0]], [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    assert np.linalg.matrix_rank(pinch.G) == 5
    assert solve(pinch, method).status is ForceStatus.RANK_DEFICIENT


@pytest.mark.parametrize("method", ["newton", "exact"])
def test_one_contact_holds_nothing(method: str) -> None:
    for model in (POINT, SOFT_FINGER):
        one = _grasp([[0.03, 0.0, 0.0]], [[-1.0, 0.0, 0.0]], model)
        assert solve(one, method).status is ForceStatus.RANK_DEFICIENT


def test_two_soft_fingers_hold() -> None:
    pinch = _grasp(
        [[0.03, 0.0, 0.0], [-0.03, 0.0, 0.0]], [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], SOFT_FINGER
    )
    found, _ = checked(pinch)
    # each carries half by friction
    assert found.sum_normal == pytest.approx(2.0 * 2.0 / 0.6, rel=GAP)


@pytest.mark.parametrize("method", ["newton", "exact"])
def test_a_table_carries_but_does_not_pull(method: str) -> None:
    """Three contacts from below close no grasp: they answer a weight, and nothing else."""
    points = [[0.05, 0.0, 0.0], [-0.03, 0.04, 0.0], [-0.03, -0.04, 0.0]]
    table = _grasp(points, [[0.0, 0.0, 1.0]] * 3)
    carried = solve(table, method)
    assert carried.status.usable
    assert carried.sum_normal == pytest.approx(4.0, rel=1e-9)
    for pull in ([0.0, 0.0, -4.0, 0.0, 0.0, 0.0], [4.0, 0.0, 4.0, 0.0, 0.0, 0.0]):
        found = solve(table.with_(h_e=np.array(pull)), method, load_factor=True)
        assert found.status is ForceStatus.INFEASIBLE_FRICTION
        assert found.load_factor == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("method", ["newton", "exact"])
def test_nothing_to_carry(method: str) -> None:
    """A grasp that closes may hold still without a wrench; the least sum is then zero."""
    still = _grasp(*cylinder_points(), h_e=np.zeros(6))
    found = solve(still, method, load_factor=True)
    assert found.status.usable and found.load_factor == np.inf
    assert found.min_cone_margin > 0.0
    assert found.balance <= 1e-9


def test_extreme_friction_gives_a_verdict() -> None:
    """No number fails: each has a status, and forces that are said to be usable are."""
    for mu in (1e-6, 1e-4, 1e-2, 1e2, 1e4, 1e6):
        for model in (POINT, SOFT_FINGER):
            problem = two_hands(model, mu=np.full(10, mu))
            inside = oracles.margin(problem).value
            for method in ("newton", "exact"):
                found = solve(problem, method)
                assert np.isfinite(found.c).all()
                if found.status.usable:
                    assert found.min_cone_margin >= 0.0 and found.min_torque_margin >= 0.0
                    assert found.balance <= 1e-9
                if abs(inside) > 1e-4 and 1e-2 <= mu <= 1e2:
                    assert found.status.usable == (inside > 0.0)


@pytest.mark.parametrize("model", [POINT, SOFT_FINGER])
def test_the_judge_by_update_and_anew(model: str) -> None:
    """Clarabel's update interface, which is timed, gives what a new instance gives."""
    steps = list(pouring(model, load=1.4, dt=0.02))[::20]
    kept = oracles.ConeProgram(steps[0])
    pyramids = oracles.Pyramids(steps[0])
    for step in steps:
        for warm in (kept, pyramids):
            warm.update(step.G, step.J, step.tau_e, step.h_e)
        best = oracles.exact(step).value
        assert kept.solve().value == pytest.approx(best, rel=1e-8)
        inside = pyramids.solve()
        anew = oracles.Pyramids(step).solve()
        assert inside.value == pytest.approx(anew.value, rel=1e-5)
        assert best < inside.value < 1.2 * best
