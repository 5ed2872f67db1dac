"""A hand within a robot, and how near its own links come to each other."""

from __future__ import annotations

from functools import cache

import numpy as np
import pinocchio as pin
import pytest

from wbc import resources
from wbc.arrays import Array
from wbc.errors import WbcError
from wbc.robot.hand import Hand
from wbc.robot.model import RobotModel, load_robot
from wbc.robot.self_distances import self_distances
from wbc.synergies import Synergies, tables, weights_of

PUBLISHED = Synergies.from_table()


@cache
def robot(name: str) -> RobotModel:
    return load_robot(resources.find("urdf", name))


@cache
def hand() -> Hand:
    return Hand.of(robot("dexmart_hand_right"), PUBLISHED.joints)


def posture(**degrees: float) -> Array:
    values = [degrees.get(name, 0.0) for name in PUBLISHED.joints]
    return np.deg2rad([values])


def commanded() -> Array:
    t = tables()
    return PUBLISHED.command(np.array([weights_of(name) for name in t.names + t.new_names]))


def point_to_segment(p: Array, a: Array, b: Array) -> float:
    share = np.clip((p - a) @ (b - a) / max((b - a) @ (b - a), 1e-30), 0.0, 1.0)
    return float(np.linalg.norm(p - a - share * (b - a)))


def segment_to_segment(a: Array, b: Array, c: Array, d: Array) -> float:
    """The lines' common normal if it meets both segments, else the best of the four ends."""
    best = min(
        point_to_segment(a, c, d), point_to_segment(b, c, d),
        point_to_segment(c, a, b), point_to_segment(d, a, b),
    )  # fmt: skip
    (s, t), *_ = np.linalg.lstsq(np.column_stack((b - a, c - d)), c - a, rcond=None)
    if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
        best = min(best, float(np.linalg.norm(a + s * (b - a) - c - t * (d - c))))
    return best


def brute_force(row: Array) -> tuple[float, set[str]]:
    """All pairs of capsules but those of links with at most one link between them on a finger."""
    model = hand().model
    data, q = model.pin_model.createData(), np.zeros(model.nv)
    for name, value in zip(PUBLISHED.joints, row, strict=True):
        q[model.joint_names.index(name)] = value
    pin.forwardKinematics(model.pin_model, data, model.full(q))
    ends, order = {}, ("palm", "abd", "prox", "med", "dist")
    for o in model.geometry.geometryObjects:
        link, half = o.name.rpartition("_")[0].removesuffix("_link"), o.geometry.halfLength
        place = data.oMi[o.parentJoint] * o.placement
        points = [place.act(np.array((0.0, 0.0, z))) for z in (-half, half)]
        ends[o.name] = (link.rpartition("_"), points, o.geometry.radius)
    best, pair = np.inf, set()
    for one, (link, (a, b), r) in ends.items():
        for other, (link_2, (c, d), r_2) in ends.items():
            same = link[0] == link_2[0] or "palm" in (link[2], link_2[2])
            if same and abs(order.index(link[2]) - order.index(link_2[2])) <= 2:
                continue
            distance = segment_to_segment(a, b, c, d) - r - r_2
            if distance < best - 1e-9:
                best, pair = distance, {one.rpartition("_")[0], other.rpartition("_")[0]}
    return best, pair


def test_smallest_distance_and_its_links_are_those_of_all_capsules_one_by_one() -> None:
    postures = commanded()[[0, 9, 26, 31, 36]]
    for row, found in zip(postures, self_distances(hand(), postures), strict=True):
        distance, pair = brute_force(row)
        assert found.distance == pytest.approx(distance, abs=1e-9)
        assert {found.first, found.second} == pair


def test_no_published_grasp_makes_the_hand_collide_with_itself() -> None:
    rows = self_distances(hand(), commanded())
    assert len(rows) == 41
    least = min(rows)
    assert 0.0 < least.distance < 2e-3, "thumb and index of the lateral pinch C27 all but touch"
    assert rows.index(least) == tables().names.index("C27")
    assert {least.first, least.second} <= {
        "thumb_med_link", "thumb_dist_link", "index_med_link", "index_dist_link",
    }  # fmt: skip


def test_crossed_fingers_collide() -> None:
    (found,) = self_distances(hand(), posture(index_abd=-15.0, middle_abd=15.0))
    assert found.distance < -2e-3
    assert found.first.startswith("index_") and found.second.startswith("middle_")


def test_a_thumb_driven_into_the_index_collides() -> None:
    closed = PUBLISHED.command(weights_of("C27"))[None]
    closed[0, PUBLISHED.joints.index("thumb_med")] += np.deg2rad(15.0)
    (found,) = self_distances(hand(), closed)
    assert found.distance < 0.0
    assert {found.first.split("_")[0], found.second.split("_")[0]} == {"thumb", "index"}


@pytest.mark.parametrize("prefix", ["right_", "left_"])
def test_on_an_arm_a_hand_is_the_same(prefix: str) -> None:
    on_arm = Hand.of(robot("dual_arm"), PUBLISHED.joints, prefix)
    assert on_arm.links == {prefix + link for link in hand().links}
    postures = commanded()[:3]
    for alone, carried in zip(
        self_distances(hand(), postures), self_distances(on_arm, postures), strict=True
    ):
        assert carried.distance == pytest.approx(alone.distance, abs=1e-12)
    bodies = [on_arm.model.full_names.index(prefix + n) for n in hand().model.full_names]
    alone, carried = hand().poses(postures)[:, 1:], on_arm.poses(postures)[:, 1:][:, bodies]
    mirror = np.diag((1.0, 1.0 if prefix == "right_" else -1.0, 1.0, 1.0))
    np.testing.assert_allclose(carried[..., :3, 3], (mirror @ alone)[..., :3, 3], atol=1e-12)


def test_poses_are_seen_from_the_palm() -> None:
    straight = hand().poses(posture())[0]
    np.testing.assert_allclose(straight[0], np.eye(4), atol=1e-15)
    index = straight[1 + hand().model.full_names.index("index_prox")]
    np.testing.assert_allclose(index[:3, 3], (0.1, 0.04075, 0.0), atol=1e-12)


def test_joints_that_no_posture_names_stay_in_the_middle() -> None:
    model = robot("dexmart_hand_right")
    some = Hand.of(model, ("index_med", "index_prox"))
    assert str(model.pin_model.frames[some.palm].name) == "index_abd_link"
    assert "thumb_tip" not in some.links and "index_tip" in some.links
    (q,) = some.configurations(np.array([[0.5, 0.1]]))
    assert q[model.joint_names.index("index_med")] == 0.5
    assert q[model.joint_names.index("index_prox")] == 0.1
    k = model.joint_names.index("ring_prox")
    assert q[k] == 0.5 * (model.lower[k] + model.upper[k])


def test_without_a_pair_nothing_is_near() -> None:
    alone = Hand.of(robot("dexmart_hand_right"), ("index_med",))
    (row,) = self_distances(alone, np.zeros((1, 1)))
    assert row == (np.inf, "", "")


@pytest.mark.parametrize(
    ("joints", "prefix", "said"),
    [
        (("thumb_abd", "thumb_prox"), "right_", "no joint 'right_thumb_abd' and 1 more.*did you"),
        (("thumb_abd", "thumb_pros"), "", "no joint 'thumb_pros' .did you mean 'thumb_prox'"),
        (("thumb_dist",), "", "follows 'thumb_med'"),
    ],
)
def test_a_joint_that_is_not_there_is_one_line(
    joints: tuple[str, ...], prefix: str, said: str
) -> None:
    with pytest.raises(WbcError, match=said) as caught:
        Hand.of(robot("dexmart_hand_right"), joints, prefix)
    assert "\n" not in str(caught.value)
