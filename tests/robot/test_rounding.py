"""Capsules about shapes: they hold all of them, and stand out as little as they say."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
import pytest

from wbc.arrays import Array
from wbc.robot.rounding import EXCESS, capsule_about, corners, rounded

SHAPES = {
    "rod": coal.Box(0.02, 0.03, 0.3),
    "cube": coal.Box(0.02, 0.02, 0.02),
    "plate": coal.Box(0.04, 0.3, 0.2),
    "cylinder": coal.Cylinder(0.03, 0.2),
    "disc": coal.Cylinder(0.1, 0.02),
    "cone": coal.Cone(0.03, 0.1),
    "ellipsoid": coal.Ellipsoid(0.03, 0.02, 0.1),
}


def outside(points: Array, ends: Array, radius: float) -> Array:
    """Distance of points (n, 3) outside a capsule, [m]."""
    axis = ends[1] - ends[0]
    length = max(float(axis @ axis), 1e-30)
    along = np.clip((points - ends[0]) @ axis / length, 0.0, 1.0)
    away: Array = np.linalg.norm(points - ends[0] - along[:, None] * axis, axis=1) - radius
    return away


def cloud(seed: int) -> Array:
    random = np.random.default_rng(seed)
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    points: Array = random.normal(size=(60, 3)) * random.uniform(0.01, 0.1, 3) @ turn
    return points + random.normal(size=3)


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_a_capsule_holds_the_shape(shape: coal.ShapeBase) -> None:
    points = corners(shape)
    capsule = capsule_about(points)
    assert outside(points, capsule.ends, capsule.radius).max() < 1e-12


@pytest.mark.parametrize("seed", range(20))
def test_a_capsule_holds_any_points_and_says_its_excess(seed: int) -> None:
    points = cloud(seed)
    capsule = capsule_about(points)
    assert outside(points, capsule.ends, capsule.radius).max() < 1e-12
    random = np.random.default_rng(seed)
    way = random.normal(size=(2000, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    excess = (capsule.ends @ way.T).max(axis=0) + capsule.radius - (points @ way.T).max(axis=0)
    assert excess.min() > -1e-12
    assert excess.max() < 1.4 * capsule.excess + 1e-3  # found along a hundred directions only


def test_flat_and_single_points() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=np.float64)
    capsule = capsule_about(square)
    assert outside(square, capsule.ends, capsule.radius).max() < 1e-12
    assert capsule_about(np.zeros((4, 3))).radius < 1e-5


def geometry(shape: coal.ShapeBase, placement: pin.SE3) -> pin.GeometryModel:
    model = pin.GeometryModel()
    model.addGeometryObject(pin.GeometryObject("s", 0, 0, placement, shape))
    return model


@pytest.mark.parametrize(
    ("name", "kind"),
    [("rod", coal.Capsule), ("plate", coal.Box), ("disc", coal.Cylinder), ("cube", coal.Capsule)],
)
def test_a_capsule_is_taken_only_where_it_fits(name: str, kind: type) -> None:
    placement = pin.SE3.Random()
    before = geometry(SHAPES[name], placement)
    (after,) = rounded(before).geometryObjects
    if kind is coal.Capsule:
        assert isinstance(after.geometry, coal.Capsule | coal.Sphere)
        points = np.array([placement.act(p) for p in corners(SHAPES[name])])
        half = getattr(after.geometry, "halfLength", 0.0)
        ends = np.array([after.placement.act(np.array([0, 0, z])) for z in (-half, half)])
        assert outside(points, ends, after.geometry.radius).max() < 1e-12
        assert after.geometry.radius - 0.5 * 0.02 < 2 * EXCESS + 0.02
    else:
        assert isinstance(after.geometry, kind)
    (kept,) = rounded(before, capsules=False).geometryObjects
    assert type(kept.geometry) is type(SHAPES[name])
