"""Problems and solutions as values and as files; the cost as sums and as printed in matrices."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from wbc.cli import main
from wbc.errors import WbcError
from wbc.forces import SOFT_FINGER, ForceStatus, GraspForceProblem, GraspForceSolution, solve
from wbc.forces.cost import cone_margins, torque_margins

from .problems import mixed, two_hands

BAD = {
    "mu": ({"mu": np.full(10, -0.6)}, "mu[0] is -0.6: it must be positive"),
    "mu zero": ({"mu": np.zeros(10)}, "mu[0] is 0: it must be positive"),
    "soft": ({"model": SOFT_FINGER}, "G has shape (6, 30), expected (6, 40)"),
    "G": ({"G": np.zeros((6, 29))}, "G has shape (6, 29), expected (6, 30)"),
    "G flat": ({"G": np.zeros(180)}, "G has shape (180,), expected (6, 30)"),
    "J": ({"J": np.zeros((29, 30))}, "J has shape (29, 30), expected (30, 30)"),
    "h_e": ({"h_e": np.zeros(5)}, "h_e has shape (5,), expected (6,)"),
    "tau_e": ({"tau_e": np.zeros(29)}, "J has shape (30, 30), expected (30, 29)"),
    "NaN": ({"h_e": [0, 0, np.nan, 0, 0, 0]}, "h_e[2] is nan: it must be finite"),
    "NaN in J": ({"J": np.full((30, 30), np.nan)}, "J[0, 0] is nan: it must be finite"),
    "NaN limit": ({"tau_min": np.full(30, np.nan)}, "tau_min[0] is nan: it must be a number"),
    "limits": ({"tau_min": np.full(30, 1.0)}, "tau_min[0] is 1, not below tau_max[0], 0.5"),
    "one limit": ({"tau_min": np.full(30, -np.inf)}, "joint 0 has one infinite torque limit"),
    "weight": ({"w_bF": 0.0}, "w_bF is 0: it must be positive"),
    "model": ({"model": "rubber"}, "model is 'rubber': it is 'point' or 'soft_finger'"),
    "models": ({"model": ["point"] * 9}, "model names 9 contacts, mu has 10"),
    "text": ({"h_e": ["a"] * 6}, "h_e is not an array of numbers"),
    "ragged": ({"G": [[1.0], [1.0, 2.0]]}, "G is not an array of numbers"),
    "complex": ({"h_e": np.ones(6) * 1j}, "h_e is not an array of numbers"),
    "no contacts": ({"mu": []}, "mu is empty"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_be_is_refused_in_one_line(name: str) -> None:
    changes, what = BAD[name]
    with pytest.raises(WbcError) as caught:
        two_hands().with_(**changes)
    assert what in str(caught.value) and "\n" not in str(caught.value)


def test_soft_fingers_need_their_torsional_friction() -> None:
    with pytest.raises(WbcError, match="mu_t is missing"):
        GraspForceProblem(
            G=np.zeros((6, 4)), J=np.zeros((4, 0)), tau_e=[], tau_min=[], tau_max=[], mu=[0.5],
            h_e=np.zeros(6), model=SOFT_FINGER,
        )  # fmt: skip


def test_torsional_friction_is_positive_where_it_is_used() -> None:
    with pytest.raises(WbcError, match=r"mu_t\[0\] is -1: it must be positive"):
        two_hands(SOFT_FINGER, mu_t=-np.ones(10))
    two_hands(mu_t=-np.ones(10))  # of point contacts: whatever stands there


def test_a_problem_is_not_changed_by_its_arrays() -> None:
    grasp = np.array(two_hands().G)
    problem = two_hands(G=grasp)
    grasp[:] = 0.0
    assert problem.G.any() and not problem.G.flags.writeable


@pytest.mark.parametrize("problem", [two_hands(), mixed()], ids=["points", "mixed"])
def test_problem_and_solution_come_back_from_their_files(
    tmp_path: Path, problem: GraspForceProblem
) -> None:
    problem.save(tmp_path / "p.npz")
    back = GraspForceProblem.load(tmp_path / "p.npz")
    for name in ("G", "J", "tau_e", "tau_min", "tau_max", "mu", "mu_t", "h_e"):
        assert np.array_equal(getattr(back, name), getattr(problem, name)), name
    assert back.model == problem.model and back.w_bT == problem.w_bT
    solution = solve(problem, load_factor=True)
    solution.save(tmp_path / "s.npz")
    again = GraspForceSolution.load(tmp_path / "s.npz")
    assert again.status is ForceStatus.SOLVED
    assert np.array_equal(again.c, solution.c) and again.load_factor == solution.load_factor


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    problem, out = two_hands(), tmp_path / "r.npz"
    problem.save(tmp_path / "p.npz")
    for method in ("newton", "exact", "flow20"):
        assert main(["forces", str(tmp_path / "p.npz"), "--out", str(out), "--method", method]) == 0
        assert capsys.readouterr().out.startswith("solved: 10 contacts")
        with np.load(out, allow_pickle=False) as result:
            assert str(result["status"]) == "solved"
            c = result["c"]
            for name in (
                "tau", "sum_normal", "phi", "iterations", "min_cone_margin",
                "min_torque_margin", "load_factor",
            ):  # fmt: skip
                assert np.isfinite(result[name]).all(), name
        rows = problem.G @ c - problem.h_e
        assert np.abs(rows).max() < 1e-9
        assert cone_margins(problem, c).min() > 0.0 and torque_margins(problem, c).min() > 0.0


def test_the_command_says_why_it_cannot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    problem, out = two_hands(load=20.0), tmp_path / "r.npz"
    problem.save(tmp_path / "p.npz")
    assert main(["forces", str(tmp_path / "p.npz"), "--out", str(out)]) == 1
    assert capsys.readouterr().out.startswith("infeasible_torque_limits")
    assert str(np.load(out)["status"]) == "infeasible_torque_limits"
    before = out.read_bytes()
    names = ("G", "J", "tau_e", "tau_min", "tau_max", "mu", "h_e")
    arrays = {name: np.array(getattr(problem, name)) for name in names}
    for changes, what in (
        ({"mu": None}, "it has no array 'mu'"),
        ({"G": np.zeros((6, 3))}, "G has shape (6, 3)"),
        ({"h_e": np.full(6, np.nan)}, "h_e[0] is nan"),
        ({"mu": -arrays["mu"]}, "mu[0] is -0.6"),
        ({"tau_min": arrays["tau_max"] + 1.0}, "tau_min[0] is 1.5"),
        ({"model": np.array("rubber")}, "model is 'rubber'"),
        ({"model": np.array(3)}, "model is not text"),
        ({"w_p": np.ones(2)}, "w_p is not one number"),
        ({"model": np.array("soft_finger")}, "mu_t is missing"),
    ):
        kept = {k: v for k, v in {**arrays, **changes}.items() if v is not None}
        np.savez(tmp_path / "bad.npz", **kept)
        assert main(["forces", str(tmp_path / "bad.npz"), "--out", str(out)]) == 2
        line = capsys.readouterr().err
        assert what in line and "bad.npz" in line and line.count("\n") == 1, line
    assert main(["forces", str(tmp_path / "no.npz"), "--out", str(out)]) == 2
    assert main(["forces", str(tmp_path / "p.npz"), "--out", str(out), "--method", "x"]) == 2
    assert out.read_bytes() == before


def test_a_matrix_stored_by_columns_is_read_right(tmp_path: Path) -> None:
    problem = two_hands()
    names = ("G", "J", "tau_e", "tau_min", "tau_max", "mu", "h_e")
    arrays = {name: np.asfortranarray(getattr(problem, name)) for name in names}
    np.savez(tmp_path / "p.npz", **arrays)
    assert np.array_equal(GraspForceProblem.load(tmp_path / "p.npz").J, problem.J)


def test_forces_need_no_robot_model() -> None:
    """The room is usable where Pinocchio is not even imported."""
    code = "import sys, wbc.forces; assert not {'pinocchio', 'coal', 'pydantic'} & set(sys.modules)"
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)
