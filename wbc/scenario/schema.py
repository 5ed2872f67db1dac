"""The blocks of a scenario file, typed. Values are in SI once read.

Each value is judged here; what two values say together, in `relations` and `crosscheck`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Final, Literal, TypeAlias, final

from pydantic import Field

from wbc.scenario.blocks import (
    AutoOrPairs,
    Block,
    Count,
    Entries,
    Face,
    Flag,
    Form,
    Pairs,
    Pose,
    Text,
    Vector3,
    Weights,
)
from wbc.scenario.disturbance_blocks import Disturbances, Share
from wbc.scenario.dynamic_blocks import ForceControl, Physics
from wbc.scenario.force_blocks import Contents, Forces, Inertia3
from wbc.scenario.kinds import AnyCost, AnySurface, AnyTask
from wbc.scenario.units import (
    AngularAcceleration,
    Distance,
    Force,
    JointValue,
    NonNegative,
    PositiveForce,
    PositiveLength,
    PositiveMass,
    PositiveNumber,
    PositiveTime,
    Quantity,
    RateOrOff,
    Stiffness,
    Time,
)

MAX_TICKS: Final = 10_000_000
ContactType: TypeAlias = Literal["fixed", "sliding"]


@final
class Collisions(Block):
    """Which bodies are watched for collision."""

    pairs: AutoOrPairs = Field(
        default=None, description="auto: all that can meet, fewer those of the SRDF"
    )
    ignore: Pairs = Field(default=(), description="pairs of links to leave out")
    shapes: Literal["capsules", "exact"] = Field(
        default="capsules",
        description="capsules about bodies where they fit; exact: as in the URDF, meshes as hulls",
    )


@final
class Robot(Block):
    """The robot, its fingers and where it starts."""

    urdf: Text = Field(
        description="a name in urdf/, a path beside this file, or package://NAME/..."
    )
    srdf: Text | None = None
    fingers: Mapping[str, Text] = Field(
        default={}, description="finger: frame of its tip; a name more for each place it touches"
    )
    start: Mapping[str, JointValue] = Field(
        default={}, description="joint: position; fingers that hold are then closed on the object"
    )
    metric: Mapping[str, PositiveNumber] = Field(
        default={}, description="joint: weight in the pseudo-inverse, 1 where not given"
    )
    collisions: Collisions = Field(default_factory=Collisions)


@final
class Object(Block):
    """The object that the fingers hold."""

    surface: AnySurface
    pose: Pose
    mass: PositiveMass | None = Field(default=None, description="without its contents")
    com: Vector3 = Field(default=(0.0, 0.0, 0.0), description="centre of mass, object's axes")
    inertia: Inertia3 = Field(
        default=(0.0, 0.0, 0.0), description="about its centre of mass, principal: object's axes"
    )
    contents: Contents | None = None


@final
class Contact(Block):
    """Where a finger touches the object, and its spring."""

    at: Annotated[tuple[JointValue, ...], Entries(1, 2)] = Field(
        description="chart coordinates of the surface, one in the plane, two in space"
    )
    face: Face | None = Field(default=None, description="index or name of the surface's chart")
    stiffness: Stiffness = 5e4
    rest_length: Distance = 5e-3
    force: Force = Field(default=0.0, description="normal force wanted at the start")
    share: PositiveNumber = Field(
        default=1.0, description="how hard it presses beside the others where the grasp balances"
    )


@final
class Stack(Block):
    """The order of the tasks and the law that resolves them."""

    form: Form = "settled"
    priority: Annotated[tuple[str, ...], Entries(1, 0)] = Field(
        description="tasks, the main one first"
    )
    gradient_gain: NonNegative = Field(default=0.1, description="how fast the costs descend")


@final
class Supervisor(Block):
    """When a task leaves the stack for the sake of a cost, and when it comes back."""

    remove_above: PositiveNumber = 0.05
    insert_below: PositiveNumber = 0.02
    horizon: PositiveTime = Field(
        default=0.02, description="how far ahead a task's return is judged"
    )
    smoothing: RateOrOff = Field(
        default=20.0, description="rate of the smooth switch; off: at once"
    )
    dwell: Time = Field(default=0.0, description="shortest time from a switch to a task's return")


@final
class Limits(Block):
    """What the filter after the stack enforces, beyond the URDF's own limits."""

    acceleration: AngularAcceleration | None = None
    velocity_scale: Annotated[float, Quantity("number", above=0.0, most=1.0)] = Field(
        default=1.0, description="fraction of the URDF's velocity limits that may be used"
    )


@final
class Reach(Block):
    """A free tip goes to its contact point."""

    clearance: Distance = Field(description="how far outside the surface")
    offset: Vector3 = Field(
        default=(0.0, 0.0, 0.0), description="and how far beside that, in the object's axes"
    )


@final
class Motion(Block):
    """A minimum-jerk motion of the object."""

    target: Pose
    relative: Flag = Field(
        default=False,
        description="target is a displacement from the pose at the start, in the world's axes",
    )


@final
class Touch(Block):
    """Fingers that reach stop where they feel the object."""

    force: PositiveForce = Field(default=0.15, description="at which a finger feels it")
    search: Distance = Field(
        default=6e-3, description="how far on a finger goes from where the surface is believed"
    )


@final
class Until(Block):
    """When a phase is over: when all of these hold."""

    time: Time | None = None
    residual: Mapping[str, PositiveNumber] = Field(
        default={}, description="task: norm of its error"
    )
    tip_error: PositiveLength | None = Field(default=None, description="of the fingers that reach")
    distance: PositiveLength | None = Field(
        default=None, description="of the fingers that reach, from the object"
    )
    force_closure: Flag | None = Field(
        default=None, description="also of the fingers that will hold alone afterwards"
    )
    touch: Touch | None = Field(
        default=None, description="every finger that reaches has felt the object"
    )
    press: Share | None = Field(
        default=None, description="part of its planned force that each holding finger presses with"
    )


@final
class Timeout(Block):
    """What happens when a phase takes too long."""

    after: PositiveTime
    then: Literal["stop", "next", "hold"]


@final
class Phase(Block):
    """A part of the exchange: who holds, who moves, what is asked for, and when it is over."""

    name: Text
    contacts: Mapping[str, ContactType] = {}
    reach: Mapping[str, Reach] = {}
    tasks: tuple[str, ...] = Field(default=(), description="beside the main task")
    force: Mapping[str, Force] = Field(default={}, description="finger: normal force at the end")
    object: Motion | None = None
    weights: Mapping[str, Weights] = Field(
        default={}, description="synergy task: where its weights go during 'over'"
    )
    over: PositiveTime | None = Field(
        default=None, description="duration of what moves in this phase"
    )
    until: Until | None = Field(
        default=None, description="all must hold; the end of the run if not given"
    )
    timeout: Timeout | None = None


@final
class Simulation(Block):
    """How the run is computed."""

    engine: Literal["kinematic", "compliant", "mujoco"] = Field(
        default="kinematic",
        description="kinematic: joints follow exactly; else the second stage's torques move them",
    )
    duration: PositiveTime
    step: PositiveTime
    integrator: Literal["rk4", "euler"] = "rk4"
    seed: Count = 0
    rehearse: Flag = Field(
        default=False, description="before it moves, a run goes through the phases quickly"
    )
    disturbances: Disturbances | None = Field(
        default=None, description="what is wrong on purpose, drawn by the seed"
    )
    physics: Physics = Field(default_factory=Physics)


@final
class Scenario(Block):
    """A robot, what it holds, what it is asked to do, and for how long."""

    name: Text
    description: str = ""
    robot: Robot
    object: Object | None = None
    contacts: Mapping[str, Contact] = {}
    tasks: Mapping[str, AnyTask]
    costs: Mapping[str, AnyCost] = {}
    stack: Stack
    supervisor: Supervisor = Field(default_factory=Supervisor)
    limits: Limits = Field(default_factory=Limits)
    phases: tuple[Phase, ...] = ()
    forces: Forces | None = Field(default=None, description="needs the object's mass")
    force_control: ForceControl | None = Field(
        default=None, description="the second stage; needed by engines other than kinematic"
    )
    simulation: Simulation
