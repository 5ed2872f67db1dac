"""The blocks of a run under torques: what is read, what is refused, and what becomes of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.sim.worlds import PROBE
from wbc.control.force_control import finger_joints
from wbc.errors import ScenarioError
from wbc.robot.model import load_robot
from wbc.scenario import load
from wbc.scenario.arms import check_arms
from wbc.scenario.build import build
from wbc.scenario.build_dynamics import build_dynamics, true_body, true_physics

Lines = Callable[..., list[str]]
TASK = "planar_exchange_dynamic"

FAULTS = [
    ({"simulation.engine": "bullet"}, "simulation.engine: must be kinematic, compliant or mujoco"),
    ({"simulation.physics.friction": "-0.1"}, "simulation.physics.friction: must be at least 0"),
    ({"simulation.physics.friction": "{f9: 0.5}"}, "unknown contact 'f9'"),
    ({"force_control.position": "{f9: 2000 N/m}"}, "unknown contact 'f9'"),
    ({"force_control.position": "2000 Nm/rad"}, "must be a stiffness such as '5e4 N/m'"),
    ({"force_control.integral": "-1 /s"}, "must be at least 0"),
    ({"force_control.arms.stiffness": "{lift: 10 Nm/rad}"}, "unknown joint 'lift'"),
    ({"simulation.physics.armature": "{'left_*': 1 kg}"}, "must be an inertia"),
    ({"simulation.engine": "mujoco", "simulation.physics.control": "continuous"},
     "continuous is of the compliant engine"),
]  # fmt: skip


@pytest.mark.parametrize(("settings", "words"), FAULTS, ids=lambda x: str(x)[:40])
def test_what_is_wrong_is_told_in_one_line(settings: dict[str, str], words: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        build(load(TASK, settings))
    lines = str(caught.value).splitlines()
    assert len(lines) == 1 and words in lines[0], lines


NEEDS = [
    ("planar_exchange", "needs a block 'force_control'"),
    ("planar_exchange", "needs 'mass' in the block 'object'"),
    ("planar_exchange", "needs the object's 'inertia' about z"),
    ("reach", "needs a block 'object'"),
]


@pytest.mark.parametrize(("task", "words"), NEEDS)
def test_an_engine_says_what_it_needs(task: str, words: str) -> None:
    with pytest.raises(ScenarioError, match=words):
        load(task, {"simulation.engine": "compliant"})


def test_an_ideal_robot_needs_none_of_it() -> None:
    assert load("planar_exchange").scenario.simulation.engine == "kinematic"
    assert build_dynamics(build(load("planar_exchange"))) is None


def test_gains_and_physics_arrive_by_contact_by_joint_and_by_pattern() -> None:
    settings = {
        "force_control.force": "{f1: 0.1, '*': 0.3}",
        "force_control.damping": "{'left_a_*': 4 Nm s/rad, '*': 6 Nm s/rad}",
        "force_control.arms": "{stiffness: {'left_*': 800 Nm/rad}, damping: 90 Nm s/rad,"
        " integral: 2 /s, windup: 7 Nm}",
        "simulation.physics": "{step: 0.5 ms, friction: {f3: 0.5}, sliding_friction: 0.1,"
        " armature: {'*_trunk_*': 0.2 kg m^2}}",
    }
    assembly = build(load(TASK, settings))
    dynamics = build_dynamics(assembly)
    assert dynamics is not None and dynamics.held
    names, gains = assembly.model.joint_names, dynamics.second.gains
    assert gains.force.tolist() == [0.1, 0.3, 0.3, 0.3]

    def of(values: np.ndarray, name: str) -> float:
        return float(values[names.index(name)])

    assert of(gains.damping, "left_a_1") == 4.0 and of(gains.damping, "right_a_1") == 6.0
    assert of(gains.damping, "left_trunk_1") == 90.0
    assert of(gains.stiffness, "left_trunk_2") == 800.0
    assert of(gains.stiffness, "right_trunk_2") == 1000.0  # as where nothing is said
    assert of(gains.stiffness, "left_a_1") == 0.0
    assert of(gains.joint_integral, "left_trunk_2") == 1600.0
    assert (gains.joint_windup == 7.0).all()
    assert of(gains.tau_max, "left_trunk_1") == 200.0 and of(gains.tau_min, "left_a_1") == -50.0
    scenario, grasp = assembly.loaded.scenario, assembly.controller.law.kin.grasp
    physics = true_physics(scenario, assembly.model, grasp)
    assert physics.step == 5e-4
    assert physics.friction.tolist() == [0.8, 0.8, 0.5, 0.8]
    assert physics.sliding_friction.tolist() == [0.1] * 4
    assert of(physics.armature, "right_trunk_3") == 0.2 and of(physics.armature, "left_a_1") == 0.0
    assert true_body(scenario).mass == 1.0


def test_fingers_are_the_joints_that_carry_one_tip() -> None:
    dynamics = build_dynamics(assembly := build(load(TASK)))
    assert dynamics is not None
    fingers = [
        name for name, own in zip(assembly.model.joint_names, dynamics.second.fingers, strict=True)
        if own
    ]  # fmt: skip
    assert fingers == [
        f"{side}_{finger}_{k}" for side in ("left", "right") for finger in "ab" for k in (1, 2)
    ]


ONLY_FINGERS = [
    ("stiffness", "{left_a_1: 10 Nm/rad}", "stiffness.left_a_1: ", "left_a_1", "position"),
    ("stiffness", "{'*_trunk_*': 500, 'right_b_*': 10}", "stiffness.right_b_*: ", "right_b_1",
     "position"),
    ("damping", "{left_b_2: 3, '*': 90}", "damping.left_b_2: ", "left_b_2", "damping"),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "value", "where", "joint", "instead"), ONLY_FINGERS)
def test_gains_of_arms_that_fit_fingers_only_are_refused(
    kind: str, value: str, where: str, joint: str, instead: str
) -> None:
    with pytest.raises(ScenarioError) as caught:
        build(load(TASK, {f"force_control.arms.{kind}": value}))
    (line,) = str(caught.value).splitlines()
    assert f"{where.split('.', 1)[1]}fits only joints of fingers" in line, line
    assert f"as '{joint}' does" in line and f"'force_control.{instead}'; name joints of" in line


def test_where_it_stands_in_the_file_is_said(tmp_path: Path) -> None:
    file, text = tmp_path / "mine.yaml", load(TASK).text
    before = "  arms: {stiffness: 1000 Nm/rad, damping: 60 Nm s/rad}\n"
    assert text.count(before) == 1
    file.write_text(text.replace(before, "  arms:\n    stiffness:\n      left_a_*: 10 Nm/rad\n"))
    at = file.read_text().splitlines().index("      left_a_*: 10 Nm/rad") + 1
    with pytest.raises(ScenarioError, match=rf"mine\.yaml:{at}:7: force_control\.arms\.stiff"):
        build(load(file))


def test_arms_with_one_tip_each_are_fingers_as_a_whole() -> None:
    """What was written for their arms is refused; what nobody wrote is no fault."""
    scenario, model = load(TASK).scenario, build(load(TASK)).model
    tips = tuple(scenario.robot.fingers[name] for name in ("f1", "f3"))
    assert finger_joints(model, tips).sum() == 10  # fingers without a tip carry none
    table = ("force_control", "arms")

    def faulty(arms: str) -> list[Any]:
        given = load(TASK, {"force_control.arms": arms}).scenario
        return [fault.path for fault in check_arms(given, model, tips)]

    assert faulty("{}") == [] and faulty("{windup: 5 Nm}") == []
    assert faulty("{damping: 60 Nm s/rad, stiffness: {left_trunk_2: 800}}") == [
        (*table, "stiffness", "left_trunk_2")
    ]
    one = load_robot(Path("probe.urdf"), text=PROBE)
    faults = check_arms(scenario, one, ("tip",))
    assert [fault.path for fault in faults] == [(*table, "stiffness"), (*table, "damping")]
    assert all(fault.text.endswith("; remove it") for fault in faults)


def test_a_touch_by_its_defaults_ends_a_phase_and_an_empty_condition_names_it() -> None:
    task, key = "ball_exchange_mujoco", "phases.approach.until"
    (phase,) = (p for p in load(task, {key: "{touch: {}}"}).scenario.phases if p.name == "approach")
    assert phase.until is not None and phase.until.touch is not None
    assert phase.until.touch.force == 0.15
    with pytest.raises(ScenarioError, match="force_closure, touch or press"):
        load(task, {key: "{residual: {}}"})


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({}, True),  # the table
        ({"simulation.engine": "compliant"}, True),  # a fixture in its place until the lift
        ({"simulation.physics.fixture": "grip"}, True),  # the table still
        ({"simulation.physics.fixture": "grip", "simulation.engine": "compliant"}, False),
        ({"simulation.physics.fixture": "lift", "simulation.engine": "compliant"}, True),
        ({"simulation.physics.table": None}, False),
    ],
)
def test_what_bears_the_object_as_fingers_grip_it(settings: dict[str, Any], expected: bool) -> None:
    """Where nothing does, the first forces are there at once."""
    phases = build(load("ball_exchange_mujoco", settings)).controller.phases.phases
    grip = next(phase for phase in phases if phase.name == "grip")
    assert grip.borne is expected
    assert grip.passes is expected  # planned forces begin with none
