"""The dual-arm robot and its parts: current, readable by others, and physically possible."""

from __future__ import annotations

import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from lxml import etree
from scipy.optimize import least_squares

from wbc import resources
from wbc.robot.collision_scene import with_object
from wbc.robot.kinematics import Kinematics
from wbc.robot.model import load_robot
from wbc.robot.pruning import prune
from wbc.robot.srdf import disabled_pairs
from wbc.robot.urdf import load_urdf_text
from wbc.scenario.located import read_text

ROOT = Path(__file__).resolve().parents[2]
FIGURES: Any = read_text((ROOT / "urdf" / "dual_arm.yaml").read_bytes()).data
PARTS = ("torso", "lwr_arm", "dexmart_hand_right", "dexmart_hand_left")
ROBOTS = (*PARTS, "dual_arm")
FINGERS = ("thumb", "index", "middle", "ring", "little")
SIDES = ("right", "left")
BONES = ("abd", "prox", "med")
MIRROR = np.diag((1.0, -1.0, 1.0))


@cache
def _text(name: str) -> str:
    return load_urdf_text(resources.find("urdf", name))


@cache
def _model(name: str) -> Any:
    """Pinocchio's own model with coupled joints: a judge that shares nothing with ours."""
    return pin.buildModelFromXML(_text(name), mimic=True)


def _independent(model: Any) -> list[str]:
    """Joints with a coordinate of their own, in the order of q."""
    text = {e.get("name") for e in _tree("dual_arm").iterfind("joint") if e.find("mimic") is None}
    names = [n for n in list(model.names)[1:] if n in text or f"right_{n}" in text]
    return sorted(names, key=lambda n: int(model.joints[model.getJointId(n)].idx_q))


@cache
def _tree(name: str) -> etree._Element:
    return etree.fromstring(_text(name).encode("utf-8"))


def _draw(model: Any, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    return random.uniform(model.lowerPositionLimit, model.upperPositionLimit)


def _poses(model: Any, q: np.ndarray) -> dict[str, Any]:
    """Pose of every link in the root."""
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    bodies = [k for k, f in enumerate(model.frames) if f.type == pin.FrameType.BODY]
    return {model.frames[k].name: data.oMf[k].copy() for k in bodies}


def rest() -> np.ndarray:
    """The posture at rest of dual_arm.yaml, in the order of Pinocchio's model."""
    figures = FIGURES["rest"]
    joints = ("torso_yaw", "torso_pitch_1", "torso_pitch_2")
    values = dict(zip(joints, figures["torso"], strict=True))
    for side in SIDES:
        for k, angle in enumerate(figures["arm"]):
            values[f"{side}_arm_{k + 1}"] = -angle if side == "left" and k % 2 == 0 else angle
        for finger in FINGERS:
            angles = figures["thumb" if finger == "thumb" else "finger"]
            for bone, angle in zip(BONES, angles, strict=True):
                values[f"{side}_{finger}_{bone}"] = angle
    return np.radians([values[name] for name in _independent(_model("dual_arm"))])


def test_the_files_are_what_the_generator_writes() -> None:
    command = [sys.executable, str(ROOT / "urdf" / "generate.py"), "--check"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stdout) == (0, ""), done.stdout + done.stderr


@pytest.mark.parametrize(
    ("name", "count"), [("torso", 3), ("lwr_arm", 7), ("dexmart_hand_right", 15), ("dual_arm", 47)]
)
def test_independent_joints(name: str, count: int) -> None:
    model = _model(name)
    assert model.nq == model.nv == count == len(_independent(model))


def test_joints_are_named_as_documented() -> None:
    expected = {"torso_yaw", "torso_pitch_1", "torso_pitch_2"}
    for side in SIDES:
        expected |= {f"{side}_arm_{k}" for k in range(1, 8)}
        expected |= {f"{side}_{f}_{b}" for f in FINGERS for b in BONES}
    assert set(_independent(_model("dual_arm"))) == expected
    names = {e.get("name") for e in _tree("dual_arm").iterfind("joint")}
    followers = {f"{s}_{f}_dist" for s in SIDES for f in FINGERS} | {"chest_1", "chest_2"}
    assert expected | followers <= names
    links = {e.get("name") for e in _tree("dual_arm").iterfind("link")}
    assert {f"{s}_{f}_tip" for s in SIDES for f in FINGERS} | {"right_palm", "left_palm"} <= links


@pytest.mark.parametrize("name", ROBOTS)
def test_an_independent_reader_finds_every_frame_at_the_same_place(name: str) -> None:
    yourdfpy = pytest.importorskip("yourdfpy")
    other = yourdfpy.URDF.load(
        str(resources.find("urdf", name)), load_meshes=False, build_scene_graph=True
    )
    assert other.validate()
    model = _model(name)
    mine = _independent(model)
    assert sorted(other.actuated_joint_names) == sorted(mine)
    for seed in range(10):
        q = _draw(model, seed)
        at = dict(zip(mine, q, strict=True))
        other.update_cfg(np.array([at[n] for n in other.actuated_joint_names]))
        poses = _poses(model, q)
        assert set(poses) == set(other.link_map)
        for link, pose in poses.items():
            np.testing.assert_allclose(
                other.get_transform(link), pose.homogeneous, atol=1e-9, err_msg=link
            )


@pytest.mark.parametrize("name", ROBOTS)
def test_our_model_agrees_with_pinocchios_coupled_one(name: str) -> None:
    ours, judge = load_robot(resources.find("urdf", name)), _model(name)
    assert list(ours.joint_names) == _independent(judge)
    frames = tuple(_poses(judge, pin.neutral(judge)))
    kin = Kinematics(ours, frames)
    for seed in range(10):
        q = _draw(judge, seed)
        kin.update(q)
        for k, pose in enumerate(_poses(judge, q).values()):
            np.testing.assert_allclose(kin.position[k], pose.translation, atol=1e-12)
            np.testing.assert_allclose(kin.rotation[k], pose.rotation, atol=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
def test_followers_leave_their_leaders_the_whole_range(name: str) -> None:
    """A range of a follower that is narrower than its leader's would cut the leader's."""
    ours, judge = load_robot(resources.find("urdf", name)), _model(name)
    np.testing.assert_allclose(ours.lower, judge.lowerPositionLimit, atol=1e-11)
    np.testing.assert_allclose(ours.upper, judge.upperPositionLimit, atol=1e-11)
    np.testing.assert_allclose(ours.velocity, judge.velocityLimit, rtol=1e-11)


@pytest.mark.parametrize("seed", range(10))
def test_the_left_hand_is_the_right_one_in_a_mirror(seed: int) -> None:
    right, left = _model("dexmart_hand_right"), _model("dexmart_hand_left")
    assert list(right.names) == list(left.names)
    for name in ("lowerPositionLimit", "upperPositionLimit", "velocityLimit", "effortLimit"):
        np.testing.assert_array_equal(getattr(right, name), getattr(left, name))
    q = _draw(right, seed)
    there = _poses(left, q)
    for link, pose in _poses(right, q).items():
        np.testing.assert_allclose(MIRROR @ pose.translation, there[link].translation, atol=1e-12)
        turned = MIRROR @ pose.rotation @ MIRROR
        np.testing.assert_allclose(turned, there[link].rotation, atol=1e-12)
    for one, other in zip(right.inertias, left.inertias, strict=True):
        assert one.mass == other.mass
        np.testing.assert_allclose(MIRROR @ one.lever, other.lever, atol=1e-12)
        np.testing.assert_allclose(MIRROR @ one.inertia @ MIRROR, other.inertia, atol=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_both_sides_of_the_whole_robot_mirror_each_other(seed: int) -> None:
    """The arms are the same arm twice: mirrored postures have their odd joints reversed."""
    model = _model("dual_arm")
    names = _independent(model)
    q = _draw(model, seed)
    q[names.index("torso_yaw")] = 0.0
    for k, name in enumerate(names):
        if name.startswith("left"):
            q[k] = q[names.index(name.replace("left", "right"))]
            q[k] *= -1.0 if re.fullmatch(r"left_arm_[1357]", name) else 1.0
    poses = _poses(model, q)
    for link in [*(f"{f}_tip" for f in FINGERS), "palm", "arm_4_link", "arm_7_link"]:
        right, left = poses[f"right_{link}"], poses[f"left_{link}"]
        np.testing.assert_allclose(MIRROR @ right.translation, left.translation, atol=1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_the_chest_stays_upright(seed: int) -> None:
    model = _model("torso")
    q = _draw(model, seed)
    chest = _poses(model, q)["chest"]
    yaw = pin.utils.rotate("z", q[_independent(model).index("torso_yaw")])
    np.testing.assert_allclose(chest.rotation, yaw, atol=1e-12)


def _inertials(name: str) -> list[tuple[str, float, np.ndarray]]:
    rows = []
    for link in _tree(name).iterfind("link"):
        inertial = link.find("inertial")
        if inertial is not None:
            i = {k: float(v) for k, v in inertial.find("inertia").attrib.items()}
            matrix = np.array(
                [[i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]],
                 [i["ixz"], i["iyz"], i["izz"]]]
            )  # fmt: skip
            rows.append((link.get("name"), float(inertial.find("mass").get("value")), matrix))
    return rows


@pytest.mark.parametrize("name", ROBOTS)
def test_inertias_are_those_of_bodies(name: str) -> None:
    """Positive definite, triangle inequality, and a radius of gyration that fits the link."""
    for link, mass, inertia in _inertials(name):
        low, middle, high = np.linalg.eigvalsh(inertia)
        assert low > 0.0, link
        assert high <= (low + middle) * (1.0 + 1e-9), link
        assert 0.002 < np.sqrt(high / mass) < 0.13, link


def test_every_link_that_moves_has_a_mass_of_its_own() -> None:
    weighed = {link for link, _, _ in _inertials("dual_arm")}
    moved = {
        e.find("child").get("link")
        for e in _tree("dual_arm").iterfind("joint")
        if e.get("type") != "fixed"
    }
    assert moved <= weighed


@pytest.mark.parametrize(
    ("name", "kilograms"),
    [("torso", 34.0), ("lwr_arm", 13.625), ("dexmart_hand_left", 0.8), ("dual_arm", 62.85)],
)
def test_masses(name: str, kilograms: float) -> None:
    assert sum(mass for _, mass, _ in _inertials(name)) == pytest.approx(kilograms, abs=1e-9)


def test_dimensions_of_the_sources() -> None:
    arm = _poses(_model("lwr_arm"), np.zeros(7))
    heights = [arm[f"arm_{k}_link"].translation[2] for k in (2, 4, 6, 7)]
    np.testing.assert_allclose(heights, np.cumsum([0.3105, 0.400, 0.390, 0.078]), atol=1e-12)
    model = _model("torso")
    q = np.radians([0.0, -20.0, 40.0])
    chest = _poses(model, q)["chest"].translation
    np.testing.assert_allclose(chest, [0.0, 0.0, 0.1055 + 0.6 * np.cos(q[1])], atol=1e-12)
    shoulder = _poses(_model("dual_arm"), rest())
    place = shoulder["chest"].inverse() * shoulder["right_arm_2_link"]
    np.testing.assert_allclose(place.translation, [0.09, -0.2689, 0.15525], atol=1e-4)


@pytest.mark.parametrize("side", SIDES)
def test_palm_and_tip_frames(side: str) -> None:
    poses = _poses(_model("dual_arm"), rest())
    palm = poses[f"{side}_arm_7_link"].inverse() * poses[f"{side}_palm"]
    np.testing.assert_allclose(palm.translation, [0.0, 0.0, 0.1], atol=1e-12)
    np.testing.assert_allclose(palm.rotation[:, 0], [0.0, 0.0, 1.0], atol=1e-11)
    for finger in FINGERS:
        tip = poses[f"{side}_{finger}_dist_link"].inverse() * poses[f"{side}_{finger}_tip"]
        length = FIGURES["hand"]["fingers"][finger]["lengths"][3]
        assert tip.isApprox(pin.SE3(np.eye(3), np.array([length, 0.0, 0.0])), 1e-12)


@pytest.mark.parametrize(
    ("place", "inward"),
    [((0.62, 0.15, 0.60), 0.0), ((0.68, 0.20, 0.55), 0.0), ((0.65, 0.20, 0.55), 30.0)],
    ids=["hand over", "bottle", "turned inward"],
)
def test_both_palms_reach_in_front(place: tuple[float, float, float], inward: float) -> None:
    """Palms facing each other, within 97 % of the arms' ranges; the torso stays at rest."""
    model = _model("dual_arm")
    data, names = model.createData(), _independent(model)
    for side, sign in (("right", -1.0), ("left", 1.0)):
        arm = [names.index(f"{side}_arm_{k}") for k in range(1, 8)]
        # thumbs up, which is the right palm's y and against the left one's
        upright = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -sign], [0.0, sign, 0.0]]).T
        turned = pin.utils.rotate("z", -sign * np.radians(inward)) @ upright
        goal = pin.SE3(turned, np.array(place) * (1.0, sign, 1.0))
        frame = model.getFrameId(f"{side}_palm")

        def miss(angles: np.ndarray, arm=arm, goal=goal, frame=frame) -> np.ndarray:
            q = rest()
            q[arm] = angles
            pin.framesForwardKinematics(model, data, q)
            return np.asarray(pin.log6(goal.actInv(data.oMf[frame])).vector)

        limits = 0.97 * model.lowerPositionLimit[arm], 0.97 * model.upperPositionLimit[arm]
        found = least_squares(miss, rest()[arm], bounds=limits, xtol=1e-14, ftol=1e-14, gtol=1e-14)
        assert np.abs(found.fun).max() < 1e-6, side


def _capsules(link: str) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Centres of the caps in the link's frame, and the radius, of a link's capsules."""
    element = _tree("dual_arm").find(f"link[@name='{link}']")
    checked = {e.get("name") for e in element.iterfind("collision_checking/capsule")}
    rows = []
    for collision in element.iterfind("collision"):
        assert collision.get("name") in checked
        cylinder, origin = collision.find("geometry/cylinder"), collision.find("origin")
        xyz, rpy = (np.array(origin.get(k).split(), dtype=float) for k in ("xyz", "rpy"))
        half = 0.5 * float(cylinder.get("length")) * pin.rpy.rpyToMatrix(*rpy)[:, 2]
        rows.append((xyz - half, xyz + half, float(cylinder.get("radius"))))
    return rows


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("finger", FINGERS)
def test_a_fingertip_ends_where_it_touches(side: str, finger: str) -> None:
    """A tip frame on a surface leaves the last capsule outside it, and less than 1 mm away."""
    length = FIGURES["hand"]["fingers"][finger]["lengths"][3]
    ((start, end, radius),) = _capsules(f"{side}_{finger}_dist_link")
    np.testing.assert_allclose(start, 0.0, atol=1e-9)
    assert -1e-3 < end[0] + radius - length < 1e-9
    assert radius == pytest.approx(0.007 if finger == "thumb" else 0.006)


def test_all_moving_links_have_capsules_but_those_that_cannot() -> None:
    bare = {"chest_1_link", "right_arm_base", "left_arm_base"}
    for link in (e.get("name") for e in _tree("dual_arm").iterfind("link")):
        if not link.endswith("_tip"):
            assert bool(_capsules(link)) == (link not in bare), link


def _geometry(name: str) -> tuple[Any, list[str]]:
    """Collision shapes with every pair that does not ride on one joint or on neighbours."""
    model = _model(name)
    geometry = pin.buildGeomFromUrdfString(model, _text(name), pin.GeometryType.COLLISION)
    shapes = list(geometry.geometryObjects)
    for a, one in enumerate(shapes):
        for b, other in enumerate(shapes[:a]):
            i, j = one.parentJoint, other.parentJoint
            if i != j and model.parents[i] != j and model.parents[j] != i:
                geometry.addCollisionPair(pin.CollisionPair(b, a))
    return geometry, [str(model.frames[s.parentFrame].name) for s in shapes]


def _distances(model: Any, geometry: Any, q: np.ndarray) -> np.ndarray:
    data, results = model.createData(), geometry.createData()
    pin.updateGeometryPlacements(model, data, geometry, results, q)
    pin.computeDistances(geometry, results)
    return np.array([r.min_distance for r in results.distanceResults])


def test_at_rest_nothing_that_is_watched_touches() -> None:
    links = [e.get("name") for e in _tree("dual_arm").iterfind("link")]
    path = resources.find("urdf", "dual_arm").with_suffix(".srdf")
    off = {frozenset(pair) for pair in disabled_pairs(path, links)}
    geometry, names = _geometry("dual_arm")
    for pair in list(geometry.collisionPairs):
        if frozenset((names[pair.first], names[pair.second])) in off:
            geometry.removeCollisionPair(pair)
    distances = _distances(_model("dual_arm"), geometry, rest())
    nearest = geometry.collisionPairs[int(distances.argmin())]
    assert distances.min() > 0.005, (names[nearest.first], names[nearest.second])


def test_every_pair_that_overlaps_always_is_named() -> None:
    """What the samples would have to find is said in the SRDF, with its reason."""
    path = resources.find("urdf", "dual_arm")
    model, off = load_robot(path), disabled_pairs(path.with_suffix(".srdf"))
    report = prune(model, with_object(model, ())[0], margin=0.05, disabled=off)
    assert report.always == ()
    assert set(off) <= {(min(p), max(p)) for p in report.disabled}


def test_pairs_are_unwatched_for_the_reason_given() -> None:
    """Those that the limits keep apart never touch; the three others are told as they are."""
    named = {
        frozenset(p): set()
        for group in FIGURES["not_watched"]
        for p in group.get("sides", ())
        if p != ["palm", "thumb_prox_link"]
    }
    for robot, prefix in (("dexmart_hand_right", ""), ("dual_arm", "right_")):
        model = _model(robot)
        geometry, names = _geometry(robot)
        pairs = [
            frozenset(n.removeprefix(prefix) for n in (names[p.first], names[p.second]))
            for p in geometry.collisionPairs
        ]
        for k in range(150 if prefix else 600):
            random = np.random.default_rng(k)
            span = model.upperPositionLimit - model.lowerPositionLimit
            share = random.uniform(-0.4, 1.4, model.nq).clip(0.0, 1.0)  # the corners are likely
            found = _distances(model, geometry, model.lowerPositionLimit + share * span)
            for pair, distance in zip(pairs, found, strict=True):
                if pair in named:
                    named[pair].add(bool(distance > 0.0))
    for pair, apart in named.items():
        assert apart == {True}, pair
