"""Meshes, poses, commands: what the pages are told."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import umsgpack
from scipy.spatial.transform import Rotation

from wbc.errors import UnknownNameError, WbcError
from wbc.view.draw import contact_frames, fixed_commands, moving_commands, node, poses
from wbc.view.meshes import capsule, extrude, ribbon
from wbc.view.panel import panel_state, script_json
from wbc.view.scene import Scene, SceneShape, pose_matrices, quaternions

from .demo import contour, demo_scene, demo_snapshot

SHAPES = {
    "round": contour(),
    "clockwise": contour()[::-1],
    "closed twice": np.vstack((contour(), contour()[:1])),
    "not star-shaped": np.array(
        [(0, 0), (4, 0), (4, 3), (3, 3), (3, 1), (1, 1), (1, 3), (0, 3)], dtype=float
    ),
}


def volume(vertices, triangles) -> float:
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    return float(np.sum(a * np.cross(b, c))) / 6.0


def area(ring) -> float:
    x, y = ring.T
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))


def assert_watertight(vertices, triangles) -> None:
    """Every edge once in each sense, after merging vertices at the same place."""
    _, same = np.unique(np.round(vertices, 9), axis=0, return_inverse=True)
    t = same.ravel()[triangles]
    edges = Counter(map(tuple, np.concatenate((t[:, :2], t[:, 1:], t[:, ::2][:, ::-1])).tolist()))
    assert all(n == 1 and edges[b, a] == 1 for (a, b), n in edges.items())


@pytest.mark.parametrize("ring", SHAPES.values(), ids=SHAPES)
def test_an_extruded_contour_encloses_its_prism(ring):
    vertices, triangles = extrude(ring, -0.1, 0.3)
    assert_watertight(vertices, triangles)
    assert volume(vertices, triangles) == pytest.approx(0.4 * area(ring), rel=1e-12)


def test_a_capsule_encloses_its_volume():
    vertices, triangles = capsule(0.3, 0.5, around=200, rings=100)
    exact = np.pi * 0.3**2 * 0.5 + 4 / 3 * np.pi * 0.3**3
    assert volume(vertices, triangles) == pytest.approx(exact, rel=1e-3)
    assert np.ptp(vertices[:, 2]) == pytest.approx(0.5 + 2 * 0.3)


def test_a_ribbon_lies_along_its_line():
    line = contour(400)
    vertices, triangles = ribbon(line, 0.01, 0.2)
    distance = np.linalg.norm(vertices[:, None, :2] - line[None], axis=2).min(axis=1)
    assert distance.max() <= 0.0051
    assert (vertices[:, 2] == 0.2).all()
    assert len(triangles) == 800


def test_poses_and_back():
    rotations = Rotation.random(300, random_state=1)
    given = np.column_stack((np.arange(900).reshape(300, 3), rotations.as_quat()))
    matrices = pose_matrices(given)
    np.testing.assert_allclose(matrices[:, :3, :3], rotations.as_matrix(), atol=1e-14)
    np.testing.assert_array_equal(matrices[:, :3, 3], given[:, :3])
    back = quaternions(matrices)
    np.testing.assert_allclose(np.abs(np.sum(back * given[:, 3:], axis=1)), 1.0, atol=1e-14)
    assert (np.sum(back[1:] * back[:-1], axis=1) >= 0.0).all(), "the short way round"
    half_turns = np.array([np.eye(4)[0], np.eye(4)[1], np.eye(4)[2], np.eye(4)[3]])
    turned = quaternions(pose_matrices(np.column_stack((np.zeros((4, 3)), half_turns))))
    np.testing.assert_allclose(np.abs(turned), half_turns, atol=1e-15)


def test_a_zero_quaternion_is_no_pose():
    assert np.isnan(pose_matrices(np.zeros(7))[0, 0, 0])


def test_contact_frames_have_the_normal_as_z():
    normals = np.vstack((np.eye(3), -np.eye(3), Rotation.random(20, random_state=2).as_rotvec()))
    frames = contact_frames(np.zeros((len(normals), 3)), normals)
    r = frames[:, :3, :3]
    np.testing.assert_allclose(
        r @ r.transpose(0, 2, 1), np.tile(np.eye(3), (len(r), 1, 1)), atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(r), 1.0)
    unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(r[:, :, 2], unit, atol=1e-15)


@pytest.mark.parametrize("planar", [True, False])
def test_the_documented_nodes_exist(planar):
    scene = demo_scene(planar)
    paths = {path for path, _ in fixed_commands(scene) | moving_commands(scene, demo_snapshot(0))}
    for path in (
        "/wbc/world/base",
        "/wbc/robot/left",
        "/wbc/robot/left/palm",
        "/wbc/object",
        "/wbc/object/mesh",
        "/wbc/object/outline",
        "/wbc/contacts/f1/point",
        "/wbc/contacts/f1/normal",
    ):
        assert path in paths


def test_a_slash_in_a_name_opens_no_level():
    assert node("robot", "left/palm") == "/wbc/robot/left|palm"
    assert node("robot", "") == "/wbc/robot/_"


def test_a_missing_pose_hides_its_node():
    scene, snapshot = demo_scene(), demo_snapshot(0.0)
    snapshot.contact_points[1] = np.nan
    commands = moving_commands(scene, snapshot)
    path = "/wbc/contacts/f2/point"
    assert umsgpack.unpackb(commands[path, "visible"])["value"] is False
    assert (path, "transform") not in commands
    assert umsgpack.unpackb(commands["/wbc/contacts/f1/point", "visible"])["value"] is True


def test_both_forms_of_bodies_draw_the_same():
    scene = demo_scene()
    one, two = (poses(scene, demo_snapshot(0.8, matrices)) for matrices in (False, True))
    for path in one:
        np.testing.assert_allclose(one[path], two[path], atol=1e-15)


def test_a_scene_without_object_or_contacts():
    scene = Scene("bare", (SceneShape("s", "sphere", None, (1.0,)),), None, ())
    empty = replace(
        demo_snapshot(0.0),
        bodies=np.zeros((0, 7)),
        contact_points=np.zeros((0, 3)),
        contact_normals=np.zeros((0, 3)),
        contact_mode=np.zeros(0, dtype=np.int64),
    )
    assert moving_commands(scene, empty) == {}


def test_faults_of_a_scene_are_told():
    ball = SceneShape("s", "sphere", "lefft", (1.0,))
    with pytest.raises(UnknownNameError, match="did you mean 'left'"):
        Scene("x", (ball,), None, ("left",))
    with pytest.raises(WbcError, match="two shapes named 's'"):
        Scene("x", (replace(ball, body=None),) * 2, None, ())
    with pytest.raises(WbcError, match="extent"):
        Scene("x", (), None, (), extent=0.0)
    with pytest.raises(WbcError, match="a box has 3 sizes"):
        SceneShape("b", "box", None, (1.0,))
    with pytest.raises(UnknownNameError, match="kind of shape"):
        SceneShape("b", "cube", None, (1.0,))
    with pytest.raises(WbcError, match="vertices"):
        SceneShape("m", "mesh")


def test_the_panel_has_no_nan():
    state = panel_state(replace(demo_snapshot(0.0), eps_f=np.nan, activation=np.full(4, np.nan)))
    assert state["eps"][0] is None
    assert state["act"] == [0.0] * 4


def test_names_cannot_end_a_script():
    assert "</script>" not in script_json({"name": "</script><script>alert(1)"})
