"""A robot some of whose joints follow others, from the file to what is drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from wbc.cli import main
from wbc.control.state import Measurement
from wbc.errors import ScenarioError
from wbc.robot.model import load_robot
from wbc.robot.pruning import prune
from wbc.scenario import load
from wbc.scenario.build import build
from wbc.view.from_robot import SnapshotMaker, robot_scene

LINK = """<link name="{0}"><inertial><mass value="1"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>{1}</link>"""
ROD = """<collision><origin xyz="0.15 0 0" rpy="0 1.5708 0"/>
<geometry><cylinder radius="0.02" length="0.3"/></geometry></collision>"""
JOINT = """<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/>
<origin xyz="{4} 0 0"/><axis xyz="0 0 1"/>{5}
<limit lower="-2" upper="2" effort="1" velocity="4"/></joint>"""
# the second rod stays level: it turns back by both joints before it, in two steps at one place
ROBOT = "\n".join(
    [
        '<robot name="r"><link name="base"/>',
        LINK.format("one", ROD), LINK.format("two", ROD), LINK.format("hub", ""),
        LINK.format("level", ROD), LINK.format("lift", ROD),
        JOINT.format("a", "revolute", "base", "one", 0, ""),
        JOINT.format("b", "revolute", "one", "two", 0.3, ""),
        JOINT.format("b_back", "revolute", "two", "hub", 0.3, '<mimic joint="b" multiplier="-1"/>'),
        JOINT.format("a_back", "revolute", "hub", "level", 0, '<mimic joint="a" multiplier="-1"/>'),
        JOINT.format("up", "prismatic", "level", "lift", 0.3,
                     '<mimic joint="a_back" multiplier="0.1" offset="0.2"/>'),
        "</robot>",
    ]
)  # fmt: skip
SCENARIO = """
name: coupled
robot: {urdf: r.urdf, start: {START}}
tasks:
  tip: {type: frame_position, frame: level, axes: [x, y], target: [0.3, 0.3, 0], gain: 10 /s}
stack: {priority: [tip]}
phases: [{name: go, tasks: [tip], until: {time: 1 s}, timeout: {after: 2 s, then: stop}}]
simulation: {duration: 1 s, step: 2 ms}
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    (tmp_path / "r.urdf").write_text(ROBOT)
    path = tmp_path / "coupled.yaml"
    path.write_text(SCENARIO.replace("START", "a: 20 deg, b: 60 deg"))
    return path


def test_followers_keep_the_limits_of_velocity_and_acceleration(tmp_path: Path) -> None:
    text = ROBOT.replace('<mimic joint="b" multiplier="-1"/>', '<mimic joint="b" multiplier="-3"/>')
    (tmp_path / "r.urdf").write_text(text)
    path = tmp_path / "coupled.yaml"
    path.write_text(
        SCENARIO.replace("START", "a: 20 deg, b: 30 deg").replace("gain: 10 /s", "gain: 300 /s")
        + "limits: {acceleration: 60 rad/s^2}\n"
    )
    assembly = build(load(path))
    model, state = assembly.model, assembly.start
    seen = []
    for _ in range(300):
        before = state.v
        _, state = assembly.controller.step(state)
        slope = (state.v - before) / assembly.controller.settings.dt
        seen.append(
            np.abs(np.outer((1, 1), model.ratio) * np.array([state.v, slope])[:, model.master])
        )
        q = model.full(state.q)
        assert np.all(np.abs(q) <= 2.0 + 1e-12)
    velocity, acceleration = np.max(seen, axis=0)
    assert velocity.max() <= 4.0 * (1.0 + 1e-9)
    assert 50.0 < acceleration.max() <= 60.0 * (1.0 + 1e-6)


def test_the_task_is_reached_with_the_coupling_kept(scenario: Path) -> None:
    assembly = build(load(scenario))
    model, state = assembly.model, assembly.start
    maker, data = SnapshotMaker(model), model.pin_model.createData()
    for _ in range(assembly.ticks):
        record, state = assembly.controller.step(state, Measurement(state.q))
    assert record.q.shape == (2,)
    a, b = record.q
    everything = np.zeros(model.n_full)
    for name, value in (("a", a), ("b", b), ("b_back", -b), ("a_back", -a), ("up", 0.2 - 0.1 * a)):
        everything[model.full_names.index(name)] = value
    pin.framesForwardKinematics(model.pin_model, data, everything)
    level = data.oMf[model.frame("level")]
    assert level.translation[:2] == pytest.approx((0.3, 0.3), abs=1e-3)
    assert level.rotation == pytest.approx(np.eye(3), abs=1e-12)
    bodies = maker.of_record(record).bodies
    scene = robot_scene(model, assembly.controller.law.kin.grasp, title="")
    assert scene.body_names == model.full_names and len(bodies) == 5
    for k, pose in enumerate(bodies):
        assert pose == pytest.approx(np.array(data.oMi[k + 1].homogeneous), abs=1e-12)


def test_a_start_for_a_follower_is_a_fault_that_names_its_master(scenario: Path) -> None:
    text = SCENARIO.replace("START", "a: 20 deg, up: 1 cm, a_back: 3 deg")
    scenario.write_text(text.replace("[tip]}\nph", "[tip, rest]}\nph").replace(
        "stack:", "  rest: {type: posture, joints: [b_back], gain: 1 /s}\nstack:"
    ))  # fmt: skip
    with pytest.raises(ScenarioError) as caught:
        build(load(scenario))
    lines = str(caught.value).splitlines()
    for line, (joint, master) in zip(
        lines, (("up", "a"), ("a_back", "a"), ("b_back", "b")), strict=True
    ):
        assert f"joint '{joint}' follows '{master}'" in line and f"name '{master}'" in line
        assert "coupled.yaml:" in line


def test_check_prints_what_follows_what(scenario: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(scenario)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "2 joints and 3 that follow them" in out
    assert "b_back = -1 b" in out
    assert "up = -1.74533 a +200 mm" in out  # per degree


def test_links_that_share_a_place_through_an_empty_one_are_adjacent(scenario: Path) -> None:
    model = load_robot(scenario.with_name("r.urdf"))
    report = prune(model, model.geometry, margin=0.1)
    assert ("two", "level") in report.adjacent
    assert ("one", "level") not in report.adjacent
