"""Joints that follow others, against Pinocchio's own mimic joints and finite differences."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from wbc import resources
from wbc.errors import UrdfError, WbcError
from wbc.robot.collision_scene import collision_scene, with_object
from wbc.robot.distances import Distances
from wbc.robot.kinematics import Kinematics
from wbc.robot.model import RobotModel, load_robot
from wbc.rotations import log_so3
from wbc.tasks.manipulability import manipulability_gradient

STEP = 1e-6
Mimic = tuple[str, float, float]


def urdf(
    joints: list[tuple[str, str, str, str, str]], mimics: dict[str, Mimic], wide: float = 40.0
) -> str:
    """Links that carry capsules; each joint is (name, parent's name, kind, axis, placement)."""
    text = '<robot name="r">\n<link name="base"/>\n'
    for k, (name, parent, kind, axis, origin) in enumerate(joints):
        follows = ""
        if name in mimics:
            leader, multiplier, offset = mimics[name]
            follows = f'<mimic joint="{leader}" multiplier="{multiplier!r}" offset="{offset!r}"/>'
        # the masters' limits are the closest: those of the followers leave room
        bound = wide if follows else 1.0
        above = "base" if parent == "" else f"{parent}_link"
        text += f"""<link name="{name}_link"><inertial><origin xyz="0.05 0.01 -0.02"/>
<mass value="{1.0 + 0.1 * k}"/>
<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial>
<collision><origin xyz="0.08 0 0" rpy="0 1.57 0"/>
<geometry><sphere radius="0.02"/></geometry></collision></link>
<joint name="{name}" type="{kind}"><parent link="{above}"/><child link="{name}_link"/>
<origin {origin}/><axis xyz="{axis}"/>{follows}
<limit lower="-{bound}" upper="{bound}" effort="{k + 1}" velocity="{bound}"/></joint>\n"""
    return text + "</robot>"


HAND = [
    ("a1", "", "revolute", "0 0 1", 'xyz="0.1 0 0.2" rpy="0.1 0.2 0.3"'),
    ("a2", "a1", "revolute", "0 1 0", 'xyz="0.2 0.01 0"'),
    ("a3", "a2", "revolute", "0.1 1 0.2", 'xyz="0.1 0 0.03"'),
    ("a4", "a3", "revolute", "0 1 0", 'xyz="0.09 0.02 0" rpy="0.3 0 0.1"'),
    ("b1", "a1", "prismatic", "1 0.3 0", 'xyz="0.1 0.1 0" rpy="0.5 0 0"'),
    ("b2", "b1", "revolute", "0 0.6 0.8", 'xyz="0.1 0 0.02"'),
    ("b3", "b2", "prismatic", "0 1 0.2", 'xyz="0.15 0 0" rpy="0 0.4 0"'),
]
# a3 and a4 as one mimics the other; b1 leads what comes before it in the file, but not in the tree
CHAINED: dict[str, Mimic] = {
    "a3": ("a2", -0.7, 0.2),
    "a4": ("a3", 0.5, -0.1),
    "b1": ("a2", 0.08, 0.01),
    "b3": ("b2", -0.05, 0.02),
}
FLAT: dict[str, Mimic] = {**CHAINED, "a4": ("a2", 0.5 * -0.7, 0.5 * 0.2 - 0.1)}


def loaded(folder: Path, text: str) -> RobotModel:
    path = folder / "r.urdf"
    path.write_text(text)
    return load_robot(path)


@pytest.fixture
def hand(tmp_path: Path) -> RobotModel:
    return loaded(tmp_path, urdf(HAND, CHAINED))


def frames_of(model: RobotModel) -> tuple[str, ...]:
    return tuple(f.name for f in model.pin_model.frames if "BODY" in str(f.type))


def difference(function: Callable[[np.ndarray], np.ndarray], q: np.ndarray) -> np.ndarray:
    """∂function/∂q by central differences, the last axis by q."""
    steps = STEP * np.eye(len(q))
    columns = [(np.array(function(q + s)) - np.array(function(q - s))) / (2 * STEP) for s in steps]
    return np.stack(columns, axis=-1)


def same_as_oracle(model: RobotModel, oracle_text: str, q: np.ndarray) -> None:
    """Every frame, its Jacobians and the centre of mass as Pinocchio's mimic joints have them."""
    oracle = pin.buildModelFromXML(oracle_text, mimic=True)
    kinds = [joint.shortname() for joint in oracle.joints]
    free = [str(n) for n, kind in zip(oracle.names, kinds, strict=True) if "Mimic" not in kind]
    assert tuple(free[1:]) == model.joint_names
    kin = Kinematics(model, frames_of(model), track_com=True).update(q)
    data = oracle.createData()
    pin.framesForwardKinematics(oracle, data, q)
    pin.computeJointJacobians(oracle, data, q)
    for f, name in enumerate(kin.frames):
        k = oracle.getFrameId(name)
        assert_allclose(kin.position[f], data.oMf[k].translation, atol=1e-13)
        assert_allclose(kin.rotation[f], data.oMf[k].rotation, atol=1e-13)
        expected = pin.computeFrameJacobian(oracle, data, q, k, pin.LOCAL_WORLD_ALIGNED)
        assert_allclose(np.vstack([kin.linear[f], kin.angular[f]]), expected, atol=1e-13)
    expected = pin.jacobianCenterOfMass(oracle, data, q)
    assert_allclose(kin.com_jacobian, expected, atol=1e-13)
    assert_allclose(kin.com, data.com[0], atol=1e-13)


def test_all_is_as_with_pinocchios_mimic_joints(hand: RobotModel) -> None:
    """Which must have their masters named directly, and before them in the tree."""
    random = np.random.default_rng(0)
    for _ in range(5):
        same_as_oracle(hand, urdf(HAND, FLAT), random.uniform(-1.0, 1.0, hand.nv))


def random_robot(random: np.random.Generator) -> tuple[str, str]:
    """A tree of 3 to 12 joints, some of which follow others; and the same with no chains."""
    count = int(random.integers(3, 13))
    joints, mimics = [], {}
    flat: dict[str, Mimic] = {}
    for k in range(count):
        parent = "" if k == 0 else f"j{max(0, k - 1 - int(random.random() < 0.3)):02d}"
        kind = "prismatic" if random.random() < 0.25 else "revolute"
        x, y, z = random.uniform(-0.2, 0.2, 3)
        r, p, w = random.uniform(-1.5, 1.5, 3)
        axis = " ".join(f"{c:.3f}" for c in random.normal(size=3))
        joints.append((f"j{k:02d}", parent, kind, axis, f'xyz="{x} {y} {z}" rpy="{r} {p} {w}"'))
        if k and random.random() < 0.5:
            leader = f"j{int(random.integers(k)):02d}"
            ratio, offset = float(random.choice([-1, 1]) * random.uniform(0.2, 2)), random.normal()
            mimics[f"j{k:02d}"] = (leader, ratio, float(offset))
            root, r0, o0 = flat.get(leader, (leader, 1.0, 0.0))
            flat[f"j{k:02d}"] = (root, ratio * r0, ratio * o0 + float(offset))
    # so wide that chains narrow nothing
    return urdf(joints, mimics, 1e6), urdf(joints, flat, 1e6)


@pytest.mark.parametrize("seed", range(12))
def test_random_robots_are_as_with_pinocchios_mimic_joints(seed: int, tmp_path: Path) -> None:
    random = np.random.default_rng(seed)
    text, flat = random_robot(random)
    model = loaded(tmp_path, text)
    try:
        pin.buildModelFromXML(flat, mimic=True)
    except ValueError:
        pytest.skip("Pinocchio's order of joints has a master after its follower")
    same_as_oracle(model, flat, random.uniform(-1.0, 1.0, model.nv))


@pytest.mark.parametrize("seed", range(6))
def test_jacobians_are_derivatives(seed: int, tmp_path: Path) -> None:
    random = np.random.default_rng(100 + seed)
    model = loaded(tmp_path, random_robot(random)[0])
    q = random.uniform(-1.0, 1.0, model.nv)
    kin = Kinematics(model, frames_of(model), track_com=True)
    here = kin.update(q).rotation.copy()
    linear, angular, com = kin.linear.copy(), kin.angular.copy(), kin.com_jacobian.copy()

    def turns(x: np.ndarray) -> np.ndarray:
        return np.array(
            [log_so3(r @ r0.T) for r, r0 in zip(kin.update(x).rotation, here, strict=True)]
        )

    assert_allclose(difference(lambda x: kin.update(x).position.copy(), q), linear, atol=1e-8)
    assert_allclose(difference(turns, q), angular, atol=1e-8)
    assert_allclose(difference(lambda x: kin.update(x).com.copy(), q), com, atol=1e-8)
    assert_allclose(model.full(q), q[model.master] * model.ratio + model.offset)


def test_placements_without_jacobians_are_the_same(hand: RobotModel) -> None:
    q = np.array([0.3, -0.4, 0.9])
    kin, quick = Kinematics(hand, ("a4_link",)).update(q), Kinematics(hand, ())
    assert np.array_equal(quick.update_placements(q).joint_poses, kin.joint_poses)
    assert np.array_equal(quick.q, q)


def test_support_is_of_the_motion_not_of_the_chain(hand: RobotModel) -> None:
    assert hand.joint_names == ("a1", "a2", "b2")
    # a2 moves the second finger by the slide that follows it
    assert hand.support(hand.frame("b1_link")).tolist() == [1.0, 1.0, 0.0]
    assert hand.support(hand.frame("a4_link")).tolist() == [1.0, 1.0, 0.0]
    assert hand.support(hand.frame("b3_link")).tolist() == [1.0, 1.0, 1.0]
    kin = Kinematics(hand, frames_of(hand)).update(np.array([0.2, 0.3, -0.5]))
    for f, name in enumerate(kin.frames):
        moved = np.abs(kin.linear[f]).max(axis=0) + np.abs(kin.angular[f]).max(axis=0) > 0.0
        assert np.array_equal(moved, hand.support(hand.frame(name)) > 0.0)


@pytest.mark.parametrize("tip", ["a4_link", "b3_link"])
def test_manipulability_and_its_gradient(hand: RobotModel, tip: str) -> None:
    """Of the Jacobian by the independent joints: the finger of two masters has rank 2 only."""
    kin, size = Kinematics(hand, (tip,)), 2

    def w(q: np.ndarray) -> tuple[float, np.ndarray]:
        kin.update(q)
        gradient = np.zeros(hand.nv)
        value = manipulability_gradient(
            kin.joint_jacobian, kin.position[0], kin.linear[0], kin.chains[0], kin.leads[0],
            hand.master, hand.ratio, size, gradient,
        )  # fmt: skip
        return value, gradient

    random = np.random.default_rng(2)
    for _ in range(5):
        q = random.uniform(-1.0, 1.0, hand.nv)
        value, gradient = w(q)
        j = kin.linear[0, :size]
        assert value == pytest.approx(np.sqrt(np.linalg.det(j @ j.T)), rel=1e-12)
        assert_allclose(difference(lambda x: np.array(w(x)[0]), q), gradient, atol=1e-8)


def test_manipulability_in_space(tmp_path: Path) -> None:
    """A random chain of nine joints, four of them independent, one driving three others."""
    random = np.random.default_rng(5)
    joints = [
        (f"j{k}", f"j{k - 1}" if k else "", "prismatic" if k == 4 else "revolute",
         " ".join(f"{c:.3f}" for c in random.normal(size=3)),
         'xyz="{:.3f} {:.3f} {:.3f}"'.format(*random.uniform(-0.2, 0.2, 3)))
        for k in range(9)
    ]  # fmt: skip
    mimics: dict[str, Mimic] = {
        "j0": ("j3", 1.5, 0.0), "j4": ("j3", 0.1, 0.05), "j7": ("j3", -0.6, 0.1),
        "j2": ("j1", -1.0, 0.0), "j8": ("j6", 0.7, 0.0),
    }  # fmt: skip
    model = loaded(tmp_path, urdf(joints, mimics))
    assert model.joint_names == ("j1", "j3", "j5", "j6")
    kin = Kinematics(model, ("j8_link",))

    def w(q: np.ndarray) -> tuple[float, np.ndarray]:
        kin.update(q)
        gradient = np.zeros(model.nv)
        value = manipulability_gradient(
            kin.joint_jacobian, kin.position[0], kin.linear[0], kin.chains[0], kin.leads[0],
            model.master, model.ratio, 3, gradient,
        )  # fmt: skip
        return value, gradient

    for _ in range(5):
        q = random.uniform(-1.0, 1.0, model.nv)
        value, gradient = w(q)
        j = kin.linear[0]
        assert value == pytest.approx(np.sqrt(np.linalg.det(j @ j.T)), rel=1e-10)
        assert_allclose(difference(lambda x: np.array(w(x)[0]), q), gradient, atol=1e-8)


def test_gradients_of_distances_and_the_bound_on_their_change(hand: RobotModel) -> None:
    cube = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * 0.1
    geometry, pieces = with_object(hand, [cube])
    shapes = len(geometry.geometryObjects)
    pairs = [(a, b) for a in range(shapes) for b in range(a + 1, shapes)]
    scene = collision_scene(hand, geometry, pieces, pairs)
    kin, distances = Kinematics(hand, ()), Distances(scene)
    place = np.array([0.5, 0.3, 0.2]), np.eye(3)

    def measured(q: np.ndarray) -> np.ndarray:
        return distances.update(kin.update(q), *place).value.copy()

    random = np.random.default_rng(3)
    for _ in range(3):
        q, other = random.uniform(-1.0, 1.0, (2, hand.nv))
        slopes = difference(measured, q)
        here = measured(q)
        for k in range(len(pairs)):
            assert_allclose(distances.gradient(k, kin), slopes[k], atol=1e-6)
        least = distances.least_after(q, other)
        assert measured(other).min() >= least
        # a reach that forgot the followers would allow less than this motion
        assert np.all(np.abs(measured(other) - here) <= 2.0 * scene.reach @ np.abs(other - q))


def test_an_uncoupled_robot_has_all_its_joints() -> None:
    model = load_robot(resources.find("urdf", "planar_bimanual"))
    q = np.linspace(-1.0, 1.0, model.nv)
    assert model.n_full == model.nv == model.pin_model.nq and model.followers == {}
    assert np.array_equal(model.full(q), q)
    assert np.array_equal(model.own, np.arange(model.nv))
    assert np.array_equal(model.lower, model.pin_model.lowerPositionLimit)
    for array in (model.master, model.ratio, model.offset, model.own, model.lower):
        assert not array.flags.writeable


def test_a_robot_of_one_joint(tmp_path: Path) -> None:
    """Pinocchio hands over its matrices of one column as vectors."""
    model = loaded(tmp_path, urdf([("a", "", "revolute", "0 0 1", 'xyz="0.1 0 0"')], {}))
    kin = Kinematics(model, ("a_link",), track_com=True).update(np.array([0.4]))
    assert_allclose(kin.angular[0], [[0.0], [0.0], [1.0]], atol=1e-15)
    arm = kin.com - kin.position[0]
    assert_allclose(kin.com_jacobian[:, 0], [-arm[1], arm[0], 0.0], atol=1e-15)


def narrow(
    folder: Path, multiplier: float, offset: float, lower: float, upper: float
) -> RobotModel:
    """A joint of ±1, 5/s, followed by one of the given limits and 3/s."""
    text = urdf(HAND[:2], {"a2": ("a1", multiplier, offset)})
    text = text.replace('lower="-40.0" upper="40.0"', f'lower="{lower}" upper="{upper}"')
    text = text.replace('velocity="40.0"', 'velocity="3"').replace('velocity="1.0"', 'velocity="5"')
    return loaded(folder, text)


@pytest.mark.parametrize(
    ("multiplier", "offset", "lower", "upper", "expected", "speed"),
    [
        (2.0, 0.0, -1.0, 1.5, (-0.5, 0.75), 1.5),
        (-2.0, 0.5, -1.0, 1.5, (-0.5, 0.75), 1.5),
        (0.1, 0.0, -1.0, 1.0, (-1.0, 1.0), 5.0),
        (1.0, 1.0, 0.0, 2.0, (-1.0, 1.0), 3.0),
        (1.0, 1.0, 2.0, 3.0, (1.0, 1.0), 3.0),
    ],
)
def test_a_master_keeps_its_followers_limits(
    multiplier: float, offset: float, lower: float, upper: float,
    expected: tuple[float, float], speed: float, tmp_path: Path,
) -> None:  # fmt: skip
    model = narrow(tmp_path, multiplier, offset, lower, upper)
    assert model.joint_names == ("a1",)
    assert (model.lower[0], model.upper[0]) == pytest.approx(expected)
    assert model.velocity[0] == pytest.approx(speed)
    assert model.effort[0] == 1.0
    for end in (model.lower, model.upper):
        assert lower - 1e-12 <= model.full(end)[1] <= upper + 1e-12


def test_limits_that_leave_nothing_are_refused_with_their_line(tmp_path: Path) -> None:
    with pytest.raises(UrdfError) as caught:
        narrow(tmp_path, 2.0, 0.0, 3.0, 4.0)
    text = (tmp_path / "r.urdf").read_text()
    line = text[: text.index("<mimic")].count("\n") + 1
    (fault,) = str(caught.value).splitlines()
    assert (
        f"r.urdf:{line}: its limits ask 'a1' to stay in [1.5, 2], which is outside [-1, 1]" in fault
    )


def test_naming_a_follower_names_its_master(hand: RobotModel) -> None:
    with pytest.raises(WbcError, match=r"'a4' follows 'a2' .* name 'a2'"):
        hand.joint("a4")
    with pytest.raises(WbcError, match="unknown joint 'a9'"):
        hand.joint("a9")
    assert hand.followers == {"a3": "a2", "a4": "a2", "b1": "a2", "b3": "b2"}


def test_a_tilting_follower_is_not_planar(tmp_path: Path) -> None:
    flat = [(n, p, "revolute", "0 0 1", 'xyz="0.1 0 0"') for n, p, *_ in HAND[:4]]
    assert loaded(tmp_path, urdf(flat, FLAT)).planar
    tilted = [*flat[:3], (*flat[3][:3], "0 1 0", flat[3][4])]
    assert not loaded(tmp_path, urdf(tilted, FLAT)).planar
