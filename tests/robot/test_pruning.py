"""Which pairs are watched: none may be dropped that can meet."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from wbc import resources
from wbc.robot.model import load_robot
from wbc.robot.pruning import prune


@pytest.mark.parametrize("name", ["planar_gripper", "planar_bimanual"])
def test_pairs_dropped_as_never_near_never_are(name: str) -> None:
    model = load_robot(resources.find("urdf", name))
    margin = 0.15
    report = prune(model, model.geometry, margin=margin)
    geometry = model.geometry.copy()
    geometry.removeAllCollisionPairs()
    names = [model.pin_model.frames[o.parentFrame].name for o in geometry.geometryObjects]
    for first, second in report.never:
        geometry.addCollisionPair(pin.CollisionPair(names.index(first), names.index(second)))
    data, measured = model.pin_model.createData(), pin.GeometryData(geometry)
    random, least = np.random.default_rng(1), np.inf
    for _ in range(4000):
        # corners of the joint range too: that is where arms are at their longest
        q = np.where(
            random.random(model.nv) < 0.5,
            random.uniform(model.lower, model.upper),
            random.choice([-1.0, 0.0, 1.0], model.nv) * model.upper,
        )
        pin.updateGeometryPlacements(model.pin_model, data, geometry, measured, q)
        pin.computeDistances(geometry, measured)
        distances = [r.min_distance for r in measured.distanceResults]
        least = min(least, min(distances, default=np.inf))
    assert least > margin


def test_every_pair_is_somewhere_in_the_report() -> None:
    model = load_robot(resources.find("urdf", "planar_bimanual"))
    report = prune(model, model.geometry, margin=0.15)
    shapes = len(model.geometry.geometryObjects)
    sorted_out = len(report.adjacent) + len(report.always) + len(report.never)
    assert len(report.kept) + sorted_out == shapes * (shapes - 1) // 2
    assert {("left_finger_a_link_1", "right_finger_a_link_2")} <= {
        tuple(
            model.pin_model.frames[model.geometry.geometryObjects[k].parentFrame].name for k in pair
        )
        for pair in report.kept
    }
