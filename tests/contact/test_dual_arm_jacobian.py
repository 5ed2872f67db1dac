"""J̃ of both hands on one object: six fingertips on the bottle, and all ten on a wider one.

The six are where the exchange ends its sliding; for the ten the hands were opened until every tip
was 5 mm outside a cylinder of 8 cm across. Angles are given to 1e-4 rad: a tip is up to 0.3 mm off,
and its pad as long as it is then, so that all fingers see the object in one place.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from conformance.test_extended_finger import jacobian_by_differences
from conformance.worlds import FIXED, FREE, SLIDING, World

from wbc.contact.classify import classify
from wbc.contact.extended_finger import ExtendedKinematics, extended_jacobian, finger_jacobians
from wbc.contact.grasp import ContactMode, ContactState, Grasp, GraspClass, ObjectReference
from wbc.contact.surfaces.cylinder import SIDE, Cylinder
from wbc.resources import find
from wbc.robot.kinematics import Kinematics
from wbc.robot.model import RobotModel, load_robot
from wbc.rotations import exp_so3

FINGERS = ("thumb", "index", "middle", "ring", "little")
SIX = {
    "torso": (0.1243, -0.3379, 0.8130),
    "right_arm": (0.6823, -0.8295, -0.9789, 1.6030, 0.0391, -1.0445, 1.1010),
    "right_thumb": (-0.2878, 0.4590, 1.0976),
    "right_index": (-0.2420, 0.1291, 1.0224),
    "right_middle": (-0.1462, 0.5421, 0.9717),
    "right_ring": (-0.1047, 0.8203, 0.6981),
    "right_little": (0.0, 0.6458, 0.6981),
    "left_arm": (-0.5410, -0.7993, 0.7519, 1.6323, -0.0159, -1.1568, -1.3789),
    "left_thumb": (-0.2488, 0.4787, 1.1997),
    "left_index": (-0.2022, 0.0732, 1.0689),
    "left_middle": (-0.0918, 0.5432, 0.8511),
    "left_ring": (-0.1047, 0.8552, 0.6981),
    "left_little": (0.0, 0.6283, 0.6981),
}
TEN = {
    "torso": (0.1439, -0.2539, 0.8682),
    "right_arm": (0.7412, -0.9297, -0.9000, 1.6223, -0.0562, -1.0636, 0.9856),
    "right_thumb": (-0.2779, 0.5097, 1.1226),
    "right_index": (-0.2418, 0.2297, 1.0801),
    "right_middle": (-0.1422, 0.4073, 0.8548),
    "right_ring": (-0.1369, 0.7390, 0.6154),
    "right_little": (0.0761, 0.7025, 0.8050),
    "left_arm": (-0.5635, -0.8790, 0.6996, 1.6505, 0.0189, -1.1594, -1.3282),
    "left_thumb": (-0.2541, 0.4576, 1.1918),
    "left_index": (-0.2418, 0.1567, 1.1137),
    "left_middle": (-0.0948, 0.4483, 0.7706),
    "left_ring": (-0.1479, 0.7492, 0.5900),
    "left_little": (0.0577, 0.6776, 0.7783),
}
PARTS = {"torso": ("torso_yaw", "torso_pitch_1", "torso_pitch_2")}
PARTS |= {f"{s}_arm": tuple(f"{s}_arm_{k}" for k in range(1, 8)) for s in ("right", "left")}
PARTS |= {
    f"{s}_{f}": tuple(f"{s}_{f}_{bone}" for bone in ("abd", "prox", "med"))
    for s in ("right", "left")
    for f in FINGERS
}
PLACE = np.array([0.62, 0.05, 0.65])
ACROSS = exp_so3(np.array([0.0, 0.0, 0.3])) @ exp_so3(np.array([-0.5 * np.pi, 0.0, 0.0]))
GRASPS = {6: (SIX, 3, Cylinder(0.025, 0.28)), 10: (TEN, 5, Cylinder(0.04, 0.30))}


@cache
def dual_arm() -> RobotModel:
    return load_robot(find("urdf", "dual_arm"))


def world(contacts: int, right: ContactMode, left: ContactMode) -> World:
    """The grasp with so many fingertips, all of a hand touching in one way."""
    angles, each, surface = GRASPS[contacts]
    model = dual_arm()
    at = {j: q for part, names in PARTS.items() for j, q in zip(names, angles[part], strict=True)}
    q = np.array([at[joint] for joint in model.joint_names])
    tips = tuple(f"{s}_{f}_tip" for s in ("right", "left") for f in FINGERS[:each])
    kin = Kinematics(model, tips).update(q)
    x, y, z = ((kin.position - PLACE) @ ACROSS).T
    xi, pads = np.column_stack((np.arctan2(y, x), z)), np.hypot(x, y) - surface.radius
    assert np.abs(pads - 0.005).max() < 3e-4, "the tips have left the surface"
    assert all(surface.margin(contact, SIDE) > 0.0 for contact in xi)
    one, face = np.ones(contacts), np.full(contacts, SIDE, dtype=np.int64)
    grasp = Grasp(surface, tips, xi, face, 5e4 * one, pads, one, False)
    extended = ExtendedKinematics(kin, grasp, 20.0)
    reference = ObjectReference(PLACE, ACROSS, np.zeros(6), pads, np.zeros(contacts))
    state = ContactState.planned(grasp, np.full(contacts, FREE, dtype=np.int64))
    extended.update(q, state, reference)
    pivot = np.array([extended.touch(i) for i in range(contacts)])
    mode = np.repeat(np.array([right, left], dtype=np.int64), each)
    return World("dual_arm", extended, q, state._replace(mode=mode, pivot=pivot), reference)


def kind(situation: World) -> GraspClass:
    return classify(situation.update())


CONTACTS = pytest.mark.parametrize("contacts", GRASPS)
TOUCH = pytest.mark.parametrize(
    ("right", "left"),
    [(FIXED, FIXED), (FIXED, SLIDING), (SLIDING, SLIDING)],
    ids=["all pivot", "left slides", "all slide"],
)


@CONTACTS
@TOUCH
def test_the_object_is_where_every_finger_sees_it(contacts, right, left):
    kin = world(contacts, right, left).update()
    assert kin.holding == contacts
    np.testing.assert_allclose(kin.position, np.tile(PLACE, (contacts, 1)), atol=1e-12)
    np.testing.assert_allclose(kin.rotation, np.tile(ACROSS, (contacts, 1, 1)), atol=1e-12)


@CONTACTS
@TOUCH
def test_full_row_rank_and_condition(contacts, right, left):
    grasp = kind(world(contacts, right, left))
    print(f"{contacts} contacts: J̃ {grasp.rows} x {grasp.columns}, condition {grasp.condition:.0f}")
    assert grasp.rank == grasp.rows == 6 * contacts
    assert grasp.condition < 500.0


@CONTACTS
@TOUCH
def test_the_jacobian_is_the_derivative_of_the_chains(contacts, right, left):
    situation = world(contacts, right, left)
    j, _ = extended_jacobian(situation.update())
    gap = np.abs(j - jacobian_by_differences(situation)).max()
    print(f"{contacts} contacts: J̃ differs by {gap:.1e}")
    assert gap < 1e-7


def test_every_finger_has_joints_to_spare():
    """Torso, arm and finger: 13 joints and 3 pivots for 6 rows."""
    for contacts in GRASPS:
        grasp = kind(world(contacts, FIXED, FIXED))
        assert len(grasp.redundant_fingers) == contacts


def held(situation: World, *touching: int) -> GraspClass:
    """The grasp of some of the fingers alone."""
    mode = np.full(situation.grasp.count, FREE, dtype=np.int64)
    mode[list(touching)] = situation.state.mode[list(touching)]
    state = situation.state._replace(mode=mode)
    return classify(situation.kin.update(situation.q, state, situation.reference))


def test_what_the_hands_leave_free():
    pivoting = world(6, FIXED, FIXED)
    assert held(pivoting, 0).free_motions == 3, "one tip: turns about it"
    assert held(pivoting, 0, 1).free_motions == 1, "a pinch: turns about the line of both tips"
    assert held(pivoting, 0, 3).free_motions == 1, "one finger of each hand is a pinch as well"
    assert held(pivoting, 0, 1, 2).free_motions == 0
    assert held(pivoting, *range(6)).free_motions == 0
    assert held(world(6, FIXED, SLIDING), *range(6)).free_motions == 0


@CONTACTS
def test_fingers_that_all_slide_on_its_side_leave_a_cylinder_its_axis(contacts):
    """However many they are, it turns and slides along it."""
    grasp = kind(world(contacts, SLIDING, SLIDING))
    assert grasp.indeterminate and grasp.free_motions == 2


def test_a_pinch_turns_about_the_line_of_both_tips():
    """That motion moves neither tip, and `free_motions` says that there is no other."""
    kin = world(6, FIXED, FIXED).update()
    first, second = kin.robot.position[:2]
    axis = (second - first) / np.linalg.norm(second - first)
    motion = np.concatenate([np.cross(axis, PLACE - first), axis])
    still = [np.linalg.norm((finger_jacobians(kin, i)[4] @ motion)[:3]) for i in range(3)]
    assert max(still[:2]) < 1e-12 and still[2] > 1e-2


def test_the_balanced_grasp_is_closed_by_next_to_no_friction():
    """Each hand alone as well; the ten were not balanced and need some."""
    pivoting = world(6, FIXED, FIXED)
    for fingers in (range(6), range(3), range(3, 6)):
        assert held(pivoting, *fingers).friction_needed < 1e-3
    needed = kind(world(10, FIXED, FIXED)).friction_needed
    print(f"ten contacts need a friction of {needed:.2f}")
    assert 0.0 < needed < 0.3
