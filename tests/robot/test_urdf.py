"""The strict check of a URDF: every fault is named with its line, its cause and a remedy."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from wbc import resources
from wbc.errors import UrdfError
from wbc.robot.urdf import check_urdf

GRIPPER = resources.find("urdf", "planar_gripper")
TEXT = GRIPPER.read_text(encoding="utf-8")
LINK = '<link name="trunk_link_2">'
TIP_LINK = '<link name="finger_a_link_2">'
JOINT = '<joint name="a_1"'
LIMIT = 'lower="-2.0943951023931953" upper="2.0943951023931953"'
INERTIA = 'ixx="0.0006" ixy="0" ixz="0" iyy="0.1603" iyz="0" izz="0.1603"'
JOINT_VISUAL = '<visual name="trunk_link_2_joint"'
TIP_INERTIA = 'ixx="0.0001" ixy="0" ixz="0" iyy="0.01505" iyz="0" izz="0.01505"'


@dataclass(frozen=True)
class Case:
    """Behind `anchor`, `old` becomes `new`; the fault lies on the line of `at` in the result."""

    name: str
    anchor: str
    old: str
    new: str
    phrase: str
    at: str | None = None

    def apply(self) -> tuple[str, int]:
        """The malformed text and the line that must be named."""
        start = TEXT.index(self.old, TEXT.index(self.anchor))
        text = TEXT[:start] + self.new + TEXT[start + len(self.old) :]
        place = start if self.at is None else text.index(self.at, text.index(self.anchor))
        return text, text.count("\n", 0, place) + 1


CASES = (
    # names and references
    Case("robot-name", "<robot", ' name="planar_gripper"', "", "no attribute 'name'"),
    Case("robot-version", "<robot", "<robot", '<robot version="2.0"', "version"),
    Case("link-no-name", LINK, ' name="trunk_link_2"', "", "no attribute 'name'"),
    Case("link-empty-name", "<link", 'name="palm"', 'name=""', "'name' of <link> is empty"),
    Case("link-twice", "<link", 'name="tip_b"', 'name="tip_a"', "'tip_a' is already defined"),
    Case("link-universe", "<link", 'name="base"', 'name="universe"', "'universe' is Pinocchio's"),
    Case("joint-twice", "<joint", 'name="b_2"', 'name="b_1"', "'b_1' is already defined on line"),
    Case("joint-empty-name", JOINT, 'name="a_1"', 'name=" "', "'name' of <joint> is empty"),
    Case("name-padded", JOINT, '"a_1"', '"a_1 "', "spaces around"),
    Case("parent-unknown", JOINT, '"palm"', '"plam"', "unknown parent link 'plam' (did you mean"),
    Case("child-unknown", JOINT, '"finger_a_link_1"', '"finger_a"', "unknown child link"),
    Case("parent-missing", JOINT, '<parent link="palm"/>', "", "no <parent>", at=JOINT),
    Case("child-without-link", JOINT, ' link="finger_a_link_1"', "", "no attribute 'link'"),
    # the tree
    Case("two-parents", '<joint name="tip_b', '"tip_b"', '"tip_a"', "two parents"),
    Case("second-root", "</robot>", "</robot>", '<link name="stray"/></robot>', "second root"),
    Case("own-parent", JOINT, '"palm"', '"finger_a_link_1"', "joins a link to itself", at=JOINT),
    Case(
        "loop", '<joint name="trunk_2"', '"trunk_link_1"', '"trunk_link_3"', "form a loop", at="<jo"
    ),
    # joints
    Case("type-unknown", JOINT, "revolute", "revolut", "did you mean 'revolute'?"),
    Case("type-missing", JOINT, ' type="revolute"', "", "no attribute 'type'"),
    Case("type-floating", JOINT, "revolute", "floating", "'floating' is not supported"),
    Case("type-planar", JOINT, "revolute", "planar", "'planar' is not supported"),
    Case("axis-zero", JOINT, '"0 0 1"', '"0 0 0"', "no length"),
    Case("axis-tiny", JOINT, '"0 0 1"', '"0 0 1e-320"', "no length"),
    Case("axis-empty", JOINT, ' xyz="0 0 1"', "", "<axis> has no attribute 'xyz'"),
    Case("axis-nan", JOINT, '"0 0 1"', '"0 0 nan"', "not finite"),
    Case("axis-two", JOINT, '"0 0 1"', '"0 1"', "has 2 numbers"),
    Case("axis-twice", JOINT, "<limit", '<axis xyz="0 1 0"/><limit', "a second <axis>"),
    Case("axis-typo", JOINT, "<axis", "<axes", "did you mean <axis>?"),
    Case("origin-four", JOINT, '"0 0 0"', '"0 0 0 1"', "has 4 numbers"),
    Case("origin-comma", JOINT, 'rpy="0 0 0"', 'rpy="0 0,5 0"', "decimal comma"),
    Case("origin-word", JOINT, 'rpy="0 0 0"', 'rpy="0 pi 0"', "not a number"),
    Case("origin-huge", JOINT, 'xyz="0 0 0"', 'xyz="0 1e400 0"', "too large for a double"),
    Case("origin-far", JOINT, 'xyz="0 0 0"', 'xyz="0 1e12 0"', "beyond any robot"),
    Case("origin-typo", JOINT, "xyz=", "xzy=", "did you mean 'xyz'?"),
    Case("origin-tab", JOINT, '"0 0 0"', '"0\t0 0"', "a tab or line break"),
    Case("xacro", JOINT, '"0 0 0"', '"0 0 ${h}"', "run xacro"),
    # limits
    Case("limit-missing", JOINT, "<limit", "<other", "no <limit>", at=JOINT),
    Case("limit-no-lower", JOINT, 'lower="-2.0943951023931953" ', "", "locks the joint at 0"),
    Case("limit-typo", JOINT, "upper=", "uper=", "no attribute 'upper' (found 'uper')"),
    Case("limit-crossed", JOINT, LIMIT, 'lower="1" upper="-1"', "lower 1 is above upper -1"),
    Case("limit-inf", JOINT, LIMIT, 'lower="-inf" upper="1"', "not finite"),
    Case("limit-space", JOINT, 'effort="50"', 'effort="50 "', "white space after the number"),
    Case("effort-negative", JOINT, 'effort="50"', 'effort="-50"', "effort -50 is negative"),
    Case("effort-missing", JOINT, 'effort="50"', "", "no attribute 'effort'"),
    Case("velocity-zero", JOINT, 'velocity="6"', 'velocity="0"', "velocity 0 is not positive"),
    Case("velocity-hex", JOINT, 'velocity="6"', 'velocity="0x6"', "not a number"),
    # the optional parts
    Case("mimic-unknown", JOINT, "<limit", '<mimic joint="a_9"/><limit', "unknown joint 'a_9'"),
    Case("mimic-self", JOINT, "<limit", '<mimic joint="a_1"/><limit', "mimics itself"),
    Case("mimic-fixed", JOINT, "<limit", '<mimic joint="tip_a_fixed"/><limit', "which is fixed"),
    Case("mimic-factor", JOINT, "<limit", '<mimic joint="b_1" multiplier="x"/><limit', "not a num"),
    Case("mimic-0", JOINT, "<limit", '<mimic joint="b_1" multiplier="0"/><limit', "joint fixed"),
    Case("mimic-huge", JOINT, "<limit", '<mimic joint="b_1" offset="1e99"/><limit', "beyond any"),
    Case("mimic-limits", JOINT, "<limit", '<mimic joint="b_1" offset="9"/><limit', "ask 'b_1' to"),
    Case("dynamics-empty", JOINT, "<limit", "<dynamics/><limit", "neither 'damping' nor"),
    Case("damping-negative", JOINT, "<limit", '<dynamics damping="-1"/><limit', "-1 is negative"),
    Case("safety-empty", JOINT, "<limit", "<safety_controller/><limit", "'k_velocity'"),
    Case("calibration", JOINT, "<limit", '<calibration rising="up"/><limit', "not a number"),
    # inertia
    Case("mass-nan", LINK, '<mass value="3"/>', '<mass value="nan"/>', "not finite"),
    Case("mass-negative", LINK, '<mass value="3"/>', '<mass value="-3"/>', "mass -3 is negative"),
    Case("mass-zero", LINK, '<mass value="3"/>', '<mass value="0"/>', "moves but has no mass"),
    Case("mass-missing", LINK, '<mass value="3"/>', "", "no <mass>", at="<inertial>"),
    Case("inertia-missing", LINK, f"<inertia {INERTIA}/>", "", "no <inertia>", at="<inertial>"),
    Case("inertia-entry", LINK, 'ixy="0"', "", "no attribute 'ixy'"),
    Case("inertia-negative", LINK, 'iyy="0.1603"', 'iyy="-0.1603"', "iyy -0.1603 is negative"),
    Case("inertia-indefinite", LINK, 'iyz="0"', 'iyz="0.2"', "not positive definite"),
    Case("inertia-triangle", LINK, 'izz="0.1603"', 'izz="0.5"', "sum of the other two"),
    Case(
        "inertia-point",
        TIP_LINK,
        TIP_INERTIA,
        'ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"',
        "not positive definite",
    ),
    # shapes
    Case("radius-zero", LINK, 'radius="0.02"', 'radius="0"', "is not positive"),
    Case("radius-missing", LINK, 'radius="0.02"', 'radios="0.02"', "(found 'radios')"),
    Case("length-word", LINK, 'length="0.76"', 'length="long"', "not a number"),
    Case("box-negative", "<link", "0.09 0.15 0.06", "0.09 -0.15 0.06", "is not positive"),
    Case("box-two", "<link", "0.09 0.15 0.06", "0.09 0.15", "has 2 numbers"),
    Case("shape-unknown", LINK, "<sphere", "<ball", "unknown shape <ball>"),
    Case("shape-capsule", LINK, '<cylinder radius="0.02"', '<capsule radius="0.02"', "<capsule>"),
    Case("shape-none", LINK, '<sphere radius="0.042"/>', "", "has no shape", at=JOINT_VISUAL),
    Case("mesh-no-file", LINK, '<sphere radius="0.042"/>', "<mesh/>", "no attribute 'filename'"),
    Case("mesh-scale", LINK, '<sphere radius="0.042"/>', '<mesh filename="m" scale="1 0 1"/>',
         "a scale of 0"),
    Case("capsule-name", LINK, 'capsule name="trunk_link_2', 'capsule name="trunk_link_1',
         "no <collision> with a <cylinder> is called"),
    Case("material-twice", "<robot", '"joint_colour"', '"trunk_colour"', "is defined twice"),
    Case("colour-three", "<robot", "0.10 0.62 0.70 1", "0.10 0.62 0.70", "has 3 numbers"),
    Case("colour-255", "<robot", "0.10 0.62 0.70 1", "10 62 70 1", "outside 0..1"),
    # the XML itself
    Case("unclosed", LINK, "</collision>", "", "not well-formed XML", at="</link>"),
    Case("entity", LINK, '"trunk_link_2"', '"trunk_&x;"', "Entity 'x' not defined"),
    Case("instruction", LINK, "<inertial>", "<?go?><inertial>", "processing instruction"),
    Case("doctype", "<robot", "<robot", "<!DOCTYPE robot>\n<robot", "document types"),
    Case("two-roots-of-xml", "<robot", "<robot", "<sdf/><robot", "not well-formed"),
)  # fmt: skip


def _write(folder: Path, text: str | bytes) -> Path:
    path = folder / "robot.urdf"
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    return path


def _faults(path: Path) -> list[str]:
    with pytest.raises(UrdfError) as caught:
        check_urdf(path)
    return str(caught.value).splitlines()


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_names_line_and_cause(case: Case, tmp_path: Path) -> None:
    text, line = case.apply()
    path = _write(tmp_path, text)
    faults = _faults(path)
    assert any(f.startswith(f"{path}:{line}: ") and case.phrase in f for f in faults), faults
    assert all(re.match(re.escape(str(path)) + r":\d+: \S", fault) for fault in faults)
    assert len(faults) <= 2, "one mistake must not bury its cause"


def test_all_faults_at_once_in_file_order(tmp_path: Path) -> None:
    text = TEXT.replace('velocity="6"', 'velocity="-6"').replace('value="3"', 'value="-3"')
    faults = _faults(_write(tmp_path, text))
    lines = [int(fault.split(":")[1]) for fault in faults]
    assert len(faults) == 7 + 3
    assert lines == sorted(lines)


def test_mimic_ring(tmp_path: Path) -> None:
    text = TEXT
    for joint, leader in (("b_1", "a_1"), ("b_2", "b_1"), ("a_1", "b_2")):
        start = text.index("<limit", text.index(f'<joint name="{joint}"'))
        text = text[:start] + f'<mimic joint="{leader}"/>' + text[start:]
    (fault,) = _faults(_write(tmp_path, text))
    assert "the joints 'a_1', 'b_2', 'b_1' mimic each other" in fault


def test_moving_leaf_without_inertial(tmp_path: Path) -> None:
    start = TEXT.index("<inertial>", TEXT.index(TIP_LINK))
    end = TEXT.index("</inertial>", start) + len("</inertial>")
    (fault,) = _faults(_write(tmp_path, TEXT[:start] + TEXT[end:]))
    line = TEXT.count("\n", 0, TEXT.index(TIP_LINK)) + 1
    assert f":{line}: link 'finger_a_link_2' moves but has no mass, in joint 'a_2'" in fault


def test_line_of_a_tag_over_several_lines(tmp_path: Path) -> None:
    text = TEXT.replace('<axis xyz="0 0 1"/>', '<axis\n  \n xyz="0 0 0"\n/>', 1)
    (fault,) = _faults(_write(tmp_path, text))
    assert f":{TEXT.count(chr(10), 0, TEXT.index('<axis')) + 1}: the axis has no length" in fault


@pytest.mark.parametrize(
    ("content", "phrase"),
    [
        (b"", "the file is empty"),
        (b" \n", "the file is empty"),
        (b"\0" * 100, "not well-formed"),
        (TEXT.encode("utf-16"), "not UTF-8"),
        (TEXT.replace("palm", "pälm").encode("latin-1"), "not UTF-8"),
        (TEXT[: len(TEXT) // 2].encode(), "is the file complete?"),
        (b"<sdf/>", "the root element is <sdf>, not <robot>"),
        (b"<robot name='r'/>", "no <link>"),
        (b"x" * 20_000_001, "larger than 20 MB"),
        (b"<robot name='r'>" + b"<link/>" * 3000 + b"</robot>", "more than 2000 links"),
    ],
)
def test_files_that_are_no_robot(content: bytes, phrase: str, tmp_path: Path) -> None:
    (fault,) = _faults(_write(tmp_path, content))
    assert phrase in fault


def test_unreadable_paths(tmp_path: Path) -> None:
    assert "No such file" in _faults(tmp_path / "absent.urdf")[0]
    assert "not a file" in _faults(tmp_path)[0]


def _bomb() -> str:
    entities = "".join(f'<!ENTITY e{i + 1} "{f"&e{i};" * 10}">' for i in range(12))
    return f'<!DOCTYPE r [<!ENTITY e0 "boom">{entities}]><robot name="&e12;"/>'


@pytest.mark.parametrize(
    "content",
    [
        _bomb(),
        '<!DOCTYPE r SYSTEM "file:///etc/hostname"><robot name="r"/>',
        "<robot name='r'>" + "<a>" * 30_000 + "</a>" * 30_000 + "</robot>",
        "<robot name='r'>" + "<a>" * 300 + "</a>" * 300 + "</robot>",
        "<robot name='r'>" + "<a/>" * 1_000_000 + "</robot>",
        "<robot name='r'>" + "<!--" * 1_000_000,
        "<robot name='r'>" + "<a " + "'" * 1_000_000,
    ],
    ids=["bomb", "external", "deep", "nested", "wide", "comments", "quotes"],
)
def test_hostile_files_are_refused_quickly(content: str, tmp_path: Path) -> None:
    path = _write(tmp_path, content)
    start = time.perf_counter()
    _faults(path)
    assert time.perf_counter() - start < 2.0


def test_many_faults_stay_readable(tmp_path: Path) -> None:
    joint = '<joint name="j" type="x"><parent link="p"/><child link="c"/></joint>'
    faults = _faults(_write(tmp_path, TEXT.replace("</robot>", joint * 1000 + "</robot>")))
    assert len(faults) == 101
    assert "more faults" in faults[-1]
