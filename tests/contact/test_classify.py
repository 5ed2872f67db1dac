"""Classification after (33) and force closure, on grasps whose kind is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conformance.robots import SETTINGS, robot
from conformance.worlds import FIXED, FREE, SLIDING, make_world

from wbc.contact.classify import classify, friction_needed
from wbc.contact.extended_finger import extended_jacobian
from wbc.contact.surfaces.circle import Circle
from wbc.contact.surfaces.fourier_contour import FourierContour
from wbc.contact.surfaces.sphere import Sphere
from wbc.rotations import exp_so3


def planar_grasp(modes, place="random"):
    """The two planar grippers' four tips, in the given modes."""
    return classify(make_world("planar", modes=modes, place=place).update())


def spatial_grasp(modes, place="random"):
    """The small hand: an arm of five joints and two fingers of three."""
    return classify(make_world("hand", modes=modes, place=place).update())


# ---- kinematics ---------------------------------------------------------------------------------


def test_one_pivoting_finger_lets_a_planar_object_spin():
    grasp = planar_grasp((FIXED, FREE, FREE, FREE))
    assert grasp.fingers == ("left_tip_a",)
    assert (grasp.rows, grasp.columns) == (3, 14 + 1)
    assert grasp.indeterminate and grasp.free_motions == 1


def test_one_sliding_finger_leaves_a_planar_object_one_motion_more():
    assert planar_grasp((SLIDING, FREE, FREE, FREE)).free_motions == 2


def test_two_pivoting_fingers_hold_a_planar_object():
    grasp = planar_grasp((FIXED, FIXED, FREE, FREE))
    assert not grasp.indeterminate and grasp.free_motions == 0


def test_two_sliding_fingers_leave_a_planar_object_one_motion():
    assert planar_grasp((SLIDING, SLIDING, FREE, FREE)).free_motions == 1
    assert planar_grasp((SLIDING, SLIDING, SLIDING, FREE)).free_motions == 0


@pytest.mark.parametrize(
    ("modes", "motions"),
    [
        ((FIXED, FREE), 3),  # turns about the tip
        ((SLIDING, FREE), 5),  # and slides on the surface under it
        ((FIXED, FIXED), 1),  # spins about the line through both tips
        ((FIXED, SLIDING), 2),
        ((SLIDING, SLIDING), 4),
        ((FREE, FREE), 6),
    ],
)
def test_what_two_fingers_leave_free_in_space(modes, motions):
    assert spatial_grasp(modes).free_motions == motions


def test_three_pivoting_fingers_hold_an_object_in_space(three_fingers):
    grasp = three_fingers((FIXED, FIXED, FIXED))
    assert not grasp.indeterminate
    assert grasp.rows == 18
    assert three_fingers((FIXED, FIXED, SLIDING)).free_motions == 0
    assert three_fingers((FIXED, SLIDING, SLIDING)).free_motions == 1
    assert three_fingers((SLIDING, SLIDING, SLIDING)).free_motions == 3


@pytest.fixture
def three_fingers():
    """The hand with its palm as a third fingertip."""
    from dataclasses import replace

    from wbc.contact.extended_finger import ExtendedKinematics
    from wbc.robot.kinematics import Kinematics

    def classified(modes):
        world = make_world("hand", modes=FREE)
        tips = (*SETTINGS["hand"].tips, "palm")
        two, xi = world.grasp, np.array([0.3, -0.2])
        grasp = replace(
            two, fingers=tips, at=np.vstack((two.at, xi)), face=np.append(two.face, 0),
            stiffness=np.full(3, 5e4), rest_length=np.full(3, 0.005), share=np.ones(3),
        )  # fmt: skip
        kin = ExtendedKinematics(Kinematics(robot("hand"), tips), grasp, 50.0)
        state = world.state._replace(
            mode=np.array(modes, dtype=np.int64),
            xi=grasp.at.copy(),
            face=grasp.face.copy(),
            pivot=np.stack([exp_so3(np.array([0.3 * k, 0.2, -0.1])) for k in range(3)]),
            shift=np.zeros((3, 3)),
        )
        reference = world.reference._replace(reach=grasp.rest_length, reach_rate=np.zeros(3))
        return classify(kin.update(world.q, state, reference))

    return classified


def test_redundancy_counts_the_fingers_own_joints():
    # planar: 5 joints and a pivot for 3 rows; in space 8 joints and 3 pivots for 6 rows
    assert planar_grasp((FIXED, FIXED, FREE, FIXED)).redundant_fingers == (
        "left_tip_a", "left_tip_b", "right_tip_b"
    )  # fmt: skip
    assert spatial_grasp((FIXED, SLIDING)).redundant


def test_a_finger_with_as_many_joints_as_rows_is_not_redundant(short_finger):
    """A planar finger of two joints and a pivot: three variables, three rows."""

    def touching(mode, elbow):
        return short_finger(mode, Circle(0.2), (math.pi, 0.0), "zz", (0.4, elbow))

    assert touching(FIXED, 0.9).redundant_fingers == ()
    assert touching(SLIDING, 0.9).redundant_fingers == ("tip",)
    assert touching(FIXED, 0.0).redundant_fingers == ("tip",), "a stretched chain"


@pytest.mark.parametrize(
    ("joints", "mode", "towards", "redundant"),
    [
        (1, FIXED, "ahead", False),  # 1 joint, 3 pivots
        (1, SLIDING, "ahead", False),  # and 2 chart coordinates: as many as rows
        (1, SLIDING, "beside", True),  # the joint moves the tip along the surface: it can go on
        (3, FIXED, "ahead", False),
        (3, SLIDING, "ahead", True),
    ],
)
def test_redundancy_of_a_finger_in_space(short_finger, joints, mode, towards, redundant):
    """Six rows; the first joint moves the tip along y, where the object is ahead of it."""
    surface = Sphere(0.2)
    at = (math.pi / 2, 0.0) if towards == "ahead" else (0.0, 0.0)
    axes, q = ("z", "y", "y")[:joints], (0.0, 0.4, -0.9)[:joints]
    grasp = short_finger(mode, surface, at, axes, q)
    assert grasp.redundant_fingers == (("tip",) if redundant else ())
    assert grasp.indeterminate, "one tip holds nothing"


@pytest.fixture
def short_finger(tmp_path):
    """A chain of links of 1 m along x that touches a surface which is not turned."""
    from wbc.contact.extended_finger import ExtendedKinematics
    from wbc.contact.grasp import ContactState, Grasp, ObjectReference
    from wbc.robot.kinematics import Kinematics
    from wbc.robot.model import load_robot

    inertial = (
        '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" '
        'iyz="0"/></inertial>'
    )
    axis = {"y": "0 1 0", "z": "0 0 1"}

    def written(axes):
        rows, parent, ahead = ['<robot name="arm"><link name="base"/>'], "base", 0
        for k, name in enumerate(axes):
            rows.append(
                f'<link name="link_{k}">{inertial}</link><joint name="joint_{k}" type="revolute">'
                f'<parent link="{parent}"/><child link="link_{k}"/><origin xyz="{ahead} 0 0"/>'
                f'<axis xyz="{axis[name]}"/><limit lower="-2" upper="2" effort="1" velocity="1"/>'
                "</joint>"
            )
            parent, ahead = f"link_{k}", 1
        rows.append(
            f'<link name="tip"/><joint name="end" type="fixed"><parent link="{parent}"/>'
            '<child link="tip"/><origin xyz="1 0 0"/></joint></robot>'
        )
        path = tmp_path / f"{len(axes)}_{axes[-1]}.urdf"
        path.write_text("\n".join(rows))
        return path

    def classified(mode, surface, at, axes, q):
        one = np.ones(1)
        grasp = Grasp(
            surface, ("tip",), np.array([at]), np.zeros(1, dtype=np.int64),
            5e4 * one, 0.005 * one, one, surface.planar,
        )  # fmt: skip
        robot = load_robot(written(axes))
        kin = ExtendedKinematics(Kinematics(robot, ("tip",)), grasp, 50.0)
        state = ContactState.planned(grasp, np.array([mode], dtype=np.int64))
        place = ObjectReference(np.zeros(3), np.eye(3), np.zeros(6), 0.005 * one, np.zeros(1))
        q = np.array(q)
        kin.update(q, state._replace(mode=np.zeros(1, dtype=np.int64)), place)
        return classify(kin.update(q, state._replace(pivot=kin.touch(0)[None]), place))

    return classified


@pytest.mark.parametrize("name", ["planar", "hand"])
@pytest.mark.parametrize("place", ["random", "limits", "stretched"])
def test_rank_and_singular_values_are_those_of_the_jacobian(name, place):
    """Columns of variables that a contact holds do not count: they are zero and change no rank."""
    world = make_world(name, modes=FIXED, place=place)
    kin = world.update()
    grasp = classify(kin)
    jacobian = extended_jacobian(kin)[0]
    singular = np.linalg.svd(jacobian, compute_uv=False)
    assert grasp.rows == jacobian.shape[0]
    assert grasp.smallest_singular_value == pytest.approx(singular[-1], rel=1e-9)
    assert grasp.condition == pytest.approx(singular[0] / singular[-1], rel=1e-6)
    assert grasp.rank == np.linalg.matrix_rank(jacobian, tol=1e-9 * singular[0])


def test_no_contact_is_no_grasp():
    grasp = planar_grasp(FREE)
    assert (grasp.fingers, grasp.rows, grasp.rank) == ((), 0, 0)
    assert grasp.free_motions == 3
    assert not grasp.redundant and not grasp.force_closed(1.0)
    assert grasp.residuals == (0.0, 0.0)


# ---- force closure ------------------------------------------------------------------------------


def ring(*degrees: float, tilt: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Contacts on the unit circle at the given angles; normals turned by `tilt` degrees."""
    angle = np.deg2rad(degrees)
    points = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(len(angle))))
    turned = angle + math.radians(tilt)
    return points, np.column_stack((np.cos(turned), np.sin(turned), np.zeros(len(angle))))


def test_opposed_fingers_need_no_more_than_any_friction():
    assert friction_needed(*ring(0, 180), planar=True) == 0.0
    assert friction_needed(*ring(90, 210, 330), planar=True) == 0.0


def test_the_settled_exchange_is_force_closed_with_any_friction():
    """Two double normals of the waisted contour, as fingers 3 and 4 find them."""
    surface = FourierContour(a=0.5, b=0.36, h=0.06)
    for u in (60.0, 120.0):
        xi = np.deg2rad([[u, 0.0], [-u, 0.0]])
        chart = surface.charts(xi)
        normal = np.cross(chart[:, 1], chart[:, 2])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        assert friction_needed(chart[:, 0], normal, planar=True) == 0.0


@pytest.mark.parametrize("short", [5.0, 20.0, 45.0, 70.0])
def test_two_planar_fingers_need_the_friction_of_their_line(short):
    """Closed when the line through both points lies in both cones (Nguyen): atan μ > short / 2."""
    needed = friction_needed(*ring(0.0, 180.0 - short), planar=True)
    assert needed == pytest.approx(math.tan(math.radians(short / 2.0)), rel=1e-4)


@pytest.mark.parametrize("tilt", [3.0, 12.0, 30.0])
def test_three_fingers_with_their_normals_turned(tilt):
    """Symmetry makes the least friction that which turns every force back to the centre."""
    needed = friction_needed(*ring(90, 210, 330, tilt=tilt), planar=True)
    assert 0.0 < needed <= math.tan(math.radians(tilt)) * (1 + 1e-4)


def test_pushing_from_one_side_never_closes():
    assert friction_needed(*ring(0, 10, 20), planar=True) > 5.0
    points = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    normals = np.tile([0.0, 1.0, 0.0], (3, 1))
    assert friction_needed(points, normals, planar=True) == math.inf
    assert friction_needed(points[:1], normals[:1], planar=True) == math.inf


def test_two_point_contacts_in_space_leave_the_spin_about_their_line():
    assert friction_needed(*ring(0, 180), planar=False) == math.inf


def test_three_point_contacts_in_space():
    assert friction_needed(*ring(90, 210, 330), planar=False) == 0.0
    turned = ring(90, 200, 340, tilt=10.0)
    needed, exact = (friction_needed(*turned, planar=p) for p in (False, True))
    assert 0.05 < exact <= needed <= 1.01 * exact, "the pyramid lies inside the cone"


def test_a_triangle_below_the_equator_needs_friction():
    """Normals that all point partly down: only friction keeps the object from leaving upwards."""
    latitude = math.radians(-15.0)
    points, normals = ring(90, 210, 330)
    normals = normals * math.cos(latitude) + np.array([0.0, 0.0, math.sin(latitude)])
    points = normals.copy()
    needed = friction_needed(points, normals, planar=False)
    # the fingers push up by sin 15° and in by cos 15°: friction must take the upward part back
    assert needed == pytest.approx(math.tan(-latitude), rel=0.02)


@pytest.mark.parametrize("planar", [True, False])
def test_closure_depends_on_neither_place_nor_unit(planar):
    points, normals = ring(85, 200, 340, tilt=10.0)
    turn = exp_so3(np.array([0.0, 0.0, 1.1] if planar else [0.4, -0.7, 1.1]))
    shift = np.array([3.0, -2.0, 0.0])
    first = friction_needed(points, normals, planar=planar)
    moved = friction_needed(1e-3 * points @ turn.T + shift, normals @ turn.T, planar=planar)
    assert 0.0 < first < math.inf
    assert moved == pytest.approx(first, rel=0.02)


def test_a_given_friction_decides():
    kin = make_world("planar", modes=(FIXED, FIXED, FREE, FREE)).update()
    grasp = classify(kin)._replace(friction_needed=0.3)
    assert grasp.force_closed(0.4) and not grasp.force_closed(0.2) and not grasp.force_closed()
    assert classify(kin)._replace(friction_needed=0.0).force_closed()
