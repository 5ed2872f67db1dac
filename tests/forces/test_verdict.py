"""Feasible or not, why not, and how far from it: against Clarabel, on problems at random.

The margin of a problem (`oracles.margin`) says how clear its case is; where it is below 1e-4 the
verdict is open.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest

from wbc.forces import POINT, SOFT_FINGER, ForceStatus, GraspForceProblem, solve

from . import oracles
from .problems import random_grasp, two_hands

CLEAR = 1e-4
_BLOCK = 50


def problem_of(number: int) -> GraspForceProblem:
    """One of any number of problems: half of them at random, half near their largest load."""
    rng = np.random.default_rng([4, number])
    if rng.random() < 0.6:
        problem = random_grasp(rng)
    else:
        problem = two_hands(
            str(rng.choice([POINT, SOFT_FINGER])), load=10.0 ** rng.uniform(-1.0, 1.2),
            seed=number, arms=int(rng.choice([0, 0, 3, 7])),
        )  # fmt: skip
    most = oracles.load_factor(problem).value
    if rng.random() < 0.5 and 1e-3 < most < np.inf:
        to = most * (1.0 + rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-3.0, -0.5))
        problem = problem.with_(h_e=to * problem.h_e)
    return problem


def verdicts(problem: GraspForceProblem) -> set[ForceStatus]:
    """What may be said of a problem; empty where its margin is too small to tell."""
    inside, by_friction = (oracles.margin(problem, limits=b).value for b in (True, False))
    if inside > CLEAR:
        return {ForceStatus.SOLVED, ForceStatus.LOW_MARGIN}
    if inside > -CLEAR:
        return set()
    torque = {ForceStatus.INFEASIBLE_TORQUE_LIMITS} if by_friction > -CLEAR else set()
    friction = {ForceStatus.INFEASIBLE_FRICTION} if by_friction < CLEAR else set()
    return torque | friction


def judge(problem: GraspForceProblem) -> str:
    """What is wrong with our answer; empty if nothing is."""
    found = solve(problem, load_factor=True)
    faults = []
    wanted = verdicts(problem)
    if wanted and found.status not in wanted:
        faults.append(f"{found.status.value}, not {' or '.join(s.value for s in wanted)}")
    if found.status.usable and not (
        found.min_cone_margin > 0.0 and found.min_torque_margin > 0.0 and found.balance <= 1e-9
    ):
        faults.append(
            f"margins {found.min_cone_margin:g} N, {found.min_torque_margin:g} Nm, "
            f"balance {found.balance:g}"
        )
    most = oracles.load_factor(problem)
    if not np.isclose(found.load_factor, most.value, rtol=1e-5, atol=1e-5):
        faults.append(f"load factor {found.load_factor:.8g}, not {most.value:.8g} ({most.status})")
    return "; ".join(faults)


@pytest.mark.parametrize(
    "block",
    [pytest.param(k, marks=[] if k < 3 else pytest.mark.slow) for k in range(1000 // _BLOCK)],
)
def test_verdicts(block: int) -> None:
    faults = {}
    for number in range(_BLOCK * block, _BLOCK * (block + 1)):
        fault = judge(problem_of(number))
        if fault:
            faults[number] = fault
    assert not faults, f"problem_of({{number}}): {faults}"


def test_the_problems_are_a_mix() -> None:
    said = [verdicts(problem_of(number)) for number in range(3 * _BLOCK)]
    for status in (
        ForceStatus.SOLVED, ForceStatus.INFEASIBLE_TORQUE_LIMITS, ForceStatus.INFEASIBLE_FRICTION
    ):  # fmt: skip
        assert sum(status in wanted for wanted in said) > 10
    assert sum(not wanted for wanted in said) < 10


@pytest.mark.parametrize("model", [POINT, SOFT_FINGER])
def test_on_both_sides_of_the_largest_load(model: str) -> None:
    problem = two_hands(model)
    most = solve(problem, load_factor=True).load_factor
    assert most == pytest.approx(oracles.load_factor(problem).value, rel=1e-5)
    below = solve(problem.with_(h_e=(1.0 - 1e-3) * most * problem.h_e), load_factor=True)
    above = solve(problem.with_(h_e=(1.0 + 1e-3) * most * problem.h_e), load_factor=True)
    assert below.status.usable and below.load_factor == pytest.approx(1.0 / (1.0 - 1e-3), rel=1e-5)
    assert above.status is ForceStatus.INFEASIBLE_TORQUE_LIMITS
    assert above.load_factor == pytest.approx(1.0 / (1.0 + 1e-3), rel=1e-5)


def test_without_limits_the_load_has_none() -> None:
    problem = two_hands()
    free = np.full(problem.joints, np.inf)
    found = solve(problem.with_(tau_min=-free, tau_max=free), load_factor=True)
    assert found.status.usable and found.load_factor == np.inf
    assert found.min_torque_margin == np.inf


def test_joints_too_weak_for_their_own_weight() -> None:
    problem = two_hands()
    tau_e = np.array(problem.tau_e)
    tau_e[4] = 40.0 * problem.tau_max[4]
    heavy = problem.with_(tau_e=tau_e)
    assert solve(heavy).status is ForceStatus.INFEASIBLE_TORQUE_LIMITS
    assert verdicts(heavy) == {ForceStatus.INFEASIBLE_TORQUE_LIMITS}


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e3, 1e6])
@pytest.mark.parametrize("number", range(12))
def test_scale_of_forces(number: int, scale: float) -> None:
    problem = problem_of(number)
    found = solve(problem, load_factor=True)
    w_bf, w_bt = problem.w_bF * scale**2, problem.w_bT * scale  # Φ is then `scale` as large
    other = solve(in_forces(problem, scale).with_(w_bF=w_bf, w_bT=w_bt), load_factor=True)
    assert other.status is found.status
    assert other.load_factor == pytest.approx(found.load_factor, rel=1e-5, abs=1e-5)
    if found.status.usable:
        assert other.phi == pytest.approx(scale * found.phi, rel=1e-6)


@pytest.mark.parametrize("method", ["newton", "exact"])
@pytest.mark.parametrize("number", range(12))
def test_forces_against_fixed_weights(number: int, method: Literal["newton", "exact"]) -> None:
    """Barriers far too weak or strong for the forces change what is optimal, and no verdict."""
    problem = problem_of(number)
    if abs(oracles.margin(problem).value) < 10.0 * CLEAR:
        return
    for scale in (1e-6, 1e-3, 1e3) if method == "newton" else (1e-6, 1e-3, 1e3, 1e6):
        other = solve(in_forces(problem, scale), method)
        assert other.status.usable == solve(problem, method).status.usable


@pytest.mark.parametrize("number", range(12))
def test_units_of_length(number: int) -> None:
    problem = problem_of(number)
    found, other = (
        solve(p, load_factor=True) for p in (problem, in_lengths(problem, 1e3))
    )  # fmt: skip
    assert other.status is found.status
    assert other.load_factor == pytest.approx(found.load_factor, rel=1e-5, abs=1e-5)


def in_forces(problem: GraspForceProblem, k: float) -> GraspForceProblem:
    """The same with all forces, moments and torques k times as large; the weights stay."""
    names = ("tau_e", "tau_min", "tau_max", "h_e")
    return problem.with_(**{name: k * getattr(problem, name) for name in names})


def in_lengths(problem: GraspForceProblem, k: float) -> GraspForceProblem:
    """The same in another unit of length, k of which make a metre; Φ keeps its value."""
    rows = np.repeat([1.0, k], 3)
    moment = np.ones(problem.size)
    moment[problem.first[problem.dims == 4] + 3] = k  # c_t is a moment
    assert problem.mu_t is not None
    return problem.with_(
        G=rows[:, None] * problem.G / moment, h_e=rows * problem.h_e,
        J=k * problem.J / moment[:, None], mu_t=k * problem.mu_t, w_bT=problem.w_bT,
        **{name: k * getattr(problem, name) for name in ("tau_e", "tau_min", "tau_max")},
    )  # fmt: skip
