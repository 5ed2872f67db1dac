"""What of a run's forces is shown, the same while it goes on and when it is shown again."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.contact.grasp import Grasp
from wbc.recording import RunMeta
from wbc.robot.model import RobotModel
from wbc.scenario import Scenario
from wbc.scenario.build_dynamics import limits_of_torques, true_body, true_physics
from wbc.view.forces import LENGTH, ArrowMaker

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


def force_pictures(
    scenario: Scenario, meta: RunMeta, model: RobotModel, grasp: Grasp
) -> ForcePictures:
    """Planned forces where an optimizer plans them, planned and measured ones under torques.

    Cones are those that are believed: of the planner, else as the scenario has them.
    """
    driven = scenario.simulation.engine != "kinematic"
    if not (driven or meta.mu):
        return ForcePictures(None, (), False)
    tips = [scenario.robot.fingers[name] for name in grasp.fingers]
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
