"""Robots in space: where the camera stands, which shapes are fingertips, how objects are meshed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
import umsgpack

from wbc.contact.surfaces.box import Box
from wbc.contact.surfaces.cylinder import Cylinder
from wbc.contact.surfaces.sphere import Sphere
from wbc.contact.surfaces.superellipsoid import Superellipsoid
from wbc.control.state import Status
from wbc.view.creases import creased
from wbc.view.draw import FIXED, SLIDING, moving_commands, node, poses, shape_node
from wbc.view.from_robot import SnapshotMaker, object_shape, status_text
from wbc.view.panel import panel_info, panel_state

from .hands import PLACE, dual_arm, postures
from .test_drawing import assert_watertight, volume

MODEL, GRASP, SCENE = dual_arm()
ROWS = postures(MODEL, 7)


def snapshot(k: int):
    return SnapshotMaker(MODEL).of_row(ROWS, k)


def in_picture(point) -> np.ndarray:
    """Right and up of a point from the scene's centre, in extents of the camera."""
    towards = np.array(SCENE.towards) / np.linalg.norm(SCENE.towards)
    right = np.cross((0.0, 0.0, 1.0), towards)
    right /= np.linalg.norm(right)
    away = np.asarray(point) - SCENE.center
    return np.array((away @ right, away @ np.cross(towards, right))) / SCENE.extent


def test_the_camera_looks_back_at_the_robot_from_above() -> None:
    assert not SCENE.planar
    x, y, z = SCENE.towards
    assert x > abs(y) > 0.0 and y < 0.0, "in front of it, a little to its right"
    assert 0.3 < z < 0.5


def test_the_picture_holds_object_and_fingertips() -> None:
    data = MODEL.pin_model.createData()
    for k in (0, -1):
        pin.framesForwardKinematics(MODEL.pin_model, data, MODEL.full(postures(MODEL, 2).q[k]))
        for side in ("left", "right"):
            for finger in ("thumb", "index", "middle"):
                tip = data.oMf[MODEL.frame(f"{side}_{finger}_tip")].translation
                assert (np.abs(in_picture(tip)) < (1.2, 1.0)).all()
    assert (np.abs(in_picture(PLACE)) < 1.0).all()


def test_the_floor_is_below_the_base() -> None:
    assert SCENE.floor == pytest.approx(-0.02)


def test_the_pads_and_only_they_show_the_state() -> None:
    marked = [s for s in SCENE.shapes if s.finger is not None]
    assert {s.finger for s in marked} == set(GRASP.fingers)
    for shape in marked:
        side = {"r": "right", "l": "left"}[shape.finger[0]]
        assert shape.body == f"{side}_{shape.finger[2:]}_dist"
        assert shape.rgba == pytest.approx((0.96, 0.78, 0.66, 1.0)), "of the pad's material"


def test_colours_and_arrows_follow_the_contact() -> None:
    tip = next(s for s in SCENE.shapes if s.finger == "r_thumb")
    arrow, dot = (node("contacts", "r_thumb", part) for part in ("normal", "point"))
    for k, color in ((0, tip.rgba), (3, FIXED), (6, SLIDING)):
        commands = moving_commands(SCENE, snapshot(k))
        painted = umsgpack.unpackb(commands[shape_node(tip), "color"])["value"]
        assert painted == pytest.approx(list(color))
        assert umsgpack.unpackb(commands[arrow, "visible"])["value"] is (k > 0)
        assert umsgpack.unpackb(commands[dot, "visible"])["value"] is True
        if k:
            assert umsgpack.unpackb(commands[dot, "color"])["value"] == list(color)
    np.testing.assert_allclose(poses(SCENE, snapshot(3))[arrow][:3, 2], (0, 0, -1), atol=1e-15)


def test_the_panel_tells_error_distance_and_status() -> None:
    free, held = panel_state(snapshot(0)), panel_state(snapshot(6))
    assert free["err"] == [None, None] and free["con"] == [0] * 6 and free["status"] == ""
    assert held["err"] == [6e-6, 1.2e-5], "of the finger that is furthest off"
    assert held["dist"] == 0.012 and held["con"] == [2] * 6
    assert held["status"] == "slowed by limits"
    assert panel_state(replace(snapshot(0), distance=math.inf))["dist"] is None
    assert len(panel_info(SCENE)["colors"]) == 3


def test_every_status_has_words() -> None:
    for bit in Status:
        assert status_text(int(bit))
    assert status_text(0) == ""
    assert status_text(5) == "slowed by limits, near singular"


SURFACES = {
    "cylinder": (Cylinder(0.025, 0.3), 2 * 48, math.pi * 0.025**2 * 0.3),
    "box": (Box((0.1, 0.2, 0.3)), 8 * 2, 0.006),
    "sphere": (Sphere(0.04), 0, 4 / 3 * math.pi * 0.04**3),
    "superellipsoid": (Superellipsoid(0.03, 0.03, 0.1, 4.0), None, None),
}


@pytest.mark.parametrize(("surface", "more", "exact"), SURFACES.values(), ids=SURFACES)
def test_rims_are_split_and_nothing_else_changes(surface, more, exact) -> None:
    vertices, triangles = surface.mesh(48)
    split, faces = creased(vertices, triangles)
    np.testing.assert_array_equal(split[faces], vertices[triangles])
    if more is not None:
        assert len(split) == len(vertices) + more
    drawn = object_shape(surface, 0.01)
    assert_watertight(drawn.vertices, drawn.triangles)
    if exact is not None:
        assert volume(drawn.vertices, drawn.triangles) == pytest.approx(exact, rel=0.01)


def test_normals_at_a_rim_are_those_of_the_faces() -> None:
    vertices, triangles = creased(*Cylinder(0.025, 0.3).mesh(48))
    corners = vertices[triangles]
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    face /= np.linalg.norm(face, axis=1, keepdims=True)
    flat = np.abs(face[:, 2]) > 0.5
    assert not set(triangles[flat].ravel()) & set(triangles[~flat].ravel())


def test_the_start_can_be_shown_before_the_first_tick() -> None:
    maker = SnapshotMaker(MODEL)
    maker.text = "getting ready"
    start = maker.at_rest(ROWS.q[2], np.array((0.1, 0.2, 0.3)), np.eye(3), GRASP.count)
    np.testing.assert_allclose(start.bodies, snapshot(2).bodies, atol=1e-12)
    np.testing.assert_allclose(start.object_pose, (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0), atol=1e-12)
    assert np.isnan(start.contact_points).all() and len(start.contact_points) == GRASP.count
    assert start.text == "getting ready"
    assert panel_state(start)["phase"] == -1
