"""Robots and meshes outside urdf/: paths, packages, what is said when one is missing."""

from __future__ import annotations

from pathlib import Path

import coal
import numpy as np
import pytest

from wbc.errors import UrdfError, WbcError
from wbc.robot import packages
from wbc.robot.model import RobotModel, load_robot
from wbc.robot.packages import locate

CUBE = [f"{x} {y} {z}" for x in (0, 0.02) for y in (0, 0.02) for z in (0, 0.1)]
FACES = [
    (0, 1, 3), (0, 3, 2), (4, 7, 5), (4, 6, 7), (0, 4, 5), (0, 5, 1),
    (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
]  # fmt: skip


@pytest.fixture
def clean(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """No packages but those of the test."""
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.setattr(packages, "_shares", lambda: [])
    return monkeypatch


def put(path: Path, text: str = "x") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def mesh(path: Path) -> Path:
    """A box of 2 x 2 x 10 cm as an OBJ file."""
    rows = [f"v {corner}" for corner in CUBE]
    rows += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in FACES]
    return put(path, "\n".join(rows) + "\n")


def robot(
    path: Path, filename: str, joint: str = '<limit effort="1" velocity="2"/>', what: str = "mesh"
) -> Path:
    """A link that turns without end, with a mesh to collide."""
    shape = f'<mesh filename="{filename}"/>' if what == "mesh" else what
    return put(
        path,
        f"""<robot name="r">
  <link name="base"/>
  <link name="arm">
    <inertial><mass value="1"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://nowhere/eye.stl"/></geometry></visual>
    <collision><geometry>{shape}</geometry></collision>
  </link>
  <joint name="turn" type="continuous">
    <parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>{joint}
  </joint>
</robot>
""",
    )


def shapes(model: RobotModel) -> list[type]:
    return [type(o.geometry) for o in model.geometry.geometryObjects]


@pytest.mark.parametrize(
    "name", ["near.obj", "../b/near.obj", "file://{root}/a/b/near.obj", "{root}/a/b/near.obj"]
)
def test_plain_paths(tmp_path: Path, clean: pytest.MonkeyPatch, name: str) -> None:
    file = put(tmp_path / "a" / "b" / "near.obj")
    assert locate(name.format(root=tmp_path), tmp_path / "a" / "b").resolve() == file


def test_packages_around_the_file(tmp_path: Path, clean: pytest.MonkeyPatch) -> None:
    inside = put(tmp_path / "hand" / "meshes" / "tip.obj")
    beside = put(tmp_path / "arm" / "meshes" / "link.obj")
    folder = tmp_path / "hand" / "urdf"
    folder.mkdir()
    assert locate("package://hand/meshes/tip.obj", folder) == inside
    assert locate("package://arm/meshes/link.obj", folder) == beside
    assert locate("package:///arm/meshes/link.obj", folder) == beside  # seen in real files


def test_packages_of_the_environment(tmp_path: Path, clean: pytest.MonkeyPatch) -> None:
    ros = put(tmp_path / "ros" / "hand" / "a.obj")
    own = put(tmp_path / "src" / "arm" / "b.obj")
    ament = put(tmp_path / "ws" / "share" / "base" / "c.obj")
    here = tmp_path / "x" / "y"
    clean.setenv("ROS_PACKAGE_PATH", f"{tmp_path / 'ros'}:{tmp_path / 'src' / 'arm'}")
    clean.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ws"))
    assert locate("package://hand/a.obj", here) == ros
    assert locate("package://arm/b.obj", here) == own
    assert locate("package://base/c.obj", here) == ament


def test_example_robot_data_is_found_beside_any_pin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    site = tmp_path / "site-packages"
    file = put(site / "cmeel.prefix" / "share" / "example-robot-data" / "robots" / "r.urdf")
    monkeypatch.setattr("sys.path", [str(site)])
    assert locate("package://example-robot-data/robots/r.urdf", tmp_path / "z") == file


def test_what_is_missing_says_where_it_was_looked_for(
    tmp_path: Path, clean: pytest.MonkeyPatch
) -> None:
    with pytest.raises(WbcError) as caught:
        locate("package://example-robot-data/robots/r.urdf", tmp_path)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith("no file 'robots/r.urdf' in a package 'example-robot-data'")
    for word in (str(tmp_path), "ROS_PACKAGE_PATH (not set)", "AMENT_PREFIX_PATH (not set)"):
        assert word in text
    assert text.endswith("; pip install example-robot-data")
    with pytest.raises(WbcError, match=r"no file .*gone\.obj"):
        locate("gone.obj", tmp_path)


def test_a_missing_collision_mesh_is_one_line(tmp_path: Path, clean: pytest.MonkeyPatch) -> None:
    path = robot(tmp_path / "r.urdf", "package://hand/tip.stl")
    with pytest.raises(UrdfError) as caught:
        load_robot(path)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(f"{path}:7: collision mesh 'package://hand/tip.stl' is not found: ")
    assert "ROS_PACKAGE_PATH" in text


def test_a_mesh_that_is_no_mesh_is_one_line(tmp_path: Path, clean: pytest.MonkeyPatch) -> None:
    put(tmp_path / "tip.stl", "no mesh")
    with pytest.raises(UrdfError, match="a collision mesh cannot be read"):
        load_robot(robot(tmp_path / "r.urdf", "tip.stl"))


@pytest.mark.parametrize(
    "name", ["~nobody-of-that-name/tip.obj", 5000 * "a", "package://hand/" + 5000 * "a"]
)
def test_a_mesh_that_no_file_can_be_called_is_one_short_line(
    tmp_path: Path, clean: pytest.MonkeyPatch, name: str
) -> None:
    with pytest.raises(UrdfError, match="is not found") as caught:
        load_robot(robot(tmp_path / "r.urdf", name))
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 2000


FACET = "facet normal 0 0 1\nouter loop\n{}\nendloop\nendfacet"


@pytest.mark.parametrize(
    ("corners", "told"),
    [
        ("vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0", "is flat"),
        ("vertex 0 0 0\nvertex nan 0 0\nvertex 0 inf 0", "no numbers"),
    ],
)
def test_a_mesh_without_a_hull_is_one_line(
    tmp_path: Path, clean: pytest.MonkeyPatch, corners: str, told: str
) -> None:
    put(tmp_path / "tip.stl", f"solid s\n{FACET.format(corners)}\nendsolid s\n")
    with pytest.raises(UrdfError, match=told) as caught:
        load_robot(robot(tmp_path / "r.urdf", "tip.stl"))
    assert "r.urdf" in str(caught.value) and "\n" not in str(caught.value)


def test_a_mesh_is_not_read_whatever_its_size(tmp_path: Path, clean: pytest.MonkeyPatch) -> None:
    mesh(tmp_path / "tip.obj")
    clean.setattr("wbc.robot.prepare.MAX_MESH_BYTES", 10)
    with pytest.raises(UrdfError, match=r"r\.urdf:7: collision mesh 'tip\.obj' is larger than"):
        load_robot(robot(tmp_path / "r.urdf", "tip.obj"))


def test_meshes_load_and_are_convex(tmp_path: Path, clean: pytest.MonkeyPatch) -> None:
    mesh(tmp_path / "hand" / "meshes" / "tip.obj")
    path = robot(tmp_path / "hand" / "urdf" / "r.urdf", "package://hand/meshes/tip.obj")
    assert shapes(load_robot(path)) == [coal.Capsule]  # the missing one is for the eye only
    (hull,) = load_robot(path, capsules=False).geometry.geometryObjects
    assert isinstance(hull.geometry, coal.ConvexBase)
    corners = np.array(hull.geometry.points()).reshape(-1, 3)
    np.testing.assert_allclose(np.ptp(corners, axis=0), [0.02, 0.02, 0.1], atol=1e-7)


def test_an_endless_joint_turns_far(tmp_path: Path) -> None:
    model = load_robot(robot(tmp_path / "r.urdf", "", what='<sphere radius="0.1"/>'))
    assert model.pin_model.nq == model.nv == 1
    assert (model.lower[0], model.upper[0], model.velocity[0]) == (-1e3, 1e3, 2.0)


def test_an_endless_joint_without_limits_has_none(tmp_path: Path) -> None:
    path = robot(tmp_path / "r.urdf", "", joint="", what='<sphere radius="0.1"/>')
    model = load_robot(path)
    assert (model.lower[0], model.upper[0], model.velocity[0]) == (-1e3, 1e3, 1e9)
    assert model.effort[0] == 1e9


def test_a_follower_may_leave_its_leader_no_room(tmp_path: Path) -> None:
    """As in a real gripper's file: [0, 1] and the negative of [0, 1] have only 0 in common."""
    path = robot(tmp_path / "r.urdf", "", what='<sphere radius="0.1"/>')
    arm = path.read_text(encoding="utf-8").replace('"continuous"', '"revolute"')
    arm = arm.replace("<limit", '<limit lower="0" upper="1"')
    first = arm[arm.index('  <link name="arm') : arm.index("</robot>")]
    second = first.replace('name="arm"', 'name="other"').replace('link="arm"', 'link="other"')
    second = second.replace('"turn"', '"back"').replace(
        "</joint>", '<mimic joint="turn" multiplier="-1"/></joint>'
    )
    model = load_robot(put(path, arm.replace("</robot>", f"{second}</robot>")))
    assert (model.lower[0], model.upper[0]) == (0.0, 0.0)
    np.random.default_rng(0).uniform(model.lower, model.upper)  # refuses -0.0 above 0.0
