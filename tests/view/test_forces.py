"""Planned forces in the picture: whose joints, which arrows, how long, in which colour."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
import umsgpack

from wbc.contact.grasp import Grasp
from wbc.errors import UnknownNameError, WbcError
from wbc.view import Scene, write_html
from wbc.view.arrows import FORCE, LIMITED, marks
from wbc.view.arrows import poses as arrow_poses
from wbc.view.draw import STATES, fixed_commands, moving_commands, node, poses, tips
from wbc.view.forces import ArrowMaker, Load, own_joints
from wbc.view.from_robot import SnapshotMaker, robot_scene, status_text
from wbc.view.panel import panel_info
from wbc.view.scene import ForceArrows
from wbc.view.slot import Layout, SlotReader, SlotWriter, anonymous_file

from .demo import demo_scene, demo_snapshot
from .hands import LIMIT, PLACE, TIPS, dual_arm, postures, under_torques, with_forces
from .test_drawing import volume
from .test_html import animation_of, values

MODEL, GRASP, _ = dual_arm()
ROWS = with_forces(MODEL, postures(MODEL, 7))
NV = MODEL.nv


def force_scene(grasp: Grasp = GRASP) -> Scene:
    q = postures(MODEL, 2).q
    return robot_scene(
        MODEL, grasp, title="", tips=list(TIPS.values()), friction=[0.6] * grasp.count,
        shown=[(q[0], PLACE), (q[-1], PLACE)], task_names=("object", "force", "moment", "posture"),
    )  # fmt: skip


SCENE = force_scene()


def maker() -> SnapshotMaker:
    arrows = ArrowMaker(MODEL, list(TIPS.values()), [-LIMIT] * NV, [LIMIT] * NV)
    return SnapshotMaker(MODEL, arrows=arrows)


def length(pose: np.ndarray) -> float:
    return float(np.linalg.norm(pose[:3, 2]))


def test_a_finger_owns_the_joints_that_move_no_other_tip() -> None:
    own = own_joints(MODEL, list(TIPS.values()))
    for row, name in zip(own, TIPS, strict=True):
        side, finger = ("right" if name[0] == "r" else "left"), name[2:]
        names = [MODEL.joint_names[k] for k in np.flatnonzero(row)]
        assert names and all(n.startswith(f"{side}_{finger}") for n in names), names
    # two contacts of one fingertip share its joints
    twice = own_joints(MODEL, ["right_thumb_tip", "right_thumb_tip", "left_thumb_tip"])
    assert (twice[0] == twice[1]).all() and twice[0].any()
    with pytest.raises(UnknownNameError):
        own_joints(MODEL, ["right_thumbtip"])


def test_arrows_are_as_long_as_their_forces_at_one_scale() -> None:
    make = maker()
    first, last = (make.of_row(ROWS, k) for k in (2, 6))
    per_newton = 0.10 / (0.4 * 9.81)
    for k, shot in ((2, first), (6, last)):
        found = poses(SCENE, shot)
        for i, name in enumerate(TIPS):
            pose, force = found[node("forces", name, "force")], ROWS.contact_force_plan[k, i]
            np.testing.assert_allclose(pose[:3, 3], ROWS.contact_points[k, i])
            np.testing.assert_allclose(pose[:3, 2], per_newton * force, atol=1e-12)
            np.testing.assert_allclose(np.linalg.norm(pose[:3, :2], axis=0), 1.0)
        weight, moment = (found[node("forces", n)] for n in ("weight", "weight_moment"))
        np.testing.assert_allclose(weight[:3, 2], (0.0, 0.0, -0.10), atol=1e-12)
        np.testing.assert_allclose(weight[:3, 3], PLACE + np.array([0.02, 0.0, 0.0]))
        # 0.02 m x (-0.4 g) about y, as long as its force at 5 cm
        np.testing.assert_allclose(moment[:3, 2], (0.0, 0.4 * 0.10, 0.0), atol=1e-12)
        np.testing.assert_allclose(found[node("forces", "resultant")][:3, 2], (0.0, 0.0, 0.10))
        resultant = found[node("forces", "resultant_moment")]
        assert length(resultant) == pytest.approx(per_newton * 0.05 / 0.05)


def test_a_free_finger_shows_neither_arrow_nor_cone() -> None:
    found = poses(SCENE, maker().of_row(ROWS, 0))
    for name in TIPS:
        for part in ("force", "cone"):
            assert not np.isfinite(found[node("forces", name, part)]).all(), "it is hidden"
    assert np.isfinite(found[node("forces", "weight")]).all()


@pytest.mark.parametrize(("size", "drawn"), [(0.0, 0.0), (0.3, 0.3), (50.0, 1.0), (1e300, 1.0)])
def test_no_arrow_is_longer_than_the_picture_needs(size: float, drawn: float) -> None:
    n = GRASP.count
    push = np.tile([0.0, size, 0.0], (n, 1))
    none, weight = np.zeros(3), np.array([0.0, 0.0, -np.inf, 0.0, 0.0, 0.0])
    arrows = ForceArrows(push, 0.5 * push, np.zeros(n, dtype=bool), none, weight, np.zeros(6), none)
    found = arrow_poses(SCENE, arrows, np.tile(np.eye(4), (n, 1, 1)))
    for name in SCENE.contact_names:
        assert length(np.nan_to_num(found["forces", name, "force"])) == pytest.approx(drawn)
    for part in ("weight", "weight_moment", "resultant"):  # infinite, or nothing
        assert not np.isfinite(found["forces", part][:3, 2]).any()


def test_cones_open_into_the_object_by_the_friction_angle() -> None:
    vertices, triangles = marks(SCENE)["forces", "r_thumb", "cone"].mesh
    assert volume(vertices, triangles) > 0.0
    rim = vertices[np.argmax(np.hypot(vertices[:, 0], vertices[:, 1]))]
    assert np.hypot(rim[0], rim[1]) == pytest.approx(-0.6 * rim[2]) and rim[2] < 0.0
    shot = maker().of_row(ROWS, 4)
    pose = poses(SCENE, shot)[node("forces", "r_thumb", "cone")]
    np.testing.assert_allclose(pose[:3, 2], ROWS.contact_normals[4, 0], atol=1e-12)
    assert np.isnan(poses(SCENE, shot)[node("contacts", "r_thumb", "normal")]).all()


@pytest.mark.parametrize("name", ["force", "weight_moment"])
def test_arrows_are_closed_and_of_unit_length(name: str) -> None:
    found = marks(SCENE)
    vertices, triangles = next(m.mesh for names, m in found.items() if names[-1] == name)
    assert volume(vertices, triangles) > 0.0
    assert (vertices[:, 2].min(), vertices[:, 2].max()) == (0.0, 1.0)


def test_an_arrow_turns_orange_where_a_joint_of_its_finger_is_at_its_limit() -> None:
    make = maker()
    for k, orange in ((2, set()), (3, {"r_index"}), (6, {"r_index"})):
        commands = moving_commands(SCENE, make.of_row(ROWS, k))
        for name in TIPS:
            command = commands[node("forces", name, "force"), "color"]
            want = LIMITED if name in orange else FORCE
            assert umsgpack.unpackb(command)["value"] == list(want)


def test_joints_without_limits_are_never_at_one() -> None:
    arrows = ArrowMaker(MODEL, list(TIPS.values()), [-np.inf] * NV, [np.inf] * NV)
    force = ROWS.contact_force_plan[3]
    made = arrows.planned(force, np.full(NV, np.inf), Load(0.0, PLACE, np.zeros(6)), PLACE)
    assert not made.limited.any()
    # without a weight the largest force is the measure
    assert np.linalg.norm(made.contact, axis=1).max() == pytest.approx(0.10)


def test_under_torques_measured_forces_stand_beside_the_planned_ones() -> None:
    """Without an optimizer the load is the body's weight, and what the planned forces sum up to."""
    rows = under_torques(MODEL, postures(MODEL, 7))
    inside = np.array([0.0, 0.03, 0.0])
    arrows = ArrowMaker(MODEL, list(TIPS.values()), [-LIMIT] * NV, [LIMIT] * NV, body=(0.4, inside))
    scene = replace(SCENE, measured=True)
    make = SnapshotMaker(MODEL, arrows=arrows)
    for k in (1, 3, 6):  # the second a touch, the last two at a limit
        shot = make.of_row(rows, k)
        found, commands = poses(scene, shot), moving_commands(scene, shot)
        touching = rows.contact_mode[k].any()
        for i, name in enumerate(TIPS):
            planned, measured = (found[node("forces", name, n)] for n in ("force", "measured"))
            assert np.isfinite(measured).all() == touching
            if touching:
                want = 0.10 / (0.4 * 9.81) * rows.contact_force_plan[k, i]
                np.testing.assert_allclose(planned[:3, 2], want, atol=1e-12)
                np.testing.assert_allclose(measured[:3, 2], 0.8 * want, atol=1e-12)
            tip = next(path for path, shape in tips(scene).items() if shape.finger == name)
            tight = k >= 3 and name == "r_index"
            for path, color in ((node("forces", name, "force"), FORCE),
                                (tip, STATES[rows.contact_mode[k, i]])):  # fmt: skip
                value = umsgpack.unpackb(commands[path, "color"])["value"]
                if tight:
                    assert value == list(LIMITED)
                elif touching:
                    assert value == list(color)
        turn = poses(scene, shot)[node("object")][:3, :3]
        weight = found[node("forces", "weight")]
        np.testing.assert_allclose(weight[:3, 3], PLACE + turn @ inside, atol=1e-12)
        np.testing.assert_allclose(weight[:3, 2], (0.0, 0.0, -0.10), atol=1e-12)
    total = rows.contact_force_plan[6].sum(axis=0)
    resultant = found[node("forces", "resultant")][:3, 2]
    np.testing.assert_allclose(resultant, 0.10 / (0.4 * 9.81) * total, atol=1e-12)


def test_each_colour_is_told_in_the_panel() -> None:
    told = [name for name, _ in panel_info(SCENE)["legend"]]
    assert told == ["planned", "torque limit", "friction cone", "weight", "resultant"]
    both = dict(panel_info(replace(SCENE, measured=True))["legend"])
    assert both["measured"] == "#9926bf" and both["planned"] == "#0d9933"
    assert panel_info(demo_scene())["legend"] == []


def test_a_limit_on_one_side_only_is_no_limit_everywhere() -> None:
    arrows = ArrowMaker(MODEL, list(TIPS.values()), [-LIMIT] * NV, [np.inf] * NV)
    force, points = ROWS.contact_force_plan[3], ROWS.contact_points[3]
    pose = ROWS.object_pose[3]
    assert not arrows.driven(force, force, np.full(NV, 0.4), points, pose).limited.any()


def test_verdicts_are_told() -> None:
    make = maker()
    assert make.of_row(ROWS, 2).status == ""
    assert "forces: infeasible torque limits" in make.of_row(ROWS, 6).status
    driven = under_torques(MODEL, postures(MODEL, 7))
    assert make.of_row(driven, 1).status == ""
    assert make.of_row(driven, 4).status == "torques: saturated, slowed"
    assert status_text(0, 1) == "", "a low margin is no trouble of the picture"


def test_geometry_goes_out_once_and_frames_are_small() -> None:
    made, shot = fixed_commands(SCENE), maker().of_row(ROWS, 4)
    drawn = {path for path, key in made if key == "object" and path.startswith("/wbc/forces")}
    assert len(drawn) == 2 * 6 + 4
    moving = moving_commands(SCENE, shot)
    assert not [key for key in moving if key[1] == "object"]
    size = sum(len(data) for (path, _), data in moving.items() if path.startswith("/wbc/forces"))
    assert size < 6000


def test_forces_pass_the_slot_and_do_without() -> None:
    layout = Layout.of(SCENE)
    fd = anonymous_file(layout.total_bytes)
    writer, reader = SlotWriter(fd, layout), SlotReader(fd, layout)
    os.close(fd)
    shot = maker().of_row(ROWS, 3)
    writer.write(shot)
    got = reader.read()
    assert got is not None and got.forces is not None and shot.forces is not None
    for name in ForceArrows._fields:
        np.testing.assert_array_equal(getattr(got.forces, name), getattr(shot.forces, name))
    writer.write(replace(shot, forces=None))
    got = reader.read()
    assert got is not None and got.forces is None
    found = poses(SCENE, got)
    assert np.isnan(found[node("forces", "weight")]).all()
    assert set(found) == set(poses(SCENE, shot)), "what is not there is hidden, not left standing"


def test_a_film_stretches_its_arrows_and_paints_them(tmp_path) -> None:
    make = maker()
    path = write_html(tmp_path / "run.html", SCENE, [make.of_row(ROWS, k) for k in range(7)])
    clips = {a["path"]: a["clip"]["tracks"] for a in animation_of(path)}
    tracks = {t["name"]: t for t in clips[node("forces", "r_thumb", "force")]}
    times, scale = (values(tracks[".scale"][key]) for key in ("times", "values"))
    scale = scale.reshape(-1, 3)
    touching = (times >= 1.0) & (times <= 3.0)
    want = 0.10 / (0.4 * 9.81) * (1.0 + times[touching])
    np.testing.assert_allclose(scale[touching, 2], want, rtol=1e-6)
    np.testing.assert_allclose(scale[:, :2], 1.0, rtol=1e-6)
    body = next(path for path in clips if path.startswith("/wbc/robot/"))
    assert ".scale" not in {t["name"] for t in clips[body]}
    (color,) = clips[node("forces", "r_index", "force") + "/<object>"]
    painted = values(color["values"]).reshape(-1, 3)
    np.testing.assert_allclose(painted[[0, -1]], [FORCE[:3], LIMITED[:3]], rtol=1e-6)


def test_a_scene_without_forces_is_as_before() -> None:
    scene, shot = demo_scene(), demo_snapshot(0.3)
    assert not [path for path, _ in fixed_commands(scene) if "forces" in path]
    assert not [path for path in poses(scene, shot) if "forces" in path]
    with pytest.raises(WbcError, match="1 friction angles for 2 contacts"):
        replace(scene, friction_angles=(0.5,))
