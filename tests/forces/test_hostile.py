"""What nobody should hand in: arrays that do not fit, numbers that are none, limits that pinch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wbc.errors import WbcError
from wbc.forces import (
    SOFT_FINGER,
    ForceSolver,
    ForceStatus,
    GraspForceProblem,
    GraspForceSolution,
    HandJacobian,
    solve,
)
from wbc.forces.blocks import pattern
from wbc.forces.cost import cone_margins

from .problems import random_grasp, two_hands
from .test_solver import data

NAMES = ("G", "J", "tau_e", "h_e")


def writable(problem: GraspForceProblem) -> dict[str, Any]:
    return {name: np.array(a) for name, a in zip(NAMES, data(problem), strict=True)}


@pytest.mark.parametrize("name", NAMES)
def test_an_array_that_does_not_fit_is_refused_before_it_is_read(name: str) -> None:
    problem = two_hands()
    solver = ForceSolver(problem)
    for change in (
        lambda a: a[..., :-1].copy(),
        lambda a: a[None],
        lambda a: a * 1j,
        lambda _: "a",
    ):
        values = writable(problem)
        values[name] = change(values[name])
        for ask in (solver.solve, solver.exact, solver.load_factor):
            with pytest.raises(WbcError, match=name):
                ask(**values)


def test_blocks_that_do_not_fit_are_refused() -> None:
    problem = two_hands(arms=3)
    solver = ForceSolver(problem)
    own, shared = (problem.J.ravel()[k] for k in pattern(problem, solver.blocks))
    for jacobian in (HandJacobian(own[:-1], shared), HandJacobian(own, shared[:-1])):
        with pytest.raises(WbcError, match=r"J\."):
            solver.solve(problem.G, jacobian, problem.tau_e, problem.h_e)


def test_moves_that_do_not_fit_are_refused() -> None:
    with pytest.raises(WbcError, match=r"moves has shape \(10, 30\), expected \(30, 10\)"):
        ForceSolver(two_hands(), moves=np.ones((10, 30), dtype=np.bool_))


def test_moves_that_are_wrong_are_mended() -> None:
    problem = two_hands()
    none = np.zeros((30, 10), dtype=np.bool_)
    step = ForceSolver(problem, moves=none).solve(*data(problem))
    assert step.status.usable
    assert step.c == pytest.approx(solve(problem).c, abs=1e-6)


@pytest.mark.parametrize(
    "of",
    [
        np.asfortranarray, lambda a: np.repeat(a, 2, axis=-1)[..., ::2], lambda a: a.tolist(),
        lambda a: a.astype(">f8"),
    ],
    ids=["by columns", "with gaps", "list", "other bytes"],
)  # fmt: skip
def test_any_layout_gives_the_same(of: Any) -> None:
    problem = two_hands()
    solver = ForceSolver(problem)
    values = {name: of(a) for name, a in writable(problem).items()}
    best = solver.solve(*data(problem)).c
    assert np.array_equal(solver.solve(**values).c, best)
    warm = solver.solve(*data(problem), best)
    assert np.array_equal(solver.solve(**values, start=of(best)).c, warm.c)


def test_single_precision_is_taken() -> None:
    problem = two_hands()
    solver = ForceSolver(problem)
    rough = {name: a.astype(np.float32) for name, a in writable(problem).items()}
    step = solver.solve(**rough, start=solver.solve(*data(problem)).c.astype(np.float32))
    assert step.status is ForceStatus.SOLVED and step.iterations <= 3


def test_a_start_of_other_contacts_is_none() -> None:
    problem = two_hands()
    solver = ForceSolver(problem)
    cold = solver.solve(*data(problem))
    for start in (np.ones(29), np.ones(40), np.ones((30, 1)), np.zeros(0)):
        assert np.array_equal(solver.solve(*data(problem), start).c, cold.c)
    for start in (np.zeros(30), np.full(30, np.nan), np.full(30, 1e50), -cold.c):
        assert solver.solve(*data(problem), start).status is ForceStatus.SOLVED


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_number_that_is_none_is_noticed_wherever_it_stands(value: float) -> None:
    """Also beside the blocks, and at joints that have no limits; the solver stays as it was."""
    low, high = np.array(two_hands().tau_min), np.array(two_hands().tau_max)
    low[3], high[3] = -np.inf, np.inf
    problem = two_hands(tau_min=low, tau_max=high)
    solver = ForceSolver(problem)
    for name, place in (
        ("G", (0, 0)), ("J", (0, 0)), ("J", (0, 29)), ("J", (3, 3)), ("tau_e", 0), ("tau_e", 3),
        ("h_e", 5),
    ):  # fmt: skip
        values = writable(problem)
        values[name][place] = value
        assert solver.solve(**values).status is ForceStatus.INVALID_INPUT, (name, place)
        assert np.isnan(solver.load_factor(**values)), (name, place)
    assert solver.blocks.shared == 0
    assert solver.solve(*data(problem)).status is ForceStatus.SOLVED


def test_load_factor_without_a_wrench() -> None:
    problem = two_hands(h_e=np.zeros(6))
    solver = ForceSolver(problem)
    assert solver.load_factor(*data(problem)) == np.inf
    values = writable(problem)
    values["tau_e"][2] = 10.0
    assert np.isnan(solver.load_factor(**values))
    values = writable(problem)
    values["G"][5] = 0.0
    assert np.isnan(solver.load_factor(**values))


@pytest.mark.parametrize("seed", range(12))
def test_no_wrench_exactly(seed: int) -> None:
    """The optimum is 0, on the tip of every cone: what is called solved is inside all the same."""
    problem = random_grasp(np.random.default_rng([5, seed])).with_(h_e=np.zeros(6))
    found = solve(problem, "exact")
    if solve(problem).status is ForceStatus.SOLVED:
        assert found.status is ForceStatus.SOLVED
    if found.status.usable:
        assert cone_margins(problem, found.c).min() > 0.0
        assert found.min_torque_margin > 0.0 and found.balance <= 1e-9
        assert 0.0 <= found.gap <= 1e-5


@pytest.mark.parametrize("seed", range(20))
def test_a_joint_that_may_hardly_move(seed: int) -> None:
    """Feasible by construction: nothing may be said of it but that, or that it was not found."""
    rng = np.random.default_rng([6, seed])
    problem = two_hands(seed=seed)
    c = solve(problem).c
    tau, j = problem.J.T @ c + problem.tau_e, rng.integers(problem.joints)
    low, high = np.array(problem.tau_min), np.array(problem.tau_max)
    room = 10.0 ** rng.uniform(-5.0, -3.0)  # closer, rounding may call it infeasible
    low[j], high[j] = tau[j] - room, tau[j] + room
    for method in ("newton", "exact"):
        found = solve(problem.with_(tau_min=low, tau_max=high), method)
        assert found.status.usable or found.status is ForceStatus.NOT_BALANCED
        if found.status.usable:
            assert found.min_torque_margin > 0.0 and found.min_cone_margin > 0.0
            assert found.balance <= 1e-9


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"mu_t": ["a"] * 10}, "mu_t is not an array of numbers"),
        ({"mu_t": np.ones(10) * 1j}, "mu_t is not an array of numbers"),
        ({"mu_t": [[1.0], [1.0, 2.0]]}, "mu_t is not an array of numbers"),
        ({"mu_t": np.ones(9)}, "mu_t has shape (9,), expected (10,)"),
        ({"w_p": "x"}, "w_p is not a number"),
        ({"w_bF": None}, "w_bF is not a number"),
        ({"w_bT": np.ones(3)}, "w_bT is not a number"),
        ({"w_bT": 10**400}, "w_bT is not a number"),
        ({"model": None}, "model is neither a name nor a list of names"),
        (
            {"tau_min": np.full(30, -1e308), "tau_max": np.full(30, 1e308)},
            "joint 0 has torque limits beyond 1e+100",
        ),
    ],
)  # fmt: skip
def test_more_that_is_refused_in_one_line(changes: dict[str, Any], what: str) -> None:
    with pytest.raises(WbcError) as caught:
        two_hands().with_(**changes)
    assert what in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "changes",
    [
        {"c": np.array("force")}, {"c": np.zeros((2, 15))}, {"c": np.zeros(5)},
        {"cone_margin": np.zeros(0)}, {"tau": np.zeros(4)}, {"iterations": np.array(np.inf)},
        {"iterations": np.zeros(2)}, {"status": np.array(3)}, {"status": np.array("fine")},
        {"gap": np.array("x")},
    ],
)  # fmt: skip
def test_a_solution_that_is_none_is_not_loaded(tmp_path: Path, changes: dict[str, Any]) -> None:
    solve(two_hands()).save(tmp_path / "s.npz")
    with np.load(tmp_path / "s.npz") as file:
        arrays = {**file, **changes}
    np.savez(tmp_path / "bad.npz", **arrays)
    with pytest.raises(WbcError, match=r"bad\.npz") as caught:
        GraspForceSolution.load(tmp_path / "bad.npz")
    assert "\n" not in str(caught.value)


def test_soft_fingers_in_a_solver_for_points_are_refused() -> None:
    soft = two_hands(SOFT_FINGER)
    with pytest.raises(WbcError, match="has shape"):
        ForceSolver(two_hands()).solve(*data(soft))
