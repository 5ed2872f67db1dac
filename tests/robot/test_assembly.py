"""Robots made of several URDFs: names, frames, meshes, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from lxml import etree

from wbc.cli import main
from wbc.errors import UrdfError
from wbc.robot.assembly import Part, assemble
from wbc.robot.urdf import load_urdf_text

INERTIAL = (
    '<inertial><mass value="1"/>'
    '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
)
ARM = f"""<robot name="arm">
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="base"/>
  <link name="tool">{INERTIAL}
    <visual name="look"><geometry><sphere radius="0.1"/></geometry><material name="grey"/></visual>
  </link>
  <joint name="lift" type="prismatic"><parent link="base"/><child link="tool"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/></joint>
</robot>"""
HAND = f"""<robot name="hand">
  <!-- a hand -->
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="palm">
    <visual><geometry><mesh filename="meshes/palm.stl"/></geometry></visual>
    <collision name="rod"><geometry><cylinder radius="0.01" length="0.1"/></geometry></collision>
    <collision_checking><capsule name="rod"/></collision_checking>
  </link>
  <link name="near">{INERTIAL}</link>
  <link name="far">{INERTIAL}</link>
  <joint name="bend" type="revolute"><parent link="palm"/><child link="near"/>
    <origin xyz="0.1 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="curl" type="revolute"><parent link="near"/><child link="far"/>
    <origin xyz="0.1 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
    <mimic joint="bend" multiplier="0.5"/></joint>
  <transmission name="drive"><joint name="bend"/><actuator name="motor"/></transmission>
  <gazebo reference="far"/>
</robot>"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with an arm, a hand and the hand's mesh."""
    (tmp_path / "arm.urdf").write_text(ARM, encoding="utf-8")
    (tmp_path / "hand.urdf").write_text(HAND, encoding="utf-8")
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "palm.stl").write_bytes(b"")
    return tmp_path


def _parts(folder: Path, **hand: object) -> list[Part]:
    given = {"prefix": "r_", "parent": "tool", "xyz": (0.0, 0.0, 0.1), **hand}
    return [Part(folder / "arm.urdf"), Part(folder / "hand.urdf", **given)]  # type: ignore[arg-type]


def test_every_name_and_every_mention_gets_the_prefix(folder: Path) -> None:
    robot = etree.fromstring(assemble("both", _parts(folder)))
    assert robot.get("name") == "both"
    assert [e.get("name") for e in robot.iterfind("link")] == [
        "base", "tool", "r_palm", "r_near", "r_far"
    ]  # fmt: skip
    assert [e.get("name") for e in robot.iterfind("joint")] == [
        "lift", "r_bend", "r_curl", "r_palm_mount"
    ]  # fmt: skip
    assert [e.get("joint") for e in robot.iterfind("joint/mimic")] == ["r_bend"]
    assert [e.get("name") for e in robot.iterfind("material")] == ["grey", "r_grey"]
    assert robot.find("link/visual/material").get("name") == "grey"
    palm = robot.find("link[@name='r_palm']")
    assert palm.find("collision").get("name") == "r_rod"
    assert palm.find("collision_checking/capsule").get("name") == "r_rod"
    drive = robot.find("transmission")
    assert drive.get("name") == "r_drive"
    assert [drive.find(t).get("name") for t in ("joint", "actuator")] == ["r_bend", "r_motor"]
    assert robot.find("gazebo").get("reference") == "r_far"


def test_the_result_passes_and_moves_as_its_parts(folder: Path) -> None:
    rpy = (0.3, -0.4, 0.5)
    out = folder / "both.urdf"
    out.write_text(assemble("both", _parts(folder, rpy=rpy)), encoding="utf-8")
    whole = pin.buildModelFromXML(load_urdf_text(out))
    hand = pin.buildModelFromUrdf(str(folder / "hand.urdf"))
    data, own = whole.createData(), hand.createData()
    pin.framesForwardKinematics(whole, data, np.array([0.2, 0.7, -0.3]))
    pin.framesForwardKinematics(hand, own, np.array([0.7, -0.3]))
    mount = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array([0.0, 0.0, 0.3 + 0.2 + 0.1]))
    expected = mount * own.oMf[hand.getFrameId("far")]
    assert data.oMf[whole.getFrameId("r_far")].isApprox(expected, 1e-12)


def test_meshes_are_found_from_anywhere(folder: Path) -> None:
    def mesh(text: str) -> str:
        (folder / "hand.urdf").write_text(HAND.replace("meshes/palm.stl", text), encoding="utf-8")
        robot = etree.fromstring(assemble("both", _parts(folder)))
        return str(robot.find(".//mesh").get("filename"))

    assert mesh("meshes/palm.stl") == str((folder / "meshes/palm.stl").resolve())
    assert mesh("package://hand/palm.stl") == "package://hand/palm.stl"
    with pytest.raises(UrdfError, match=r"hand\.urdf as 'r_': the mesh 'nothing.stl' is not there"):
        mesh("nothing.stl")


def test_a_part_may_be_used_twice_with_two_prefixes(folder: Path) -> None:
    parts = [*_parts(folder), Part(folder / "hand.urdf", "l_", "tool")]
    names = [e.get("name") for e in etree.fromstring(assemble("three", parts)).iterfind("joint")]
    assert names == [
        "lift", "r_bend", "r_curl", "r_palm_mount", "l_bend", "l_curl", "l_palm_mount"
    ]  # fmt: skip


def test_materials_of_one_name_are_kept_once_if_they_are_the_same(folder: Path) -> None:
    robot = etree.fromstring(assemble("both", _parts(folder, prefix="")))
    assert [e.get("name") for e in robot.iterfind("material")] == ["grey"]
    (folder / "hand.urdf").write_text(HAND.replace("0.5 0.5 0.5", "1 0 0"), encoding="utf-8")
    with pytest.raises(UrdfError, match="material 'grey' is already in"):
        assemble("both", _parts(folder, prefix=""))


@pytest.mark.parametrize(
    ("hand", "told"),
    [
        ({"parent": "tol"}, "unknown parent link 'tol' (did you mean 'tool'?)"),
        ({"parent": ""}, "no parent: name the link of an earlier part"),
        ({"parent": "r_palm"}, "unknown parent link 'r_palm'"),
        ({"prefix": "a b"}, "the prefix 'a b' has white space"),
        ({"prefix": "a\x01"}, "the prefix 'a?' has white space or control characters"),
        ({"xyz": (0.0, float("nan"), 0.0)}, "xyz and rpy must be finite"),
    ],
)
def test_a_part_out_of_place_is_one_line(folder: Path, hand: dict[str, object], told: str) -> None:
    with pytest.raises(UrdfError) as caught:
        assemble("both", _parts(folder, **hand))
    assert told in str(caught.value)
    assert "hand.urdf" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["", "a\x00b", "a\ud800"])
def test_a_name_that_xml_cannot_hold_is_one_line(folder: Path, name: str) -> None:
    with pytest.raises(UrdfError, match="the robot's name"):
        assemble(name, _parts(folder))


def test_names_that_two_parts_share_are_all_named(folder: Path) -> None:
    twice = [Part(folder / "arm.urdf"), Part(folder / "arm.urdf", parent="tool")]
    with pytest.raises(UrdfError) as caught:
        assemble("both", twice)
    lines = str(caught.value).splitlines()
    assert len(lines) == 3
    for line, name in zip(lines, ("link 'base'", "link 'tool'", "joint 'lift'"), strict=True):
        assert f"{name} is already in {folder / 'arm.urdf'}; give the part a prefix" in line


def test_no_part_a_first_part_with_parent_and_a_broken_part(folder: Path) -> None:
    with pytest.raises(UrdfError, match="no parts"):
        assemble("nothing", [])
    with pytest.raises(UrdfError, match="the first part has no parent"):
        assemble("arm", [Part(folder / "arm.urdf", parent="tool")])
    (folder / "hand.urdf").write_text(HAND.replace('"0 1 0"', '"0 0 0"'), encoding="utf-8")
    with pytest.raises(UrdfError, match=r"hand\.urdf:\d+: the axis has no length"):
        assemble("both", _parts(folder))


PARTS = """\
name: both
parts:
  - urdf: arm.urdf
  - {urdf: hand.urdf, prefix: r_, parent: tool, xyz: [0, 0, 10 cm], rpy: [0, -90 deg, 0]}
"""


def test_the_command_writes_the_robot(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "parts.yaml").write_text(PARTS, encoding="utf-8")
    out = folder / "out" / "both.urdf"
    assert main(["assemble", str(folder / "parts.yaml"), str(out)]) == 0
    assert "both, 2 parts, 3 moving joints, 1 of them coupled" in capsys.readouterr().out
    origin = etree.parse(out).find("joint[@name='r_palm_mount']/origin")
    assert origin.get("xyz") == "0 0 0.1"
    assert origin.get("rpy") == "0 -1.57079632679 0"


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("-90 deg", "-90", "parts[1].rpy[1]: an angle needs its unit"),
        ("prefix", "prefx", ":4:23: unknown key 'prefx' (did you mean 'prefix'?)"),
        ("hand.urdf", "hnd.urdf", "no robot of that name: 'hnd.urdf' (did you mean 'hand.urdf'?)"),
        ("name: both\n", "", ":1:1: missing key 'name'"),
        ("[0, 0, 10 cm]", "3", "parts[1].xyz: must be a list of 3, got 3"),
        ("urdf: hand.urdf", "urdf: 3", "parts[1].urdf: must be text, got 3"),
        ("  - urdf: arm.urdf", "  - arm.urdf", ":3:5: parts[0]: must be a mapping"),
        (PARTS, "name: x\nparts: 3\n", ":2:8: parts: must be a list, got 3"),
        (PARTS, "- 3\n", ":1:1: must be a mapping"),
        ("name: both", "name: [", ":3:3: a value is missing here"),
    ],
)
def test_faults_of_the_file_have_a_place(
    folder: Path, old: str, new: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert old in PARTS
    (folder / "parts.yaml").write_text(PARTS.replace(old, new), encoding="utf-8")
    assert main(["assemble", str(folder / "parts.yaml"), str(folder / "out.urdf")]) == 2
    assert told in capsys.readouterr().err
    assert not (folder / "out.urdf").exists()


def test_a_part_is_not_overwritten(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "parts.yaml").write_text(PARTS, encoding="utf-8")
    assert main(["assemble", str(folder / "parts.yaml"), str(folder / "arm.urdf")]) == 2
    assert "is one of the files to read" in capsys.readouterr().err
    assert (folder / "arm.urdf").read_text(encoding="utf-8") == ARM
