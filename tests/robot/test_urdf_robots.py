"""Robots that pass the strict check: they load, move, and agree with an independent reader."""

from __future__ import annotations

import random
import re
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

from wbc import resources
from wbc.errors import UrdfError
from wbc.robot.urdf import check_urdf, load_urdf_text

TEXT = resources.find("urdf", "planar_gripper").read_text(encoding="utf-8")
LIMIT = 'lower="-2.0943951023931953" upper="2.0943951023931953"'


def _write(folder: Path, text: str | bytes) -> Path:
    path = folder / "robot.urdf"
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    return path


@pytest.mark.parametrize("name", resources.names("urdf"))
def test_robots_of_the_house_pass_and_load(name: str) -> None:
    text = load_urdf_text(resources.find("urdf", name))
    model = pin.buildModelFromXML(text)
    assert model.nv > 0 or name == "hand_stand"  # a part to put a hand on


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 2"/>'),  # Pinocchio normalises it
        ('<axis xyz="0 0 1"/>', ""),  # by the format, the axis is x
        (LIMIT, 'lower="0.5" upper="0.5"'),
        ('type="revolute"', 'type="continuous"'),
        ('type="revolute"', 'type="prismatic"'),
        ('link="palm"/>', 'link="palm" />'),
        ('<link name="tip_a"/>', '<link name="tip_a"><inertial><mass value="0"/><inertia ixx="0"'
         ' ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>'),
        ("</robot>", "<gazebo><plugin a='b'>it's > 3</plugin></gazebo></robot>"),
        ("</robot>", "<!-- <link name='tip_a'/> --></robot>"),
        ("\n", "\r\n"),
        ('"utf-8"?>', '"utf-8"?>\n\n'),
        ('<?xml version="1.0" encoding="utf-8"?>', "\ufeff"),
    ],
)  # fmt: skip
def test_sound_variants_pass_and_load(old: str, new: str, tmp_path: Path) -> None:
    assert old in TEXT
    text = load_urdf_text(_write(tmp_path, TEXT.replace(old, new)))
    assert pin.buildModelFromXML(text).nv == 7


def test_pinocchio_normalises_the_axis() -> None:
    """The ground on which axes of any length pass."""
    long = pin.buildModelFromXML(TEXT.replace('"0 0 1"', '"0 0 3"'))
    unit = pin.buildModelFromXML(TEXT)
    q = np.linspace(-1.0, 1.0, 7)
    poses = []
    for model in (long, unit):
        data = model.createData()
        pin.framesForwardKinematics(model, data, q)
        poses.append(data.oMf[model.getFrameId("tip_a")].homogeneous)
    np.testing.assert_allclose(poses[0], poses[1], atol=1e-14)


@pytest.mark.parametrize("name", ["planar_gripper", "planar_bimanual"])
def test_collision_shapes_are_capsules_that_end_at_the_joints(name: str) -> None:
    path = str(resources.find("urdf", name))
    model = pin.buildModelFromUrdf(path)
    shapes = pin.buildGeomFromUrdf(model, path, pin.COLLISION).geometryObjects
    assert len(shapes) == model.nv
    for shape in shapes:
        capsule = shape.geometry
        assert type(capsule) is coal.Capsule
        assert capsule.radius == 0.02
        end = shape.placement.act(np.array([0.0, 0.0, capsule.halfLength]))
        length = end[0] + capsule.radius
        expected = (0.8, 0.6) if "trunk" in shape.name else (0.7, 0.6)
        assert min(abs(length - e) for e in expected) < 1e-12
        start = shape.placement.act(np.array([0.0, 0.0, -capsule.halfLength]))
        np.testing.assert_allclose(start, [capsule.radius, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("name", ["planar_gripper", "planar_bimanual"])
def test_forward_kinematics_agrees_with_yourdfpy(name: str) -> None:
    yourdfpy = pytest.importorskip("yourdfpy")
    path = str(resources.find("urdf", name))
    model = pin.buildModelFromUrdf(path)
    data = model.createData()
    other = yourdfpy.URDF.load(path, load_meshes=False, build_scene_graph=True)
    links = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
    assert sorted(links) == sorted(other.link_map)
    root = other.base_link
    rng = np.random.default_rng(7)
    for _ in range(20):
        q = rng.uniform(model.lowerPositionLimit, model.upperPositionLimit)
        other.update_cfg(dict(zip(list(model.names)[1:], q, strict=True)))
        pin.framesForwardKinematics(model, data, q)
        for link in links:
            ours = data.oMf[model.getFrameId(link, pin.FrameType.BODY)].homogeneous
            np.testing.assert_allclose(ours, other.get_transform(link, root), atol=1e-9)


def test_the_pair_faces_each_other() -> None:
    model = pin.buildModelFromUrdf(str(resources.find("urdf", "planar_bimanual")))
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.zeros(14))

    def pose(name: str) -> pin.SE3:
        return data.oMf[model.getFrameId(name, pin.FrameType.BODY)]

    np.testing.assert_allclose(pose("left_base").translation, [-2.6, 0, 0], atol=1e-12)
    np.testing.assert_allclose(pose("right_base").translation, [2.6, 0, 0], atol=1e-12)
    np.testing.assert_allclose(pose("left_tip_a").translation, [0.9, 0, 0], atol=1e-12)
    np.testing.assert_allclose(pose("right_tip_b").translation, [-0.9, 0, 0], atol=1e-12)
    np.testing.assert_allclose(pose("right_palm").rotation, np.diag([-1, -1, 1]), atol=1e-12)


# Robots of others

DATA = Path(pin.__file__).parents[4] / "share" / "example-robot-data" / "robots"
SOUND = (
    "allegro_hand_description/urdf/allegro_left_hand.urdf",
    "allegro_hand_description/urdf/allegro_right_hand.urdf",
    "baxter_description/urdf/baxter.urdf",
    "g1_description/urdf/g1_29dof_with_hand_rev_1_0.urdf",
    "kinova_description/robots/kinova.urdf",
    "panda_description/urdf/panda.urdf",
    "pr2_description/urdf/pr2.urdf",
    "talos_data/robots/talos_full_v2.urdf",
    "tiago_description/robots/tiago_dual.urdf",
    "tiago_pro_description/robots/tiago_pro.urdf",
    "ur_description/urdf/ur5_robot.urdf",
    "xarm_description/urdf/xarm7.urdf",
)
UNSOUND = (
    ("alex_description/urdf/alex_psyonic_hands.urdf", "mimics the unknown joint 'index_q1'"),
    ("centauro_description/urdf/centauro.urdf", "no attribute 'lower', in joint 'j_wheel_1'"),
    ("romeo_description/urdf/romeo.urdf", "link 'LFinger13Link' moves but has no mass"),
    ("romeo_description/urdf/romeo_laas_small.urdf", "not positive definite, in link 'body'"),
)


def _robot(relative: str) -> Path:
    if not (DATA / relative).is_file():
        pytest.skip("example-robot-data is not installed")
    return DATA / relative


@pytest.mark.parametrize("relative", SOUND, ids=lambda r: Path(r).stem)
def test_real_robots_pass_and_can_be_moved(relative: str) -> None:
    model = pin.buildModelFromXML(load_urdf_text(_robot(relative)))
    data = model.createData()
    zero = np.zeros(model.nv)
    assert np.isfinite(pin.aba(model, data, pin.neutral(model), zero, zero)).all()


@pytest.mark.parametrize(("relative", "phrase"), UNSOUND, ids=lambda r: Path(r).stem)
def test_unsound_real_robots_are_refused(relative: str, phrase: str) -> None:
    with pytest.raises(UrdfError) as caught:
        check_urdf(_robot(relative))
    assert phrase in str(caught.value)


# Mutations

_BITS = [b'"', b"<", b">", b"/", b" ", b"\t", b"\n", b"nan", b"-", b"0", b"1e400", b",", b"&#9;"]
_BITS += [b"<!--", b"-->", b"<![CDATA[", b"?>", b"\xff", b"\0", b'<link name="z"/>', b"<a>", b"e"]
_VALUES = [b'""', b'"0"', b'"-1"', b'"1e-400"', b'"1e308"', b'" 1"', b'"1 "', b'"0 0 0"', b'"x"']


def _mutated(seed: int) -> bytes:
    rng = random.Random(seed)
    data = TEXT.encode("utf-8")
    at = rng.randrange(len(data))
    lines = data.split(b"\n")
    kind = rng.randrange(6)
    if kind == 0:
        return data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :]
    if kind == 1:
        return data[:at] + data[at + rng.randrange(1, 6) :]
    if kind == 2:
        return data[:at] + rng.choice(_BITS) + data[at:]
    if kind == 3:
        lines.pop(rng.randrange(len(lines)))
        return b"\n".join(lines)
    if kind == 4:
        lines.insert(rng.randrange(len(lines)), rng.choice(lines))
        return b"\n".join(lines)
    value = rng.choice(list(re.finditer(rb'"[^"]*"', data)))
    return data[: value.start()] + rng.choice(_VALUES) + data[value.end() :]


@pytest.mark.parametrize("batch", range(10))
def test_mutated_files_are_refused_or_load(batch: int, tmp_path: Path) -> None:
    for seed in range(20 * batch, 20 * batch + 20):
        path = _write(tmp_path, _mutated(seed))
        try:
            text = load_urdf_text(path)
        except UrdfError:
            continue
        model = pin.buildModelFromXML(text)
        assert pin.buildModelFromUrdf(str(path)).nv == model.nv
        pin.buildGeomFromUrdfString(model, text, pin.COLLISION)
        zero = np.zeros(model.nv)
        pose = pin.neutral(model)
        assert np.isfinite(pin.aba(model, model.createData(), pose, zero, zero)).all(), seed
