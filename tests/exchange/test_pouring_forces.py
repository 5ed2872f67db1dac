"""The forces of pouring (section 1.5): ten fingertips on a bottle whose water moves and leaves."""

from __future__ import annotations

import numpy as np
import pytest
from forces import oracles

from wbc.control.hand_statics import touches_at
from wbc.forces import ForceStatus, GraspForceProblem
from wbc.robot.kinematics import Kinematics

from .runs import Run

SOLVED = tuple(ForceStatus).index(ForceStatus.SOLVED)
WEAK = ("index", "middle", "ring", "little")
PHASES = ("hold", "pour", "empty", "back")


def planned(run: Run, name: str) -> np.ndarray:
    return np.array([getattr(record.forces, name) for record in run.records])


def joints_of(run: Run, fingers: tuple[str, ...]) -> list[int]:
    return [
        k for k, name in enumerate(run.assembly.model.joint_names) if name.split("_")[1] in fingers
    ]


def problem_at(run: Run, k: int) -> GraspForceProblem:
    """What tick k asked, from what its log holds."""
    planner, now, dt = run.assembly.controller.planner, run.records[k], run.t[1] - run.t[0]
    assert planner is not None
    robot = Kinematics(run.assembly.model, run.assembly.controller.law.kin.robot.frames)
    robot.update(now.q)
    touch = touches_at(
        now.contact_points, now.contact_normals, robot.position[:10], now.object_position
    )
    a = (run.v[k - 1] - run.v[k - 2]) / dt
    return planner.problem(robot, now.mode, touch, run.v[k - 1], a, planned(run, "wrench")[k])


def test_every_tick_is_solved_in_balance_and_no_limit_is_broken(pouring: Run) -> None:
    assert (planned(pouring, "status") == SOLVED).all()
    assert planned(pouring, "cone_margin").min() > 0.02
    assert planned(pouring, "torque_margin").min() > 1e-3
    force = planned(pouring, "force")
    arms = pouring.series("contact_points") - pouring.series("object_position")[:, None]
    supplied = np.hstack([force.sum(axis=1), np.cross(arms, force).sum(axis=1)])
    wrench = planned(pouring, "wrench")
    size = np.linalg.norm(wrench, axis=1, keepdims=True)
    assert np.abs((supplied - wrench) / size).max() < 1e-9


def test_it_takes_hardly_more_than_one_newton_step_a_tick(pouring: Run) -> None:
    iterations, phase = planned(pouring, "iterations"), pouring.series("phase")
    means = {name: iterations[phase == k].mean() for k, name in enumerate(PHASES)}
    print({name: round(float(mean), 3) for name, mean in means.items()})
    assert iterations[1:].mean() <= 1.5 and max(means.values()) <= 1.5


def test_the_weak_fingers_stay_below_75_mnm_and_need_to(pouring: Run) -> None:
    weak, thumbs = joints_of(pouring, WEAK), joints_of(pouring, ("thumb",))
    torque = np.abs(planned(pouring, "torque"))
    assert len(weak) == 24 and len(thumbs) == 6
    assert 0.06 < torque[:, weak].max() < 0.075
    assert torque[:, thumbs].max() < 0.5
    k = int(np.argmax(torque[:, weak].max(axis=1)))  # where they work hardest
    free = oracles.exact(problem_at(pouring, k), limits=False)
    problem = problem_at(pouring, k)
    assert np.abs(problem.J.T @ free.c + problem.tau_e)[problem.tau_max < 0.1].max() > 0.1


def test_the_water_moves_and_leaves(pouring: Run) -> None:
    mass, phase = planned(pouring, "mass"), pouring.series("phase")
    assert mass[phase < 2] == pytest.approx(0.425)
    assert mass[phase == 3] == pytest.approx(0.2)
    assert (np.diff(mass) <= 1e-12).all()
    inside = np.einsum(
        "tji,tj->ti",
        pouring.series("object_rotation"),
        planned(pouring, "com") - pouring.series("object_position"),
    )
    depth, share = 0.225e-3 / (np.pi * 0.025**2), 0.225 / 0.425  # nearly half of 230 mm
    np.testing.assert_allclose(inside[0], [0.0, 0.0, -share * 0.5 * (0.23 - depth)], atol=1e-7)
    full = int(np.flatnonzero(phase == 2)[0])  # neck down, all of it still there
    assert inside[full, 2] > 0.02 and abs(inside[full, 0]) > 5e-4
    assert np.abs(inside[:, 1]).max() < 1e-7  # it turns about y
    np.testing.assert_allclose(inside[-1], 0.0, atol=1e-9)
    wrench = planned(pouring, "wrench")
    np.testing.assert_allclose(wrench[[0, -1], 2], [0.425 * 9.81, 0.2 * 9.81], rtol=1e-6)


@pytest.mark.parametrize("share", [0.05, 0.3, 0.5, 0.75, 0.95])
def test_clarabel_agrees_and_would_press_little_less(pouring: Run, share: float) -> None:
    k = int(share * len(pouring.records))
    problem, forces = problem_at(pouring, k), pouring.records[k].forces
    assert forces is not None
    least = oracles.exact(problem).value
    assert least <= forces.sum_normal < 1.3 * least + 0.5
    assert oracles.load_factor(problem).value > 1.5


def test_the_forces_change_smoothly(pouring: Run) -> None:
    force = planned(pouring, "force")
    steps = np.abs(np.diff(force, axis=0)).max(axis=(1, 2))
    print(f"largest step {steps.max():.3f} N a tick, at {pouring.t[1 + int(steps.argmax())]:.3f} s")
    assert steps.max() < 0.05 * np.linalg.norm(force, axis=2).max()
