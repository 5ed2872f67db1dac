"""What a scenario may name by `type`: surfaces, tasks, costs."""

from __future__ import annotations

from typing import Annotated, ClassVar, Final, Literal, TypeAlias, final, get_args

from pydantic import Field

from wbc.scenario.blocks import (
    AutoOrPairs,
    Axis,
    Block,
    Entries,
    Form,
    PerJoint,
    Pose,
    Rotation,
    Text,
    Vector3,
    Weights,
)
from wbc.scenario.units import (
    Coordinate,
    Distance,
    Length,
    NonNegative,
    PositiveLength,
    PositiveNumber,
    Quantity,
    Rate,
)

Exponent: TypeAlias = Annotated[float, Quantity("number", least=2.0)]
Size3: TypeAlias = Annotated[tuple[PositiveLength, PositiveLength, PositiveLength], Entries(3)]
Axes: TypeAlias = Annotated[tuple[Axis, ...], Entries(1, 3)]
Measure: TypeAlias = Literal["norm", "vector", "squared"]


class SurfaceSpec(Block):
    """The shape of an object or of a region.

    Attributes:
        faces: names of the charts, in the order of their indices.
        chart: dimensions of the coordinates on the first face.
    """

    faces: ClassVar[tuple[str, ...]]
    chart: ClassVar[tuple[str, ...]]

    @property
    def planar(self) -> bool:
        """Whether the surface is a contour in the plane."""
        return len(self.chart) == 1

    @classmethod
    def chart_on(cls, face: object) -> tuple[str, ...]:
        """Dimensions of the coordinates on a face, given by name or index."""
        return cls.chart


class ContourSpec(SurfaceSpec):
    """A contour in the plane, by one angle."""

    faces = ("contour",)
    chart = ("angle",)


class PolarSpec(SurfaceSpec):
    """A body under longitude and latitude; the face says which axis holds the poles."""

    faces = ("poles_z", "poles_x", "poles_y")
    chart = ("angle", "angle")


@final
class CircleSpec(ContourSpec):
    """A circle in the plane."""

    type: Literal["circle"]
    radius: PositiveLength


@final
class EllipseSpec(ContourSpec):
    """(a cos u, b sin u)."""

    type: Literal["ellipse"]
    a: PositiveLength
    b: PositiveLength


@final
class SuperellipseSpec(ContourSpec):
    """|x/a|^p + |y/b|^p = 1, with p the exponent."""

    type: Literal["superellipse"]
    a: PositiveLength
    b: PositiveLength
    exponent: Exponent


@final
class FourierContourSpec(ContourSpec):
    """(a cos u, b sin u + h sin 3u): waisted for h > 0."""

    type: Literal["fourier_contour"]
    a: PositiveLength
    b: PositiveLength
    h: Length


@final
class SphereSpec(PolarSpec):
    """A sphere."""

    type: Literal["sphere"]
    radius: PositiveLength


@final
class SpheroidSpec(PolarSpec):
    """An ellipsoid of revolution about z: half axis b along z, a across."""

    type: Literal["spheroid"]
    a: PositiveLength
    b: PositiveLength


@final
class CylinderSpec(SurfaceSpec):
    """A cylinder about z, centred on its origin."""

    faces = ("side", "top", "bottom")
    chart = ("angle", "length")
    type: Literal["cylinder"]
    radius: PositiveLength
    length: PositiveLength

    @classmethod
    def chart_on(cls, face: object) -> tuple[str, ...]:
        """Angle and height on the side, x and y on the ends."""
        return cls.chart if face in (None, 0, "side") else ("length", "length")


@final
class SuperellipsoidSpec(PolarSpec):
    """|2x/X|^p + |2y/Y|^p + |2z/Z|^p = 1, with size [X, Y, Z] and p the exponent."""

    type: Literal["superellipsoid"]
    size: Size3
    exponent: Exponent


@final
class BoxSpec(SurfaceSpec):
    """A box of full lengths `size`; a contact also names the face."""

    faces = ("x+", "x-", "y+", "y-", "z+", "z-")
    chart = ("length", "length")
    type: Literal["box"]
    size: Size3


AnySurface: TypeAlias = Annotated[
    CircleSpec
    | EllipseSpec
    | SuperellipseSpec
    | FourierContourSpec
    | SphereSpec
    | SpheroidSpec
    | CylinderSpec
    | SuperellipsoidSpec
    | BoxSpec,
    Field(discriminator="type"),
]


class TaskSpec(Block):
    """What every task has."""

    gain: Rate = Field(description="K: the error decays as exp(-gain t)")
    saturation: PositiveNumber | None = Field(
        default=None, description="largest norm of the error that is acted on"
    )


@final
class ObjectPoseSpec(TaskSpec):
    """The object follows its reference through every finger that holds it."""

    type: Literal["object_pose"]


@final
class EquilibriumForceSpec(TaskSpec):
    """The unit frictionless forces of the co-grasp balance."""

    type: Literal["equilibrium_force"]
    measure: Measure = "norm"


@final
class EquilibriumMomentSpec(TaskSpec):
    """The moments of the unit frictionless forces balance."""

    type: Literal["equilibrium_moment"]
    measure: Measure = "norm"
    about: Literal["object", "contacts"] = Field(
        default="object", description="its origin, as published, or the centre of what slides"
    )


@final
class ManipulabilitySpec(TaskSpec):
    """Each finger's manipulability stays above a threshold."""

    type: Literal["manipulability"]
    threshold: PositiveNumber
    band: PositiveNumber = Field(description="over how much shortfall the task fades in")
    fingers: tuple[str, ...] | None = Field(default=None, description="all of them when not given")
    measure: Literal["shortfall", "squared"] = "shortfall"


@final
class PalmDistanceSpec(TaskSpec):
    """A frame stays outside a region around the object."""

    type: Literal["palm_distance"]
    frame: str
    region: AnySurface
    band: PositiveLength = Field(description="over what depth inside the region the task fades in")


@final
class FramePoseSpec(TaskSpec):
    """A frame's pose in the world; where it starts when no target is given."""

    type: Literal["frame_pose"]
    frame: str
    target: Pose | None = None


@final
class FramePositionSpec(TaskSpec):
    """A frame's position in the world, or some of its axes."""

    type: Literal["frame_position"]
    frame: str
    target: Vector3
    axes: Axes = ("x", "y", "z")


@final
class FrameOrientationSpec(TaskSpec):
    """A frame's orientation in the world."""

    type: Literal["frame_orientation"]
    frame: str
    target: Rotation


@final
class RelativePoseSpec(TaskSpec):
    """A frame's pose in another frame."""

    type: Literal["relative_pose"]
    frame: str
    reference: str
    target: Pose


@final
class PostureSpec(TaskSpec):
    """Joint positions: the target's, or the start's for the joints listed."""

    type: Literal["posture"]
    target: PerJoint | None = None
    joints: tuple[str, ...] | None = Field(
        default=None, description="names or patterns like left_arm_*; all when not given"
    )


@final
class SynergySpec(TaskSpec):
    """A hand's joints within the few directions in which they move together."""

    type: Literal["synergy"]
    synergies: Text = Field(default="dexmart", description="the published ones, or a file's")
    prefix: str = Field(
        default="", description="what the robot's joint names have before those of the synergies"
    )
    measure: Literal["weights", "outside", "posture"] = Field(
        default="weights",
        description="the weights, leaving other directions free; what is outside the synergies; "
        "or every joint, clipped to its range",
    )
    weights: Weights | None = Field(
        default=None, description="a list, or a name: open, zero_offset, C27; else as it starts"
    )
    path: Literal["smooth", "linear"] = Field(
        default="smooth", description="how a phase's weights are gone to"
    )


@final
class CenterOfMassSpec(TaskSpec):
    """The robot's centre of mass, or some of its axes."""

    type: Literal["center_of_mass"]
    target: Vector3
    axes: Axes = ("x", "y", "z")


AnyTask: TypeAlias = Annotated[
    ObjectPoseSpec
    | EquilibriumForceSpec
    | EquilibriumMomentSpec
    | ManipulabilitySpec
    | PalmDistanceSpec
    | FramePoseSpec
    | FramePositionSpec
    | FrameOrientationSpec
    | RelativePoseSpec
    | PostureSpec
    | SynergySpec
    | CenterOfMassSpec,
    Field(discriminator="type"),
]


class CostSpec(Block):
    """What every cost has."""

    weight: NonNegative = Field(default=1.0, description="gamma of the sum of costs")
    form: Form = "settled"


@final
class JointLimitsSpec(CostSpec):
    """Rises as a joint comes near a soft limit, which lies inside the URDF's."""

    type: Literal["joint_limits"]
    lower: PerJoint = Field(default={})
    upper: PerJoint = Field(default={})
    margin: Annotated[float, Quantity("number", least=0.0, most=0.45)] = Field(
        default=0.0,
        description="of joints not in lower or upper: part of the range kept free at both ends",
    )
    stiffness: PositiveNumber
    delta: PositiveNumber = Field(description="steepness [1/rad^2]")


@final
class CollisionSpec(CostSpec):
    """Rises as two bodies come nearer than the safety distance."""

    type: Literal["collision"]
    safety_distance: PositiveLength
    stiffness: PositiveNumber = 1.0
    floor: Distance | None = Field(
        default=None, description="distance below which the cost's slope stays"
    )
    pairs: AutoOrPairs = Field(default=None, description="auto: those of the robot")


AnyCost: TypeAlias = Annotated[JointLimitsSpec | CollisionSpec, Field(discriminator="type")]


def limit_of(values: PerJoint, joint: str) -> Coordinate | None:
    """The value for `joint`: its own, else that of all joints, else None."""
    return values.get(joint, values.get("*"))


def _by_type(union: object) -> dict[str, type[Block]]:
    members: tuple[type[Block], ...] = get_args(get_args(union)[0])
    return {get_args(m.model_fields["type"].annotation)[0]: m for m in members}


SURFACES: Final = _by_type(AnySurface)
TASKS: Final = _by_type(AnyTask)
COSTS: Final = _by_type(AnyCost)
