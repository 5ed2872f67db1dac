"""The chapter's flows: feasible, downhill, balanced, and ending at the optimum."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise

import numpy as np
import pytest

from wbc.forces import POINT, SOFT_FINGER, ForceStatus, GraspForceProblem
from wbc.forces.cost import (
    balance_error,
    cone_margins,
    constraint_matrix,
    cost,
    linear_constraints,
    torque_margins,
    weights,
)
from wbc.forces.flow_kernels import assemble, dikin_norm, downhill, fixed, projector, tick
from wbc.forces.flows import flow18, flow19, flow20, track

from . import reference
from .problems import grasp_matrix, pouring, random_grasp, two_hands

FLOWS: list[Callable[..., object]] = [flow18, flow19, flow20]


def started(problem: GraspForceProblem) -> np.ndarray:
    start = reference.feasible_start(problem)
    assert start is not None
    return start


@pytest.mark.parametrize("model", [POINT, SOFT_FINGER])
@pytest.mark.parametrize("flow", FLOWS)
def test_ends_at_the_optimum(flow: Callable, model: str) -> None:
    problem = two_hands(model, load=1.4)
    start = started(problem)
    best = cost(problem, reference.optimum(problem, start))
    found = flow(problem, start, tolerance=1e-12, most=30000)
    assert found.status is ForceStatus.SOLVED
    assert -1e-9 <= found.phi / best - 1.0 < 2e-6
    # and with the tolerance of every day
    assert flow(problem, start).phi / best - 1.0 < 3e-3


@pytest.mark.parametrize("flow", FLOWS)
@pytest.mark.parametrize("seed", range(6))
def test_every_step_is_inside_and_downhill(flow: Callable, seed: int) -> None:
    problem = random_grasp(np.random.default_rng(seed))
    c = reference.feasible_start(problem)
    if c is None:
        pytest.skip("not feasible")
    last = cost(problem, c)
    for _ in range(40):
        found = flow(problem, c, most=1, tolerance=0.0)
        assert found.phi <= last
        assert found.min_cone_margin > 0.0 and found.min_torque_margin > 0.0
        assert found.balance < 1e-9
        c, last = found.c, found.phi


@pytest.mark.parametrize("flow", FLOWS)
def test_balance_is_kept_over_many_steps(flow: Callable) -> None:
    problem = two_hands(load=1.4)
    found = flow(problem, started(problem), tolerance=0.0, most=5000)
    assert found.balance < 1e-11


@pytest.mark.parametrize("flow", FLOWS)
def test_at_the_optimum_it_stays_in_balance(flow: Callable) -> None:
    """There the projected gradient is rounding, of which a part is out of the null space."""
    for problem in pouring(load=1.0, dt=0.25):
        found = flow(problem, reference.optimum(problem), tolerance=0.0, most=50)
        assert found.balance < 1e-11


@pytest.mark.parametrize("flow", FLOWS)
def test_symmetric_problem_symmetric_solution(flow: Callable) -> None:
    # three fingers around a ring that only hangs: each carries a third
    angle = 2.0 * np.pi * np.arange(3) / 3.0
    points = 0.04 * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    frames = []
    for p in points:
        z = -p / np.linalg.norm(p)
        x = np.array([0.0, 0.0, 1.0])
        frames.append(np.column_stack([x, np.cross(z, x), z]))
    problem = GraspForceProblem(
        G=grasp_matrix(points, np.array(frames), POINT), J=np.kron(np.eye(3), 0.05 * np.eye(3)),
        tau_e=np.zeros(9), tau_min=np.full(9, -0.5), tau_max=np.full(9, 0.5), mu=np.full(3, 0.7),
        h_e=np.array([0.0, 0.0, 6.0, 0.0, 0.0, 0.0]),
    )  # fmt: skip
    lopsided = started(problem)
    found = flow(problem, lopsided, tolerance=1e-13, most=20000)
    each = found.c.reshape(3, 3)
    np.testing.assert_allclose(each, each[[1, 2, 0]], atol=2e-5)
    np.testing.assert_allclose(each[:, 0], 2.0, atol=1e-9)


@pytest.mark.parametrize("model", [POINT, SOFT_FINGER])
def test_xi_is_the_gradient_in_matrices(model: str) -> None:
    """(17): P⁻¹ W_b P⁻¹ − W_p, and tr(X Y) = ξ(X) · ξ(Y)."""
    problem = two_hands(model, load=1.4)
    c = started(problem)
    fix = fixed(problem)
    rows = assemble(fix, tick(problem))
    u = c / problem.scale
    slack = rows.b @ u + rows.free
    xi = np.empty(len(u) + len(slack))
    downhill(fix, fix.barrier, u, slack, xi)
    p = constraint_matrix(problem, c)
    w_p, w_b = weights(problem)
    inverse = np.linalg.inv(p)
    flat = inverse @ np.diag(w_b) @ inverse - np.diag(w_p)
    turn = 1e-3 * np.random.default_rng(0).standard_normal(len(u))
    change = constraint_matrix(problem, c + problem.scale * turn) - p
    along = np.concatenate([np.sqrt(2.0) * turn, rows.b @ turn])
    np.testing.assert_allclose(np.trace(flat @ change).real, xi @ along, rtol=1e-9)
    gradient = reference.derivatives(problem, c)[0] * problem.scale
    np.testing.assert_allclose(xi @ along, -gradient @ turn, rtol=1e-9)
    # the norm of (19) is that of the matrices, too
    norm = np.trace(inverse @ change @ inverse @ change).real
    np.testing.assert_allclose(dikin_norm(fix, u, slack, turn, rows.b @ turn), norm, rtol=1e-9)


def test_projectors() -> None:
    """Q (17) is the projector onto the null space of A (12)-(14), and (20) its decomposition."""
    problem = two_hands(load=1.4)
    rows = assemble(fixed(problem), tick(problem))
    q18, q20 = (projector(k, False, rows.g, rows.b) for k in (18, 20))
    for q in (q18, q20):
        assert abs(rows.g @ q).max() < 1e-12
    a, _ = linear_constraints(problem)
    wide = np.concatenate([problem.scale / np.sqrt(2.0), np.ones(a.shape[1] - problem.size)])
    null = np.eye(a.shape[1]) - np.linalg.pinv(a * wide) @ (a * wide)
    lower = len(problem.limited)
    # the chapter writes τ_B,L = τ − τ_L and τ_B,H = τ_H − τ, as the bounds of these rows
    assert rows.b.shape[0] == 2 * lower
    np.testing.assert_allclose(q18, null[: problem.size] / np.sqrt(2.0), atol=1e-10)


def test_printed_dikin_climbs() -> None:
    """(19) as printed: Φ rises along it, so that no step can be taken."""
    problem = two_hands(load=1.4)
    start = started(problem)
    found = flow19(problem, start, printed=True)
    assert found.status is ForceStatus.NOT_BALANCED and found.iterations == 0
    np.testing.assert_allclose(found.c, start, atol=1e-13)
    step = flow19(problem, start, most=1).c - start
    assert cost(problem, start - 1e-6 * step) > cost(problem, start)


def in_millimetres(problem: GraspForceProblem) -> GraspForceProblem:
    """The same problem with moments in [N mm]; w_bT (τ_max − τ_min)/τ has no unit of length."""
    rows = np.repeat([1.0, 1000.0], 3)
    return problem.with_(
        G=rows[:, None] * problem.G, h_e=rows * problem.h_e, J=1000.0 * problem.J,
        tau_e=1000.0 * problem.tau_e, tau_min=1000.0 * problem.tau_min,
        tau_max=1000.0 * problem.tau_max,
    )  # fmt: skip


def test_printed_decomposition_stops_elsewhere() -> None:
    """(20) as printed: Q̄ is not symmetric; how far from the optimum it ends depends on units."""
    problem = in_millimetres(two_hands(load=1.4))
    start = started(problem)
    best = cost(problem, reference.optimum(problem, start))
    printed = flow20(problem, start, printed=True, tolerance=0.0, most=20000)
    mended = flow20(problem, start, tolerance=1e-12, most=200000)
    assert printed.phi / best - 1.0 > 0.05
    assert mended.phi / best - 1.0 < 0.01


@pytest.mark.parametrize("method", ["flow18", "flow19", "flow20"])
@pytest.mark.parametrize("model", [POINT, SOFT_FINGER])
def test_tracks_the_pouring(method: str, model: str) -> None:
    ticks = list(pouring(model, load=1.4))[300:340]
    c = reference.optimum(ticks[0])
    for before, now in pairwise(ticks):
        found = track(before, c, now, method)
        assert found.status is ForceStatus.SOLVED and found.balance < 1e-9
        assert found.min_cone_margin > 0.0 and found.min_torque_margin > 0.0
        c = found.c
    assert found.phi / cost(now, reference.optimum(now)) - 1.0 < 1e-3


def test_start_out_of_balance_is_brought_there() -> None:
    """A start for other forces; (21) leads to those asked for."""
    problem = two_hands(load=1.0)
    other = reference.optimum(problem.with_(h_e=0.7 * problem.h_e))
    assert balance_error(problem, other) > 1e-3
    found = flow18(problem, other)
    assert found.status is ForceStatus.SOLVED and found.balance < 1e-9


@pytest.mark.parametrize("flow", [*FLOWS, partial(flow20, printed=True)])
def test_statuses(flow: Callable) -> None:
    problem = two_hands(load=1.0)
    start = started(problem)
    assert flow(problem, start, most=2, tolerance=0.0).status is ForceStatus.NOT_BALANCED
    for bad in (-start, 0.0 * start, np.full(problem.size, np.nan), 100.0 * start):
        assert flow(problem, bad).status is ForceStatus.STALE_START
    # more than the joints can hold: the way there ends
    heavy = problem.with_(h_e=100.0 * problem.h_e)
    found = flow(heavy, start, most=200)
    assert found.status is ForceStatus.NOT_BALANCED and found.balance > 1e-3


def test_two_point_contacts_have_no_rank() -> None:
    problem = two_hands()
    some = np.concatenate([np.arange(3), np.arange(15, 18)])
    two = GraspForceProblem(
        G=problem.G[:, some], J=problem.J[some], tau_e=problem.tau_e, tau_min=problem.tau_min,
        tau_max=problem.tau_max, mu=np.full(2, 0.6), h_e=np.zeros(6),
    )  # fmt: skip
    start = np.array([0.0, 0.0, 0.1] * 2)
    assert cone_margins(two, start).min() > 0.0 and torque_margins(two, start).min() > 0.0
    assert flow18(two, start).status is ForceStatus.RANK_DEFICIENT


def test_no_limits_at_all() -> None:
    problem = two_hands(load=1.0)
    free = problem.with_(
        tau_min=np.full(problem.joints, -np.inf), tau_max=np.full(problem.joints, np.inf)
    )
    best = cost(free, reference.optimum(free))
    for flow in (flow18, flow19, flow20):
        found = flow(free, started(problem), tolerance=1e-9, most=20000)
        assert found.phi / best - 1.0 < 1e-4
