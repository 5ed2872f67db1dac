"""From a checked scenario to the controller that runs it: all names resolved, all faults found."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from wbc.arrays import Array
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.contact.grasp import ContactMode, ContactState, Grasp, no_grasp
from wbc.contact.surfaces import SURFACES, Surface
from wbc.control.controller import Controller, Settings
from wbc.control.force_control import finger_joints
from wbc.control.law import CostForecast, Law
from wbc.control.phases import PhaseSequence
from wbc.control.setup import close_grasp
from wbc.control.state import ControllerState
from wbc.control.task_stack import TaskStack
from wbc.control.touch import TouchSense
from wbc.errors import ScenarioError, WbcError
from wbc.robot.distances import Distances
from wbc.robot.kinematics import Kinematics
from wbc.robot.model import RobotModel
from wbc.robot.pruning import PairReport
from wbc.rotations import rotation_from_quaternion
from wbc.scenario.arms import check_arms
from wbc.scenario.build_costs import build_costs, safety_distance, watched_pairs
from wbc.scenario.build_forces import build_planner
from wbc.scenario.build_phases import build_phases
from wbc.scenario.build_tasks import build_tasks, tip_frames, tracked_frames
from wbc.scenario.kinds import BoxSpec, ObjectPoseSpec, SuperellipsoidSpec, SurfaceSpec
from wbc.scenario.load import Loaded
from wbc.scenario.names import check_names
from wbc.scenario.places import robot_file
from wbc.scenario.robots import read_robot
from wbc.scenario.schema import Scenario
from wbc.scenario.synergies import Hands, check_hands, read_hands
from wbc.scenario.tables import check_table
from wbc.scenario.touches import check_touches
from wbc.scenario.wording import Faults
from wbc.stack.supervisor import Supervisor

_NO_GAIN = 1.0  # of the main task where there is no object: it has no rows


@dataclass(frozen=True)
class Assembly:
    """A scenario ready to run.

    Attributes:
        loaded: the file.
        model: the robot.
        controller: the tick.
        start: its first state, fingers closed on the object.
        pairs: what became of the collision pairs; None where no cost watches any.
        main_task: name of the object task; None where the scenario has none.
    """

    loaded: Loaded
    model: RobotModel
    controller: Controller
    start: ControllerState
    pairs: PairReport | None
    main_task: str | None

    @property
    def ticks(self) -> int:
        """Ticks of the simulated run."""
        simulation = self.loaded.scenario.simulation
        return max(1, round(simulation.duration / simulation.step))


def build(loaded: Loaded) -> Assembly:
    """Assemble robot, grasp, tasks, costs, phases and controller.

    Raises:
        ScenarioError: names that the robot does not have, values that do not fit it.
        UrdfError: the robot's file.
        SetupError: the fingers cannot be closed on the object at the start.
    """
    scenario = loaded.scenario
    model = _robot(loaded)
    links = {frame.name for frame in model.bodies}
    joints = model.joint_names
    prismatic = [
        name for name, k in zip(joints, model.own, strict=True) if model.is_prismatic(int(k))
    ]
    faults = check_names(scenario, joints, model.frame_names, links, prismatic, model.followers)
    synergies = Faults()
    hands = read_hands(scenario, loaded.path.parent, synergies)
    check_hands(scenario, hands, model, synergies)
    if faults := [*faults, *check_touches(scenario), *synergies.found]:
        raise loaded.error(faults)
    try:
        return _assemble(loaded, model, hands)
    except ScenarioError:
        raise
    except WbcError as error:
        raise (
            type(error)(f"{loaded.source.shown}: {error}")
            if type(error) is not WbcError
            else (ScenarioError(f"{loaded.source.shown}: {error}"))
        ) from error


def _assemble(loaded: Loaded, model: RobotModel, hands: Hands) -> Assembly:
    scenario = loaded.scenario
    grasp = build_grasp(scenario, model)
    _check_faces(loaded, grasp)
    tips = tip_frames(scenario, grasp)
    if faults := [*check_table(scenario, grasp.surface), *check_arms(scenario, model, tips)]:
        raise loaded.error(faults)
    frames = tracked_frames(scenario, grasp)
    com = any(spec.type == "center_of_mass" for spec in scenario.tasks.values())
    main, secondary = _priority(scenario)
    kin = ExtendedKinematics(
        Kinematics(model, frames, track_com=com),
        grasp,
        scenario.tasks[main].gain if main else _NO_GAIN,
    )
    q_start = _start(loaded, model)
    tasks = build_tasks(scenario, secondary, kin, q_start, hands)
    metric = np.array([scenario.robot.metric.get(j, 1.0) for j in model.joint_names])
    stack = TaskStack(tasks, grasp.count, metric)
    scene, report = watched_pairs(loaded, model, grasp)
    costs = build_costs(scenario, model, scene)
    near = safety_distance(scenario) or 0.0  # what is further apart costs nothing
    distances = Distances(scene, near) if scene is not None else None
    law = Law(
        kin, stack, costs, distances, scenario.stack.gradient_gain,
        printed=scenario.stack.form == "printed",
    )  # fmt: skip
    forecast = CostForecast(
        tuple(costs), Kinematics(model, ()), Distances(scene, near) if scene is not None else None
    )
    settings = scenario.supervisor
    phases = build_phases(scenario, grasp, [task.name for task in tasks], hands)
    controller = Controller(
        law,
        forecast,
        Supervisor(settings.remove_above, settings.insert_below, settings.horizon, settings.dwell),
        phases,
        tuple(range(len(secondary))),
        _settings(scenario, model),
        build_planner(scenario, kin, phases),
        _touch_sense(scenario, kin, phases),
    )
    place_object(kin, scenario, controller)
    first = controller.phases.phases[0]
    contact = ContactState.planned(grasp, first.mode)
    q0 = close_grasp(kin, q_start, contact)
    return Assembly(loaded, model, controller, controller.init(q0), report, main)


def _touch_sense(
    scenario: Scenario, kin: ExtendedKinematics, phases: PhaseSequence
) -> TouchSense | None:
    """The fingertips as sensors, where a phase asks what they feel."""
    if not any(phase.senses for phase in phases.phases):
        return None
    model, tips = kin.robot.model, kin.robot.frames[: kin.grasp.count]
    given = scenario.force_control
    own = finger_joints(model, tips)
    if given is not None and given.position_in == "world":
        own = np.ones(model.nv, dtype=np.bool_)
    return TouchSense(model, tips, own)


def _robot(loaded: Loaded) -> RobotModel:
    robot = loaded.scenario.robot
    try:
        file = robot_file(robot.urdf, loaded.path.parent)
    except WbcError as error:
        raise ScenarioError(f"{loaded.locate(('robot', 'urdf'))}: {error}") from None
    return read_robot(file, capsules=robot.collisions.shapes == "capsules")


def _priority(scenario: Scenario) -> tuple[str | None, list[str]]:
    """The object task, if it leads the stack, and the tasks after it."""
    names = list(scenario.stack.priority)
    if isinstance(scenario.tasks[names[0]], ObjectPoseSpec):
        return names[0], names[1:]
    return None, names


def build_surface(spec: SurfaceSpec) -> Surface:
    """The surface that a block describes. Raises WbcError where its sizes make no surface."""
    fields = spec.model_dump(exclude={"type"})
    if isinstance(spec, SuperellipsoidSpec):
        ax, ay, az = (0.5 * size for size in spec.size)
        fields = {"ax": ax, "ay": ay, "az": az, "p": spec.exponent}
    elif isinstance(spec, BoxSpec):
        fields = {"size": tuple(spec.size)}
    elif "exponent" in fields:
        fields["p"] = fields.pop("exponent")
    return SURFACES[spec.model_dump()["type"]](**fields)


def build_grasp(scenario: Scenario, model: RobotModel) -> Grasp:
    """Object and fingers; a grasp without fingers where the scenario has no object."""
    if scenario.object is None:
        return no_grasp(model.planar)
    surface = build_surface(scenario.object.surface)
    if surface.planar and not model.planar:
        raise ScenarioError(
            "the object is a planar contour, but the robot moves in space (use a 3-D surface)"
        )
    fingers = tuple(scenario.contacts)
    at = np.zeros((len(fingers), 2))
    face = np.zeros(len(fingers), dtype=np.int64)
    for i, name in enumerate(fingers):
        contact = scenario.contacts[name]
        at[i, : len(contact.at)] = [x.value for x in contact.at]
        if contact.face is not None:
            face[i] = (
                surface.faces.index(contact.face) if isinstance(contact.face, str) else contact.face
            )
        other = surface.rechart(at[i], int(face[i]))
        if other is not None:
            at[i], face[i] = other
    specs = [scenario.contacts[name] for name in fingers]
    return Grasp(
        surface=surface,
        fingers=fingers,
        at=at,
        face=face,
        stiffness=np.array([c.stiffness for c in specs], dtype=np.float64),
        rest_length=np.array([c.rest_length for c in specs], dtype=np.float64),
        share=np.array([c.share for c in specs], dtype=np.float64),
        planar=surface.planar,
    )


def _check_faces(loaded: Loaded, grasp: Grasp) -> None:
    """Refuse contact points beyond the edge of their face."""
    surface = grasp.surface
    for name, xi, face in zip(grasp.fingers, grasp.at, grasp.face, strict=True):
        margin = surface.margin(xi, int(face))
        if surface.edged and margin < 0.0:
            place = loaded.locate(("contacts", name, "at"))
            raise ScenarioError(
                f"{place}: contacts.{name}.at: the contact point is {-1e3 * margin:.3g} mm beyond "
                f"the edge of face '{surface.faces[face]}'"
            )


def place_object(kin: ExtendedKinematics, scenario: Scenario, controller: Controller) -> None:
    """Put the object where the scenario starts, pads pressed as in the first phase."""
    if scenario.object is None:
        return
    pose = scenario.object.pose
    kin.reference = kin.start = kin.start._replace(
        position=np.array(pose.xyz, dtype=np.float64),
        rotation=rotation_from_quaternion(np.array(pose.xyzw)),
        reach=np.array(controller.phases.phases[0].pad),
    )


def _start(loaded: Loaded, model: RobotModel) -> Array:
    q = np.clip(np.zeros(model.nv), model.lower, model.upper)
    for name, value in loaded.scenario.robot.start.items():
        j = model.joint(name)
        q[j] = value.value
        if not model.lower[j] <= q[j] <= model.upper[j]:
            unit, factor = ("m", 1.0) if value.dimension == "length" else ("deg", 180.0 / math.pi)
            at, low, high = (factor * x for x in (q[j], model.lower[j], model.upper[j]))
            place = loaded.locate(("robot", "start", name))
            raise ScenarioError(
                f"{place}: joint '{name}' at {at:.4g} {unit} is outside its limits "
                f"[{low:.4g}, {high:.4g}] {unit}"
            )
    return q


def _settings(scenario: Scenario, model: RobotModel) -> Settings:
    limits = scenario.limits
    rate = scenario.supervisor.smoothing
    # a joint may have to hold back for those that follow it by more than its own motion
    fastest = np.zeros(model.nv)
    np.maximum.at(fastest, model.master, np.abs(model.ratio))
    acceleration = math.inf if limits.acceleration is None else limits.acceleration
    return Settings(
        dt=scenario.simulation.step,
        runge_kutta=scenario.simulation.integrator == "rk4",
        smoothing=math.inf if rate is None else float(rate),
        lower=model.lower,
        upper=model.upper,
        velocity=model.velocity * limits.velocity_scale,
        acceleration=acceleration / np.maximum(fastest, 1.0),
    )


__all__ = ["Assembly", "ContactMode", "build", "build_grasp", "build_surface"]
