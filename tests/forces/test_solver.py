"""The structured solver by its laws: optimality, balance, limits, invariance, and verdicts."""

from __future__ import annotations

import numpy as np
import pytest

from wbc.arrays import Array
from wbc.forces import (
    POINT,
    SOFT_FINGER,
    ForceSolver,
    ForceStatus,
    GraspForceProblem,
    HandJacobian,
    solve,
)
from wbc.forces.blocks import find_blocks, pattern
from wbc.forces.cost import balance_error, cone_margins, cost, torque_margins, torques

from .problems import grasp_matrix, many_contacts, mixed, pouring, random_grasp, two_hands
from .reference import balanced, derivatives

MODELS = (POINT, SOFT_FINGER)


def data(problem: GraspForceProblem) -> tuple[Array, Array, Array, Array]:
    return problem.G, problem.J, problem.tau_e, problem.h_e


def excess(problem: GraspForceProblem, c: Array) -> float:
    """How far Φ is above its optimum, relative, to second order: half Newton's decrement."""
    gradient, hessian = derivatives(problem, c)
    _, null = balanced(problem)
    g = null.T @ gradient
    return float(0.5 * g @ np.linalg.solve(null.T @ hessian @ null, g)) / cost(problem, c)


PROBLEMS = {
    **{f"two hands, {m}": (lambda m=m: two_hands(m)) for m in MODELS},
    **{f"heavy, {m}": (lambda m=m: two_hands(m, load=3.5)) for m in MODELS},
    **{f"arms, {m}": (lambda m=m: two_hands(m, arms=7)) for m in MODELS},
    "mixed": mixed,
    "no limits": lambda: two_hands(tau_min=np.full(30, -np.inf), tau_max=np.full(30, np.inf)),
    "no wrench": lambda: two_hands(h_e=np.zeros(6)),
    "no joints": lambda: two_hands(
        J=np.zeros((30, 0)), tau_e=np.zeros(0), tau_min=np.zeros(0), tau_max=np.zeros(0)
    ),
    "forty contacts": lambda: many_contacts(40, SOFT_FINGER),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_answer_is_the_optimum_and_keeps_every_limit(name: str) -> None:
    problem = PROBLEMS[name]()
    step = ForceSolver(problem, margin=0.0).solve(*data(problem))
    assert step.status is ForceStatus.SOLVED
    assert excess(problem, step.c) < 2e-7
    assert balance_error(problem, step.c) < 1e-11
    assert cone_margins(problem, step.c).min() > 0.0
    assert torque_margins(problem, step.c).min(initial=np.inf) > 0.0


@pytest.mark.parametrize("name", PROBLEMS)
def test_what_is_reported_is_what_the_forces_give(name: str) -> None:
    problem = PROBLEMS[name]()
    solver = ForceSolver(problem)
    for step in (solver.solve(*data(problem)), solver.exact(*data(problem))):
        c = step.c
        assert step.tau == pytest.approx(torques(problem, c), abs=1e-12)
        assert step.cone_margin == pytest.approx(cone_margins(problem, c), abs=1e-12)
        assert step.torque_margin == pytest.approx(torque_margins(problem, c), abs=1e-12)
        if step.cone_margin.min() > 1e-6:  # else rounding is all there is
            assert step.phi == pytest.approx(cost(problem, c), rel=1e-9)
        assert step.sum_normal == pytest.approx(c[problem.normal].sum(), rel=1e-12)


@pytest.mark.parametrize("name", PROBLEMS)
def test_warm_and_cold_agree_and_warm_is_one_step(name: str) -> None:
    problem = PROBLEMS[name]()
    solver = ForceSolver(problem)
    cold = solver.solve(*data(problem))
    warm = solver.solve(*data(problem), cold.c)
    assert warm.iterations <= 2
    assert warm.phi == pytest.approx(cold.phi, rel=2e-6)


@pytest.mark.parametrize("name", ["mixed", "arms, soft_finger"])
def test_the_order_of_contacts_and_joints_does_not_matter(name: str) -> None:
    problem = PROBLEMS[name]()
    rng = np.random.default_rng(0)
    contacts, joints = rng.permutation(problem.contacts), rng.permutation(problem.joints)
    rows = np.concatenate([problem.first[i] + np.arange(problem.dims[i]) for i in contacts])
    assert problem.mu_t is not None
    other = problem.with_(
        G=problem.G[:, rows], J=problem.J[np.ix_(rows, joints)], tau_e=problem.tau_e[joints],
        tau_min=problem.tau_min[joints], tau_max=problem.tau_max[joints], mu=problem.mu[contacts],
        mu_t=problem.mu_t[contacts], model=[problem.model[i] for i in contacts],
    )  # fmt: skip
    for method in ("newton", "exact"):
        a, b = solve(problem, method), solve(other, method)
        assert b.c == pytest.approx(a.c[rows], rel=1e-4, abs=1e-5)
        assert b.tau == pytest.approx(a.tau[joints], rel=1e-4, abs=1e-6)
        assert b.sum_normal == pytest.approx(a.sum_normal, rel=1e-6)


def test_another_frame_gives_the_same_forces() -> None:
    problem = two_hands(SOFT_FINGER)
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    both = np.kron(np.eye(2), turn)
    other = problem.with_(G=both @ problem.G, h_e=both @ problem.h_e)
    assert solve(other).c == pytest.approx(solve(problem).c, abs=1e-5)


@pytest.mark.parametrize("size", [1e-4, 1e-2, 1e2, 1e4])
def test_forces_scale_with_the_problem(size: float) -> None:
    problem = two_hands(load=2.0)
    larger = problem.with_(
        h_e=size * problem.h_e, tau_e=size * problem.tau_e, tau_min=size * problem.tau_min,
        tau_max=size * problem.tau_max, w_bF=size**2 * problem.w_bF, w_bT=size * problem.w_bT,
    )  # fmt: skip
    small, large = solve(problem, load_factor=True), solve(larger, load_factor=True)
    assert large.status is small.status
    assert large.c / size == pytest.approx(small.c, abs=1e-5)
    assert large.load_factor == pytest.approx(small.load_factor, rel=1e-5)
    assert solve(larger, "exact").sum_normal / size == pytest.approx(
        solve(problem, "exact").sum_normal, rel=2e-6
    )


def test_a_symmetric_grasp_has_symmetric_forces() -> None:
    points = 0.04 * np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    frames = []
    for p in points:
        z = -p / np.linalg.norm(p)
        frames.append(np.column_stack([np.cross([0, 0, 1.0], z), [0, 0, 1.0], z]))
    problem = GraspForceProblem(
        G=grasp_matrix(points, np.array(frames), POINT), J=np.zeros((12, 0)), tau_e=[],
        tau_min=[], tau_max=[], mu=np.full(4, 0.5), h_e=[0, 0, 4.0, 0, 0, 0],
    )  # fmt: skip
    c = solve(problem).c.reshape(4, 3)
    assert c[:, 2] == pytest.approx(np.full(4, c[0, 2]), rel=1e-9)
    assert c[:, 1] == pytest.approx(np.ones(4), rel=1e-9)  # a quarter of the weight each
    exact = solve(problem, "exact")
    assert exact.sum_normal == pytest.approx(8.0, rel=2e-6)  # weight / μ


def test_shared_joints_are_the_same_as_a_dense_method() -> None:
    """All joints in one block give the same answer as an arm across ten blocks."""
    problem = two_hands(arms=7)
    split = ForceSolver(problem)
    assert split.blocks.shared == 14
    dense = ForceSolver(problem.with_(J=problem.J + 1e-300), moves=np.ones((44, 10), dtype=bool))
    assert dense.blocks.shared == 44
    a = split.solve(*data(problem))
    b = dense.solve(*data(problem))
    assert b.c == pytest.approx(a.c, abs=1e-6)


def test_contacts_of_one_finger_share_a_block() -> None:
    problem = mixed()
    blocks = find_blocks(problem)
    sizes = np.diff(blocks.contact[blocks.block])
    assert sorted(sizes.tolist()) == [3, 3, 3, 4, 4, 4, 4, 4, 7]
    assert blocks.shared == 5  # the arms' joints but the unlimited one


def test_a_joint_that_was_singular_at_first_is_noticed() -> None:
    problem = two_hands()
    jacobian = np.array(problem.J)
    jacobian[:3, 0] = 0.0  # moves nothing in this posture
    solver = ForceSolver(problem.with_(J=jacobian))
    step = solver.solve(*data(problem))
    assert step.c == pytest.approx(solve(problem).c, abs=1e-6)
    jacobian[3:6, 0] = 0.01  # and even another finger
    other = problem.with_(J=jacobian)
    assert solver.solve(*data(other)).c == pytest.approx(solve(other).c, abs=1e-6)


@pytest.mark.parametrize("arms", [0, 3])
def test_the_jacobian_in_blocks(arms: int) -> None:
    problem = two_hands(SOFT_FINGER, arms=arms)
    solver = ForceSolver(problem)
    own, shared = pattern(problem, solver.blocks)
    flat = problem.J.ravel()
    step = solver.solve(
        problem.G, HandJacobian(flat[own], flat[shared]), problem.tau_e, problem.h_e
    )
    dense = solver.solve(*data(problem))
    assert np.array_equal(step.c, dense.c)
    assert step.tau == pytest.approx(dense.tau, abs=1e-12)


def test_the_tick_of_the_pouring_case() -> None:
    """A step or so per tick, balanced, every limit kept, without a new start."""
    used, c, solver = [], None, None
    for problem in pouring(load=1.4, dt=0.01):
        solver = solver or ForceSolver(problem, margin=0.0)
        step = solver.solve(*data(problem), c)
        assert step.status is ForceStatus.SOLVED
        assert step.balance < 1e-10
        assert step.cone_margin.min() > 0.0 and step.torque_margin.min() > 0.0
        assert step.phi <= solve(problem).phi * (1.0 + 2e-6)
        used.append(step.iterations)
        c = step.c
    assert np.mean(used[1:]) < 2.5  # 10 ms a tick


@pytest.mark.parametrize("jump", [0.5, 2.0, 8.0])
def test_a_jump_of_the_wrench_is_survived(jump: float) -> None:
    problem = two_hands(load=1.0)
    solver = ForceSolver(problem, margin=0.0)
    before = solver.solve(*data(problem)).c
    rng = np.random.default_rng(0)
    for _ in range(20):
        push = rng.standard_normal(3)
        wrench = problem.h_e + np.concatenate([jump * push / np.linalg.norm(push), np.zeros(3)])
        moved = problem.with_(h_e=wrench)
        step = solver.solve(*data(moved), before)
        cold = solve(moved)
        assert step.status.usable == cold.status.usable
        if cold.status.usable:
            assert step.phi == pytest.approx(cold.phi, rel=2e-6)


def test_verdicts_name_the_reason() -> None:
    def status(problem: GraspForceProblem) -> ForceStatus:
        return solve(problem).status

    good = two_hands()
    assert status(good) is ForceStatus.SOLVED
    assert status(good.with_(h_e=20.0 * good.h_e)) is ForceStatus.INFEASIBLE_TORQUE_LIMITS
    # three contacts on one side cannot pull
    one_side = [6, 7, 8, 9, 10, 11, 3, 4, 5]
    pulled = GraspForceProblem(
        G=good.G[:, one_side], J=good.J[one_side][:, :9], tau_e=np.zeros(9),
        tau_min=np.full(9, -1.0), tau_max=np.full(9, 1.0), mu=np.full(3, 0.6), h_e=good.h_e,
    )  # fmt: skip
    assert status(pulled) is ForceStatus.INFEASIBLE_FRICTION
    two = GraspForceProblem(
        G=good.G[:, :6], J=good.J[:6, :6], tau_e=np.zeros(6), tau_min=np.full(6, -1.0),
        tau_max=np.full(6, 1.0), mu=np.full(2, 0.6), h_e=np.zeros(6),
    )  # fmt: skip
    assert status(two) is ForceStatus.RANK_DEFICIENT
    assert solve(two, "exact").status is ForceStatus.RANK_DEFICIENT
    tight = good.with_(h_e=0.999 * solve(good, load_factor=True).load_factor * good.h_e)
    assert status(tight) is ForceStatus.LOW_MARGIN
    assert solve(tight, "exact").status is ForceStatus.SOLVED


@pytest.mark.parametrize("which", ["G", "J", "tau_e", "h_e", "start"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_none_are_a_status(which: str, value: float) -> None:
    problem = two_hands(arms=2)
    solver = ForceSolver(problem)
    before = solver.solve(*data(problem)).c
    kept = before.copy()
    given = {"G": problem.G, "J": problem.J, "tau_e": problem.tau_e, "h_e": problem.h_e}
    given["start"] = before
    broken = given[which].copy()
    broken[..., -1] = value
    step = solver.solve(**{**given, which: broken})
    if which == "start":  # begins anew
        assert step.status is ForceStatus.SOLVED
    else:
        assert step.status is ForceStatus.INVALID_INPUT
        assert np.isfinite(step.c).all()
    assert np.array_equal(before, kept)
    assert solver.solve(*data(problem), before).status is ForceStatus.SOLVED


def test_inputs_are_not_written_to() -> None:
    problem = two_hands(load=20.0)  # not feasible: every way through the solver
    copies = [array.copy() for array in data(problem)]
    start = np.tile([0.0, 0.0, 1.0], 10)
    ForceSolver(problem).solve(*copies, start)
    for array, copy in zip((*data(problem), np.tile([0.0, 0.0, 1.0], 10)), (*copies, start),
                           strict=True):  # fmt: skip
        assert np.array_equal(array, copy)


def test_a_start_outside_is_no_harm() -> None:
    problem = two_hands()
    solver = ForceSolver(problem)
    for start in (np.zeros(30), -np.ones(30), np.full(30, 1e6)):
        step = solver.solve(*data(problem), start)
        assert step.status is ForceStatus.SOLVED
        assert step.phi == pytest.approx(solve(problem).phi, rel=1e-6)


def test_the_load_factor() -> None:
    problem = two_hands()
    factor = solve(problem, load_factor=True).load_factor
    assert solve(problem.with_(h_e=0.9999 * factor * problem.h_e)).status.usable
    assert not solve(problem.with_(h_e=1.0001 * factor * problem.h_e)).status.usable
    free = two_hands(tau_min=np.full(30, -np.inf), tau_max=np.full(30, np.inf))
    assert solve(free, load_factor=True).load_factor == np.inf
    assert solve(problem.with_(h_e=np.zeros(6)), load_factor=True).load_factor == np.inf
    assert np.isnan(solve(problem.with_(tau_e=np.ones(30)), load_factor=True).load_factor)


def test_torques_that_only_the_contacts_bring_inside() -> None:
    """τ_e alone breaks a limit, the contact force takes it back: no first point is obvious."""
    problem = two_hands()
    tau = solve(problem).tau
    j = int(np.argmax(np.abs(tau - problem.tau_e)))
    tau_e = np.array(problem.tau_e)
    tau_e[j] = problem.tau_max[j] * 1.02 if tau[j] < problem.tau_e[j] else problem.tau_min[j] * 1.02
    other = problem.with_(tau_e=tau_e)
    assert solve(other).status.usable
    assert solve(other, "exact").status is ForceStatus.SOLVED


def test_random_problems_keep_their_promises() -> None:
    rng = np.random.default_rng(11)
    for _ in range(40):
        problem = random_grasp(rng)
        step = ForceSolver(problem, margin=0.0).solve(*data(problem))
        assert np.isfinite(step.c).all() and np.isfinite(step.tau).all()
        inside = step.cone_margin.min() > 0.0 and step.torque_margin.min() > 0.0
        assert step.status.usable == (inside and step.balance < 1e-9)


@pytest.mark.parametrize("method", ["newton", "exact"])
def test_the_same_problem_gives_the_same_bits(method: str) -> None:
    problem = two_hands(SOFT_FINGER, arms=3)
    assert np.array_equal(solve(problem, method).c, solve(problem, method).c)
