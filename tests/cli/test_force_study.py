"""The force problems of a run, put together again from its log, and solved in every case."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.control.holding import holding
from tests.forces.problems import pouring
from tests.recording.runs import META, record
from wbc import resources
from wbc.cli.force_study import Asked, force_study, hands, longest_hold, rebuilt, solved
from wbc.cli.session import run_meta
from wbc.control.state import Measurement
from wbc.recording import Log, Recorder
from wbc.robot.model import load_robot
from wbc.scenario.build import Assembly

FINGERS = ("thumb", "index", "middle", "ring", "little")


@pytest.fixture(scope="module")
def held() -> tuple[Assembly, Log]:
    """A soap, held by three fingers and lifted a little."""
    assembly = holding()
    recorder, state = Recorder(run_meta(assembly)), assembly.start
    for _ in range(30):
        made, state = assembly.controller.step(state, Measurement(state.q))
        recorder.append(made)
    return assembly, recorder.finish()


def test_problems_of_a_run_are_those_that_it_solved(held: tuple[Assembly, Log]) -> None:
    assembly, log = held
    grasp = assembly.controller.law.kin.grasp
    asked = rebuilt(log, assembly.loaded.scenario, assembly.model, grasp)
    assert asked is not None and len(asked.ticks) == 30 and asked.fingers.tolist() == [0, 1, 2]
    moved = np.any([assembly.model.support(assembly.model.frame(tip)) for tip in
                    assembly.loaded.scenario.robot.fingers.values()], axis=0)  # fmt: skip
    for k, problem in zip(asked.ticks[2:], asked.problems[2:], strict=True):
        forces = log.contact_force_plan[k].ravel()
        c = np.concatenate([
            problem.G[:3, 3 * i : 3 * i + 3].T @ forces[3 * i : 3 * i + 3] for i in range(3)
        ])  # fmt: skip
        np.testing.assert_allclose(problem.G @ c, log.wrench_plan[k], atol=1e-9)
        tau = problem.J.T @ c + problem.tau_e
        np.testing.assert_allclose(tau, log.tau_plan[k][moved], atol=1e-9)


def test_one_hand_is_studied_without_the_cases_that_split(held: tuple[Assembly, Log]) -> None:
    assembly, log = held
    grasp = assembly.controller.law.kin.grasp
    study = force_study(log, assembly.loaded.scenario, assembly.model, grasp)
    assert study is not None and not study.splits
    assert {name for name in study.runs if "newton" not in name} == {
        "all", "sigma 0", "sigma 0.5", "sigma 0.8", "none",
    }  # fmt: skip
    planned = np.linalg.norm(log.contact_force_plan, axis=2)
    found = np.linalg.norm(study.forces("newton"), axis=2)
    np.testing.assert_allclose(found[2:], planned[2:], rtol=1e-4)
    inward = -log.contact_normals[-1] @ assembly_rotation(log, -1)
    np.testing.assert_allclose(study.frames[-1, :, :, 2], inward, atol=1e-12)


def assembly_rotation(log: Log, k: int) -> np.ndarray:
    from wbc.rotations import rotation_from_quaternion

    return rotation_from_quaternion(log.object_pose[k, 3:])


def test_no_feasible_tick_is_no_study(held: tuple[Assembly, Log]) -> None:
    assembly, log = held
    grasp = assembly.controller.law.kin.grasp
    never = replace(log, force_status=np.full(log.ticks, 2))
    assert force_study(never, assembly.loaded.scenario, assembly.model, grasp) is None


def test_the_longest_stretch_of_the_same_contacts() -> None:
    mode = np.array([[0, 0]] * 9 + [[1, 0]] * 3 + [[1, 1]] * 5 + [[1, 2]] * 4)
    usable = np.ones(len(mode), dtype=bool)
    assert longest_hold(mode, usable) == (12, 17)
    assert longest_hold(np.zeros((5, 2), dtype=int), usable[:5]) == (0, 0)
    assert longest_hold(mode[-4:], usable[-4:]) == (0, 4)
    usable[12:15] = False
    assert longest_hold(mode, usable) == (17, 21), "with most ticks that had forces"
    assert longest_hold(mode, ~usable) == (12, 17)
    assert longest_hold(mode, usable & False) == (0, 0)


def test_hands_are_the_branches_that_carry_several_tips() -> None:
    model = load_robot(resources.find("urdf", "dual_arm"))
    tips = [f"{side}_{finger}_tip" for side in ("right", "left") for finger in FINGERS]
    assert hands(model, tips).tolist() == [0] * 5 + [1] * 5
    assert hands(model, tips[::-1]).tolist() == [0] * 5 + [1] * 5, "in the order of the contacts"
    assert hands(model, tips[:5]).tolist() == [0] * 5
    assert hands(model, [tips[0], tips[5]]).tolist() == [0, 0], "a finger each: no hand of its own"


def test_pouring_by_two_hands_in_every_case() -> None:
    """The pouring case without a robot, every 40th tick."""
    problems = list(pouring(load=1.2))[::40]
    log = ten_fingers(len(problems))
    ticks = np.arange(len(problems))
    study = solved(Asked(ticks, problems, np.arange(10)), log, np.repeat([0, 1], 5))
    assert study is not None and study.splits and study.hand_names() == ["r", "l"]
    assert study.own.all()
    assert all(made.solved.all() for made in study.runs.values())
    for free, limited in (("none", "all"), ("newton none", "newton")):
        assert study.runs[free].torque_margin.min() < 0.0 < study.runs[limited].torque_margin.min()
    assert study.runs["split weighted"].torque_margin.min() > 0.0
    press = study.forces("all")[..., None, :] @ study.frames[..., 2, None]
    assert (press > 0.0).all()
    np.testing.assert_allclose(study.runs["split"].share.sum(axis=1), 1.0)
    bounds = [study.runs[name].active.sum() for name in ("all", "sigma 0", "sigma 0.5", "none")]
    assert sorted(bounds, reverse=True) == bounds and bounds[-1] == 0


def ten_fingers(ticks: int) -> Log:
    names = tuple(f"{side}_{finger}" for side in "rl" for finger in FINGERS)
    recorder = Recorder(replace(META, contact_names=names, tip_task_names=()))
    still = {
        "object_error": np.zeros((10, 2)), "mode": np.ones(10), "task_error": np.zeros(2),
        "contact_points": np.zeros((10, 3)), "contact_normals": np.zeros((10, 3)),
        "within": np.ones(2), "activation": np.ones(2), "object_rotation": np.eye(3),
    }  # fmt: skip
    for k in range(ticks):
        recorder.append(record(k, **still))
    return recorder.finish()
