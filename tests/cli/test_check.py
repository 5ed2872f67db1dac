"""``wbc check``: what it tells of the reference exchange, and what it finds wrong."""

from __future__ import annotations

import pytest

from wbc.cli import main

from .shell import POSTURE


@pytest.fixture(scope="module")
def told():
    """The check of the reference exchange as lines."""
    import contextlib
    import io

    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert main(("check", "planar_exchange")) == 0
    return out.getvalue().splitlines()


def block(lines: list[str], title: str) -> list[str]:
    """The indented lines below a title."""
    first = lines.index(title) + 1
    last = first
    while last < len(lines) and lines[last].startswith(" "):
        last += 1
    return [line.strip() for line in lines[first:last]]


def test_the_robot_with_its_limits(told):
    robot = block(told, "robot")
    assert robot[0] == "planar_bimanual.urdf: 14 joints, moves in its plane"
    assert len(robot) == 15
    assert robot[1].split()[:5] == ["left_trunk_1", "-120.0", "to", "120.0", "deg"]


def test_every_collision_pair_is_accounted_for(told):
    pairs = block(told, "collision pairs")
    counts = [int(line.split()[0]) for line in pairs if line[0].isdecimal()]
    assert len(counts) == 5
    assert "left_finger_a_link_2 - object" in pairs


def test_each_phase_has_its_grasp(told):
    phases = block(told, "phases")
    heads = [line for line in phases if line[0].isdecimal()]
    assert [line.split(":")[0] for line in heads] == [
        "1. approach", "2. slide", "3. hand_over", "4. leave", "5. carry"
    ]  # fmt: skip
    assert "f3 sliding, f4 sliding" in heads[1]
    sizes = [line.split(",")[0] for line in phases if line.startswith("J~")]
    assert sizes == ["J~ 6 x 16", "J~ 12 x 20", "J~ 12 x 18", "J~ 6 x 16", "J~ 6 x 16"]
    assert phases[1].startswith("rehearsed: over at 0.80 s; nearest right_finger")
    assert phases[3] == "redundant (f1, f2), determinate"
    assert phases[4].startswith("force closure: with any friction")
    assert sum(line.startswith("manipulability:") for line in phases) == len(heads)


def test_the_start_is_closed_and_clear(told):
    start = block(told, "start")
    assert start[0].startswith("2 fingers closed on the object to ")
    assert float(start[0].split()[-2]) < 1e-10
    assert told[-1] == "ready to run"


def test_a_collision_at_the_start_is_a_fault(capsys):
    # the right gripper folded so that it lies across the left one
    folded = {"right_trunk_1": 0, "right_trunk_2": -100, "right_trunk_3": 100, "right_a_1": -60}
    settings = [f"--set=robot.start.{joint}={angle} deg" for joint, angle in folded.items()]
    assert main(("check", "planar_exchange", *settings)) == 2
    out, errors = capsys.readouterr()
    assert out.splitlines()[-1] == "faults found, see above"
    lines = errors.splitlines()
    assert lines and all("collide" in line and "mm deep" in line for line in lines)


def test_a_scenario_without_object_or_costs(capsys, tmp_path):
    (tmp_path / "posture.yaml").write_text(POSTURE)
    assert main(("check", str(tmp_path / "posture.yaml"))) == 0
    out = capsys.readouterr().out
    assert "no collision cost: nothing is watched" in out
    assert "1. run: no contact" in out
