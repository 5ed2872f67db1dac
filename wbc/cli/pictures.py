"""What is shown of a run's forces and of its table, live and when it is shown again."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from wbc.contact.grasp import Grasp
from wbc.recording import RunMeta
from wbc.robot.model import RobotModel
from wbc.rotations import rotation_from_quaternion
from wbc.scenario import Scenario
from wbc.scenario.build_dynamics import limits_of_torques, true_body, true_physics
from wbc.scenario.build_tasks import tip_frames
from wbc.sim.mujoco_table import underside
from wbc.view.forces import LENGTH, ArrowMaker
from wbc.view.scene import Scene, SceneShape

_THICK, _POST, _STALK = 0.02, 0.006, 0.05
"""A table top; posts across, and what is drawn of one that stands on nothing, [m]."""
_PLANAR_LENGTH = 0.3  # as `LENGTH`, in the plane, where robots are as large as the object, [m]


class ForcePictures(NamedTuple):
    """What makes a run's forces seen.

    Attributes:
        arrows: None where it has no forces.
        friction: (N,) coefficient of each contact; empty likewise.
        measured: forces are measured, too.
    """

    arrows: ArrowMaker | None
    friction: tuple[float, ...]
    measured: bool


def with_table(scene: Scene, scenario: Scenario, grasp: Grasp) -> Scene:
    """The scene with what the object lies on at the start, where the object is believed to be."""
    thing, table = scenario.object, scenario.simulation.physics.table
    if thing is None or table is None or scenario.simulation.engine != "mujoco":
        return scene  # other engines have none
    place, size = np.array(thing.pose.xyz, dtype=np.float64), np.array(table.size)
    rotation = rotation_from_quaternion(np.array(thing.pose.xyzw))
    boxes = []
    if table.height is not None:
        boxes.append((place[:2], table.height - _THICK, table.height, size))
    for across in table.posts:
        point, _ = underside(grasp.surface, rotation, np.array(across))
        high = float(place[2] + rotation[2] @ point)
        low = high - _STALK if table.height is None else table.height
        boxes.append((place[:2] + across, low, high, np.full(2, _POST)))
    shapes = []
    for k, (middle, low, high, wide) in enumerate(boxes):
        at = np.eye(4)
        at[:3, 3] = *middle, 0.5 * (low + high)
        edges = (float(wide[0]), float(wide[1]), high - low)
        shapes.append(SceneShape(f"table {k}", "box", size=edges, placement=at))
    return replace(scene, shapes=(*scene.shapes, *shapes))


def force_pictures(
    scenario: Scenario, meta: RunMeta, model: RobotModel, grasp: Grasp
) -> ForcePictures:
    """Planned forces where an optimizer plans them, planned and measured ones under torques.

    Cones are those that are believed: of the planner, else as the scenario has them.
    """
    driven = scenario.simulation.engine != "kinematic"
    if not (driven or meta.mu):
        return ForcePictures(None, (), False)
    tips = tip_frames(scenario, grasp)
    friction, lower, upper = meta.mu, meta.tau_min, meta.tau_max
    if not friction:
        friction = tuple(true_physics(scenario, model, grasp).friction.tolist())
    if not upper:  # not known before the run, where no optimizer has need of them
        upper = tuple(limits_of_torques(scenario, model).tolist())
        lower = tuple(-x for x in upper)
    body = true_body(scenario)
    arrows = ArrowMaker(
        model, tips, lower, upper, body=(body.mass, np.asarray(body.com)),
        length=_PLANAR_LENGTH if grasp.planar else LENGTH,
    )  # fmt: skip
    return ForcePictures(arrows, friction, driven)
