"""Scenarios with robots that are not in urdf/: of parts, in packages, or missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wbc import resources
from wbc.cli import main
from wbc.errors import ScenarioError, UnknownNameError, UrdfError
from wbc.robot import packages
from wbc.scenario import load
from wbc.scenario.build import Assembly, build
from wbc.scenario.places import robot_file
from wbc.scenario.robots import read_robot

from .own_robots import ROBOTS, need_example_robots

PARTS = """\
name: two_wrists
parts:
  - {urdf: gantry, prefix: a_}
  - {urdf: gantry, prefix: b_, parent: a_base, xyz: [50 cm, 0, 0], rpy: [0 deg, 0 deg, 90 deg]}
"""
LIFT = """\
name: lift
robot: {urdf: wrists}
tasks:
  hand: {type: frame_position, frame: a_flange, target: [0, 0, 15 cm], gain: 5 /s}
costs: {near: {type: collision, safety_distance: 2 cm}}
stack: {priority: [hand]}
simulation: {duration: 0.1 s, step: 2 ms}
"""
REST = """\
name: rest
robot: {{urdf: '{urdf}'}}
tasks: {{rest: {{type: posture, gain: 1 /s}}}}
costs: {{near: {{type: collision, safety_distance: 2 cm}}}}
stack: {{priority: [rest]}}
simulation: {{duration: 0.1 s, step: 2 ms}}
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scenario and the parts of its robot."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wrists.parts.yaml").write_text(PARTS, encoding="utf-8")
    (tmp_path / "lift.yaml").write_text(LIFT, encoding="utf-8")
    return tmp_path


def without_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(packages, "_shares", lambda: [])


def test_a_robot_of_parts_runs_and_is_replayed(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "lift.yaml", "--out", "out"]) == 0
    kept = (folder / "out" / "robot.urdf").read_text(encoding="utf-8")
    assert 'robot name="two_wrists"' in kept
    model = read_robot(folder / "out" / "robot.urdf")
    assert model.joint_names[:2] == ("a_x", "a_y") and model.nv == 12
    for _ in range(2):  # with the file of parts, and without
        assert main(["view", "out", "--html", "out/film.html"]) == 0
        (folder / "wrists.parts.yaml").unlink(missing_ok=True)
    assert "written" in capsys.readouterr().out


def test_faults_of_the_parts_are_theirs(folder: Path) -> None:
    text = PARTS.replace("a_base", "a_bas").replace("urdf: gantry, prefix: a_", "urdf: gantri")
    (folder / "wrists.parts.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        build(load("lift.yaml"))
    assert "wrists.parts.yaml:3:12: " in str(caught.value)
    assert "did you mean 'gantry'?" in str(caught.value)
    (folder / "wrists.parts.yaml").write_text(PARTS.replace("a_base", "a_bas"), encoding="utf-8")
    with pytest.raises(UrdfError, match="did you mean 'a_base'"):
        build(load("lift.yaml"))


def test_a_robot_is_shown(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["robot", "wrists.parts.yaml"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "  wrists.parts.yaml: 12 joints, moves in space"
    assert lines[-4].split() == ["a_flange", "0", "0", "50"]
    assert lines[-3].split() == ["b_flange", "500", "0", "50"]
    assert lines[-1] == "  2 capsule"
    assert main(["robot", "planar_gripper"]) == 0
    assert main(["robot", "no/where.urdf"]) == 2
    assert capsys.readouterr().err == "no file no/where.urdf\n"


def test_where_a_robot_is_looked_for(folder: Path) -> None:
    file = folder / "sub" / "mine.urdf"
    file.parent.mkdir()
    file.write_text("<robot/>", encoding="utf-8")
    for name in ("sub/mine.urdf", "sub/mine", "./sub/mine", str(file), f"file://{file}"):
        assert robot_file(name, folder).resolve() == file.resolve()
    assert robot_file("wrists", folder).name == "wrists.parts.yaml"
    assert robot_file("gantry", folder) == resources.find("urdf", "gantry")
    assert robot_file("allegro_pair", folder).parent == resources.folder("urdf")
    with pytest.raises(UnknownNameError, match="did you mean 'gantry'"):
        robot_file("gantri", folder)


@pytest.mark.parametrize("scenario", ["allegro_pair", "baxter_box"])
def test_a_robot_that_is_not_installed_is_said_in_lines_with_a_remedy(
    scenario: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    without_packages(monkeypatch)
    assert main(["check", scenario]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert lines and all(line.endswith("; pip install example-robot-data") for line in lines)


def test_exact_shapes_are_those_of_the_urdf() -> None:
    need_example_robots()
    loaded = load("baxter_box", {"robot.collisions.shapes": "exact"})
    kinds = [type(o.geometry).__name__ for o in build(loaded).model.geometry.geometryObjects]
    assert "Capsule" not in kinds and "Cylinder" in kinds and "Convex" in kinds


def largest_errors(assembly: Assembly) -> tuple[float, float, float]:
    """Of a whole run: the object's position and rotation, and a joint's step of velocity."""
    controller, state = assembly.controller, assembly.start
    worst, before, step = np.zeros(2), np.zeros(assembly.model.nv), 0.0
    for _ in range(assembly.ticks):
        record, state = controller.step(state)
        worst = np.fmax(worst, np.nanmax(record.object_error, axis=0))
        step = max(step, float(np.abs(record.v - before).max()))
        before = record.v
        if state.phase.done:
            break
    assert state.phase.done, state.phase
    return float(worst[0]), float(worst[1]), step


@pytest.mark.parametrize("scenario", ["allegro_pair", "baxter_box"])
def test_robots_of_others_do_what_they_are_asked(scenario: str) -> None:
    need_example_robots()
    position, rotation, step = largest_errors(build(load(scenario)))
    assert position < 1e-8 and rotation < 1e-8
    assert step < 0.03


@pytest.mark.parametrize(
    "urdf",
    [
        "panda_description/urdf/panda.urdf",
        "pr2_description/urdf/pr2.urdf",  # joints without end, followers, a gripper without room
        "talos_data/robots/talos_full_v2.urdf",  # mirrored meshes, package:/// with three strokes
        "tiago_description/robots/tiago_dual.urdf",  # a hundred joints, wheels without limits
    ],
)
def test_real_robots_move_with_their_bodies_watched(urdf: str, tmp_path: Path) -> None:
    need_example_robots()
    file = tmp_path / "rest.yaml"
    file.write_text(REST.format(urdf=f"{ROBOTS}/{urdf}"), encoding="utf-8")
    assembly = build(load(file))
    assert assembly.pairs is not None and assembly.pairs.kept
    state = assembly.start
    for _ in range(3):
        record, state = assembly.controller.step(state)
        assert np.isfinite(record.v).all() and np.isfinite(state.q).all()
    assert np.all(state.q >= assembly.model.lower) and np.all(state.q <= assembly.model.upper)


def test_a_copy_of_a_scenario_finds_its_robot_and_its_pairs_by_name(tmp_path: Path) -> None:
    text = resources.find("tasks", "dual_arm_exchange").read_text(encoding="utf-8")
    copy = tmp_path / "mine.yaml"
    copy.write_text(text, encoding="utf-8")
    pairs = build(load(copy)).pairs
    assert pairs is not None and len(pairs.disabled) > 40
    line = text[: text.index("  srdf: ")].count("\n") + 1
    copy.write_text(text.replace("  srdf: dual_arm ", "  srdf: no_arm "), encoding="utf-8")
    with pytest.raises(ScenarioError, match=rf"mine.yaml:{line}:\d+: no file .*no_arm"):
        build(load(copy))
