"""The blocks of a scenario that runs under torques to an engine and the second stage."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from wbc.arrays import Array
from wbc.contact.grasp import Grasp
from wbc.contact.surfaces import Surface
from wbc.control.force_control import ForceControl, ForceGains, finger_joints
from wbc.control.set_points import SetPoints
from wbc.control.torque_controller import TorqueController
from wbc.control.watch import WatchSettings
from wbc.errors import WbcError
from wbc.robot.model import RobotModel
from wbc.rotations import rotation_from_quaternion
from wbc.scenario import dynamic_blocks
from wbc.scenario.build import Assembly
from wbc.scenario.build_disturbance import build_disturbance
from wbc.scenario.build_forces import build_payload, torque_limits, value_for
from wbc.scenario.build_tasks import tip_frames
from wbc.scenario.schema import Scenario
from wbc.scenario.tables import release
from wbc.sim.compliant import CompliantPlant, FreeBody, Physics
from wbc.sim.disturbances import Disturbance
from wbc.sim.dynamic import Dynamics
from wbc.sim.mujoco_model import MujocoSettings, build_mujoco, rotor_defaults
from wbc.sim.mujoco_plant import MujocoPlant
from wbc.sim.mujoco_table import Table
from wbc.sim.pads import Pads
from wbc.sim.plant import Plant
from wbc.sim.trial import Trial, scaled


def build_dynamics(assembly: Assembly) -> Dynamics | None:
    """Engine and second stage of a scenario; None for the ideal robot.

    Raises:
        WbcError: the engine cannot be had.
    """
    scenario, model = assembly.loaded.scenario, assembly.model
    grasp = assembly.controller.law.kin.grasp
    simulation, thing = scenario.simulation, scenario.object
    if simulation.engine == "kinematic" or thing is None or scenario.force_control is None:
        return None  # the last two: `check_dynamics`
    wrong, control = build_disturbance(scenario), build_torque_control(assembly)
    trial = None
    if wrong is not None:
        trial = Trial(wrong, model, grasp.fingers, ~control.second.fingers, simulation.step)
    return Dynamics(
        _plant(scenario, model, grasp, tip_frames(scenario, grasp), wrong or Disturbance()),
        control.second,
        control.set_points,
        held=simulation.physics.control == "held",
        release=release(scenario),
        trial=trial,
        watch=_watch(scenario.force_control),
    )


def build_torque_control(assembly: Assembly) -> TorqueController:
    """Both stages of a scenario as one controller, for a robot of one's own: nothing is simulated.

    `TorqueController.init` takes the assembly's `start`.

    Raises:
        WbcError: the scenario has no object or no block `force_control`.
    """
    scenario, model = assembly.loaded.scenario, assembly.model
    grasp = assembly.controller.law.kin.grasp
    thing, given = scenario.object, scenario.force_control
    if thing is None or given is None:
        missing = "force_control" if given is None else "object"
        raise WbcError(f"{assembly.loaded.path}: torques need a block '{missing}'")
    tips = tip_frames(scenario, grasp)
    gravity = np.array(model.pin_model.gravity.linear)
    if grasp.planar:
        gravity[2] = 0.0
    return TorqueController(
        assembly.controller,
        ForceControl(model, tips, _gains(scenario, given, model, grasp, tips)),
        SetPoints(grasp, build_payload(thing, scenario), gravity),
        _watch(given),
    )


def _watch(given: dynamic_blocks.ForceControl) -> WatchSettings:
    return WatchSettings(**given.watch.model_dump())


def _plant(
    scenario: Scenario, model: RobotModel, grasp: Grasp, tips: tuple[str, ...], wrong: Disturbance
) -> Plant:
    """The engine, with the object as it truly is."""
    body, surface = true_body(scenario), scaled(grasp.surface, wrong.size)
    body = FreeBody(wrong.mass * body.mass, body.com, wrong.mass * body.inertia)
    physics = true_physics(scenario, model, grasp)
    physics = dataclasses.replace(
        physics,
        friction=wrong.friction * physics.friction,
        sliding_friction=wrong.friction * physics.sliding_friction,
    )
    if scenario.simulation.engine == "mujoco":
        return _mujoco(scenario, model, true_pads(scenario, grasp), tips, surface, body, physics)
    pads, fixture = true_pads(scenario, grasp), release(scenario) is not None
    return CompliantPlant(model, tips, surface, body, pads, physics, fixture=fixture)


def true_body(scenario: Scenario) -> FreeBody:
    """The object as the scenario has it; one without mass where it has none."""
    thing = scenario.object
    if thing is None:
        return FreeBody(0.0, np.zeros(3), np.zeros(3))
    return FreeBody(float(thing.mass or 0.0), np.array(thing.com), np.array(thing.inertia))


def true_pads(scenario: Scenario, grasp: Grasp) -> Pads:
    """The fingertips as the compliant engine has them."""
    given, one = scenario.simulation.physics, np.ones(grasp.count)
    return Pads(
        grasp.rest_length, grasp.stiffness, given.pad_damping * one, given.bristle_stiffness * one,
        given.bristle_damping * one,
    )  # fmt: skip


def true_physics(scenario: Scenario, model: RobotModel, grasp: Grasp) -> Physics:
    """Steps, friction and what the joints add."""
    given, names = scenario.simulation.physics, model.joint_names
    # the published planar robot has no motors to speak of
    armature, damping = (0.0, 0.0) if grasp.planar else rotor_defaults(model)
    return Physics(
        step=given.step,
        friction=_by(given.friction, grasp.fingers, 0.8),
        sliding_friction=_by(given.sliding_friction, grasp.fingers, 0.0),
        armature=_by(given.armature, names, armature),
        joint_damping=_by(given.joint_damping, names, damping),
    )


def _mujoco(
    scenario: Scenario, model: RobotModel, pads: Pads, tips: tuple[str, ...], surface: Surface,
    body: FreeBody, physics: Physics,
) -> Plant:  # fmt: skip
    given = scenario.simulation.physics
    settings = MujocoSettings(limits_of_torques(scenario, model), table=_table(scenario))
    made = build_mujoco(model, tips, pads, surface, body, physics, settings)
    return MujocoPlant(made, fixture=given.fixture is not None)


def _table(scenario: Scenario) -> Table | None:
    given, thing = scenario.simulation.physics.table, scenario.object
    if given is None or thing is None:
        return None
    return Table(
        position=np.array(thing.pose.xyz, dtype=np.float64),
        rotation=rotation_from_quaternion(np.array(thing.pose.xyzw)),
        top=given.height,
        size=np.array(given.size),
        posts=np.array(given.posts, dtype=np.float64).reshape(-1, 2),
    )


def _gains(
    scenario: Scenario, given: dynamic_blocks.ForceControl, model: RobotModel, grasp: Grasp,
    tips: tuple[str, ...],
) -> ForceGains:  # fmt: skip
    arm, names, fingers = ~finger_joints(model, tips), model.joint_names, grasp.fingers
    arms = given.arms
    stiffness = np.where(arm, _by(arms.stiffness, names, 1000.0), 0.0)
    limit = limits_of_torques(scenario, model)
    return ForceGains(
        position=_by(given.position, fingers, 2000.0),
        force=_by(given.force, fingers, 0.2),
        integral=_by(given.integral, fingers, 20.0),
        smoothing=given.smoothing,
        windup=_by(given.windup, fingers, 5.0),
        damping=np.where(arm, _by(arms.damping, names, 100.0), _by(given.damping, names, 5.0)),
        stiffness=stiffness,
        joint_integral=arms.integral * stiffness,
        joint_windup=np.full(model.nv, arms.windup),
        tau_min=-limit,
        tau_max=limit,
        inertia=given.inertia,
        relative=given.position_in == "palm",
    )


def limits_of_torques(scenario: Scenario, model: RobotModel) -> Array:
    """(nv,) largest torque of each joint of a run under torques, [Nm]; inf where there is none."""
    return torque_limits({} if scenario.forces is None else scenario.forces.torque_limits, model)


def _by(values: Mapping[str, float], names: tuple[str, ...], default: float | Array) -> Array:
    """The values of contacts or joints, by name or pattern, else the default, one or (n,)."""
    found = np.array([value_for(values, name) for name in names], dtype=np.float64)
    return np.where(np.isnan(found), default, found)
