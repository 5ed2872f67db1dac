"""The table of all task classes: how to make one in a world, and how it goes with the world.

A class that is not here fails the suite.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from conformance.worlds import PLACES, World, random_rotation, random_twist
from wbc.contact.surfaces import Surface
from wbc.robot.kinematics import Kinematics
from wbc.rotations import exp_so3
from wbc.tasks import (
    CenterOfMass,
    EquilibriumForce,
    EquilibriumMoment,
    FrameOrientation,
    FramePose,
    FramePosition,
    Manipulability,
    PalmDistance,
    Posture,
    RelativePose,
    Synergy,
    Task,
    TipPosition,
    pose_target,
)
from wbc.tasks.manipulability import manipulability_gradient
from wbc.tasks.synergy import SynergyMeasure

Draw = np.random.Generator
HALF_TURN = np.pi - 1e-3
"""Almost a half turn: farther from it than the steps of the finite differences."""


@dataclass(frozen=True)
class Example:
    """A task in a world that may have been changed to suit it, and the target to evaluate it at."""

    world: World
    task: Task
    target: np.ndarray | None


@dataclass(frozen=True)
class TaskCase:
    """One row of the table.

    Attributes:
        make: an Example for a world at one of `spots`.
        spots: where its Jacobian is compared: around the goal, or around where it comes into force.
        silent: spots at which no row is in force.
        places: configurations that matter to it.
        surfaces: it depends on the object's surface and on the contacts.
        step: of the finite differences; small for rows with a kink near by.
        move: the target after the world's rigid motion (R, t), and the matrix that turns the rows.
        lengths: exponents of the unit of length of its rows.
        stretch: the target in a world `s` times as large.
        advance: the target after the time t of its own feed-forward.
    """

    make: Callable[[World, Draw, str], Example]
    spots: tuple[str, ...] = ("goal", "far")
    silent: tuple[str, ...] = ()
    places: tuple[str, ...] = PLACES
    surfaces: bool = False
    step: float = 1e-5
    move: Callable[..., tuple[np.ndarray | None, np.ndarray]] = lambda task, target, r, t: (
        target,
        np.eye(task.rows),
    )
    lengths: Callable[[Task], tuple[int, ...]] = lambda task: (1,) * task.rows
    stretch: Callable[..., np.ndarray | None] = lambda target, s: target
    advance: Callable[..., np.ndarray | None] = lambda target, t: target


def frame(world: World, draw: Draw) -> int:
    """A tracked frame."""
    return int(draw.integers(len(world.kin.robot.frames)))


def settings(kind: str) -> dict[str, object]:
    return {"name": kind, "gain": 5.0, "saturation": 10.0}


# --- orientation and position targets -------------------------------------------------------------


def reference_rotation(r: np.ndarray, planar: bool, draw: Draw, spot: str) -> np.ndarray:
    """A reference at the goal, anywhere, almost or exactly half a turn away from r."""
    if spot == "goal":
        return r
    if spot == "far":
        return random_rotation(draw, planar) @ r
    axis = np.array([0.0, 0.0, 1.0])
    if not planar:
        axis = draw.normal(size=3)
        axis /= np.linalg.norm(axis)
    return exp_so3((HALF_TURN if spot == "half_turn" else np.pi) * axis) @ r


def reference_position(p: np.ndarray, planar: bool, draw: Draw, spot: str) -> np.ndarray:
    """A reference at the goal or up to some decimetres away from p."""
    offset = 0.3 * draw.normal(size=3) * np.array([1.0, 1.0, 0.0 if planar else 1.0])
    return p if spot == "goal" else p + offset


def move_pose(task: Task, target: np.ndarray, r: np.ndarray, t: np.ndarray):  # type: ignore[no-untyped-def]
    """A pose with its twist in the world's axes."""
    p, rotation, twist = target[:3], target[3:12].reshape(3, 3), target[12:]
    moved = pose_target(r @ p + t, r @ rotation, np.concatenate([r @ twist[:3], r @ twist[3:]]))
    if task.rows == 3:
        return moved, block(r[:2, :2], np.eye(1))
    return moved, block(r, r)


def block(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """diag(a, b)."""
    out = np.zeros((len(a) + len(b),) * 2)
    out[: len(a), : len(a)], out[len(a) :, len(a) :] = a, b
    return out


def stretch_pose(target: np.ndarray, s: float) -> np.ndarray:
    return target * np.array([s] * 3 + [1.0] * 9 + [s] * 3 + [1.0] * 3)


def advance_pose(target: np.ndarray, t: float) -> np.ndarray:
    rotation = exp_so3(t * target[15:]) @ target[3:12].reshape(3, 3)
    return pose_target(target[:3] + t * target[12:15], rotation, target[12:])


def pose_lengths(task: Task) -> tuple[int, ...]:
    return (1, 1, 0) if task.rows == 3 else (1, 1, 1, 0, 0, 0)


def frame_pose(world: World, draw: Draw, spot: str) -> Example:
    kin, f = world.update().robot, frame(world, draw)
    goal = pose_target(
        reference_position(kin.position[f], world.planar, draw, spot),
        reference_rotation(kin.rotation[f], world.planar, draw, spot),
        random_twist(draw, world.planar),
    )
    task = FramePose(**settings("pose"), frame=f, goal=goal, planar=world.planar)
    return Example(world, task, task.target)


def relative_pose(world: World, draw: Draw, spot: str) -> Example:
    kin = world.update().robot
    a, b = (int(k) for k in draw.choice(len(kin.frames), 2, replace=False))
    r_b = kin.rotation[b].T
    goal = pose_target(
        reference_position(r_b @ (kin.position[a] - kin.position[b]), world.planar, draw, spot),
        reference_rotation(r_b @ kin.rotation[a], world.planar, draw, spot),
        random_twist(draw, world.planar),
    )
    task = RelativePose(
        **settings("relative"), frame=a, relative_to=b, goal=goal, planar=world.planar
    )
    return Example(world, task, task.target)


def frame_orientation(world: World, draw: Draw, spot: str) -> Example:
    kin, f = world.update().robot, frame(world, draw)
    rotation = reference_rotation(kin.rotation[f], world.planar, draw, spot)
    goal = np.concatenate([rotation.ravel(), random_twist(draw, world.planar)[3:]])
    task = FrameOrientation(**settings("turn"), frame=f, goal=goal, planar=world.planar)
    return Example(world, task, task.target)


def move_orientation(task: Task, target: np.ndarray, r: np.ndarray, t: np.ndarray):  # type: ignore[no-untyped-def]
    rotation = (r @ target[:9].reshape(3, 3)).ravel()
    moved = np.concatenate([rotation, r @ target[9:]])
    return moved, (np.eye(1) if task.rows == 1 else r)


def advance_orientation(target: np.ndarray, t: float) -> np.ndarray:
    rotation = exp_so3(t * target[9:]) @ target[:9].reshape(3, 3)
    return np.concatenate([rotation.ravel(), target[9:]])


def frame_position(world: World, draw: Draw, spot: str) -> Example:
    kin, f = world.update().robot, frame(world, draw)
    p = reference_position(kin.position[f], world.planar, draw, spot)
    goal = np.concatenate([p, random_twist(draw, world.planar)[:3]])
    axes = np.arange(2 if world.planar else 3)
    task = FramePosition(**settings("position"), frame=f, axes=axes, goal=goal)
    return Example(world, task, task.target)


def center_of_mass(world: World, draw: Draw, spot: str) -> Example:
    kin = world.update().robot
    p = reference_position(kin.com, world.planar, draw, spot)
    goal = np.concatenate([p, random_twist(draw, world.planar)[:3]])
    task = CenterOfMass(**settings("com"), axes=np.arange(2 if world.planar else 3), goal=goal)
    return Example(world, task, task.target)


def move_point(task: Task, target: np.ndarray, r: np.ndarray, t: np.ndarray):  # type: ignore[no-untyped-def]
    return np.concatenate([r @ target[:3] + t, r @ target[3:]]), r[: task.rows, : task.rows]


def advance_half(target: np.ndarray, t: float) -> np.ndarray:
    """A target whose second half is the rate of its first."""
    m = len(target) // 2
    return np.concatenate([target[:m] + t * target[m:], target[m:]])


def posture(world: World, draw: Draw, spot: str) -> Example:
    joints = np.sort(draw.choice(world.nv, 4, replace=False))
    value = world.q[joints] if spot == "goal" else world.q[joints] + draw.normal(size=4)
    goal = np.concatenate([value, draw.normal(size=4)])
    task = Posture(**settings("posture"), joints=joints, goal=goal)
    return Example(world, task, task.target)


def synergy(measure: SynergyMeasure) -> Callable[[World, Draw, str], Example]:
    """Two synergies of four joints, of which the posture clips some."""

    def make(world: World, draw: Draw, spot: str) -> Example:
        joints = np.sort(draw.choice(world.nv, 4, replace=False))
        basis, goal = draw.normal(size=(4, 2)), draw.normal(size=4)
        posture = world.q[joints] if spot == "goal" else world.q[joints] + draw.normal(size=4)
        mean = posture - basis @ goal[:2]
        room = np.array([1.0, 1.0, 0.4, -0.4]) if spot == "far" else np.ones(4)
        task = Synergy(
            **settings("synergy"), joints=joints, mean=mean, basis=basis, lower=posture - 2.0,
            upper=posture + room, goal=goal, measure=measure,
        )  # fmt: skip
        return Example(world, task, task.target)

    return make


# --- tasks on the object --------------------------------------------------------------------------


def tip_position(world: World, draw: Draw, spot: str) -> Example:
    i = int(draw.integers(world.grasp.count))
    kin = world.update()
    tip = kin.object_rotation.T @ (kin.robot.position[i] - kin.object_position)
    point = reference_position(tip, world.planar, draw, spot)
    target = np.concatenate([point, random_twist(draw, world.planar)[:3]])
    task = TipPosition(**settings("tip"), finger=i, planar=world.planar)
    return Example(world, task, target)


def balanced(world: World, draw: Draw, off: float) -> World:
    """The world with its contacts in pairs at the two ends of an axis of the object, up to `off`.

    There normals and moments balance: all objects of the suite are symmetric to their origin.
    """
    surface, n = world.grasp.surface, world.grasp.count
    xi, face = world.state.xi.copy(), world.state.face.copy()
    for i in range(0, n, 2):
        end = np.eye(3)[draw.integers(2 if world.planar else 3)]
        for k, sign in ((i, 1.0), (i + 1, -1.0)):
            xi[k], face[k] = surface.project(sign * end)
            record = surface.charts(xi[k], int(face[k]))[0]
            # the same way on the surface whether its chart is in radians or in metres
            way = np.linalg.norm(record[0]) / np.linalg.norm(record[1:3], axis=1)
            xi[k] += off * draw.normal(size=2) * way * (1.0, 0.0 if world.planar else 1.0)
    return replace(world, state=world.state._replace(xi=xi, face=face))


def equilibrium(
    kind: type[Task], *, squared: bool = False, unequal: bool = False, **settings_of: bool
) -> Callable[[World, Draw, str], Example]:
    def make(world: World, draw: Draw, spot: str) -> Example:
        if unequal:  # but the two of a pair alike: they still balance
            world = world.with_shares(np.repeat(draw.uniform(0.3, 3.0, world.grasp.count // 2), 2))
        if spot != "far":
            world = balanced(world, draw, {"goal": 0.0, "near": 0.03}[spot])
        task = kind(**settings("balance"), squared=squared, **settings_of)  # type: ignore[call-arg]
        return Example(world, task, None)

    return make


def chain_of(robot: Kinematics, frame: int) -> tuple[np.ndarray, ...]:
    """What `manipulability_gradient` reads of a tracked frame."""
    model = robot.model
    return (
        robot.joint_jacobian, robot.position[frame], robot.linear[frame], robot.chains[frame],
        robot.leads[frame], model.master, model.ratio,
    )  # fmt: skip


def manipulability(*, squared: bool) -> Callable[[World, Draw, str], Example]:
    def make(world: World, draw: Draw, spot: str) -> Example:
        robot = world.update().robot
        fingers = np.arange(world.grasp.count)
        size = 2 if world.planar else 3
        zero = np.zeros(world.nv)
        w = [manipulability_gradient(*chain_of(robot, f), size, zero.copy()) for f in fingers]
        threshold = {"deep": 1.5 * max(w), "just_below": min(w) * 1.003, "above": 0.9 * min(w)}
        task = Manipulability(
            **settings("dexterity"), fingers=fingers, threshold=threshold[spot],
            band=0.2 * max(w), planar=world.planar, squared=squared,
        )  # fmt: skip
        return Example(world, task, None)

    return make


def manipulability_lengths(task: Task) -> tuple[int, ...]:
    assert isinstance(task, Manipulability)
    return ((2 if task.planar else 3) * (2 if task.squared else 1),) * task.rows


def palm_distance(world: World, draw: Draw, spot: str) -> Example:
    """The region has the object's surface; the object is put where the palm is at that depth."""
    region: Surface = world.grasp.surface
    robot = world.update().robot
    f = world.grasp.count
    i = int(draw.integers(world.grasp.count))
    point = world.kin.charts[i, 0]
    size = float(np.linalg.norm(point))
    depth = {"deep": 0.1, "just_inside": 3e-3, "outside": -0.02}[spot] * size
    palm = point - depth * world.kin.frame[i, :, 2]
    reference = world.reference._replace(
        position=robot.position[f] - world.reference.rotation @ palm
    )
    task = PalmDistance(**settings("palm"), frame=f, region=region, band=0.05 * size)
    return Example(replace(world, reference=reference), task, None)


ORIENTATION_SPOTS = ("goal", "far", "half_turn")

TASKS: dict[type[Task], tuple[TaskCase, ...]] = {
    FramePose: (
        TaskCase(
            frame_pose, ORIENTATION_SPOTS, move=move_pose, lengths=pose_lengths,
            stretch=stretch_pose, advance=advance_pose,
        ),
    ),
    FramePosition: (
        TaskCase(
            frame_position, move=move_point, stretch=lambda target, s: s * target,
            advance=advance_half,
        ),
    ),
    FrameOrientation: (
        TaskCase(
            frame_orientation, ORIENTATION_SPOTS, move=move_orientation,
            lengths=lambda task: (0,) * task.rows, advance=advance_orientation,
        ),
    ),
    RelativePose: (
        TaskCase(
            relative_pose, ORIENTATION_SPOTS, lengths=pose_lengths, stretch=stretch_pose,
            advance=advance_pose,
        ),
    ),
    Posture: (
        TaskCase(posture, lengths=lambda task: (0,) * task.rows, advance=advance_half),
    ),
    Synergy: tuple(
        TaskCase(
            synergy(measure), lengths=lambda task: (0,) * task.rows, advance=advance_half
        )
        for measure in get_args(SynergyMeasure)
    ),
    CenterOfMass: (
        TaskCase(
            center_of_mass, move=move_point, stretch=lambda target, s: s * target,
            advance=advance_half,
        ),
    ),
    TipPosition: (
        TaskCase(
            tip_position, surfaces=True, stretch=lambda target, s: s * target,
            advance=advance_half,
        ),
    ),
    EquilibriumForce: (
        *(
            TaskCase(
                equilibrium(EquilibriumForce, squared=squared, unequal=unequal), ("near", "far"),
                places=("random", "limits"), surfaces=True, step=1e-6, lengths=lambda task: (0,),
            )
            for squared, unequal in ((False, False), (True, False), (False, True), (True, True))
        ),
        TaskCase(
            equilibrium(EquilibriumForce, unequal=True, vector=True), ("goal", "near", "far"),
            places=("random",), surfaces=True, step=1e-6, lengths=lambda task: (0, 0, 0),
        ),
    ),
    EquilibriumMoment: (
        *(
            TaskCase(
                equilibrium(EquilibriumMoment, squared=squared, unequal=unequal), ("near", "far"),
                places=("random", "limits"), surfaces=True, step=1e-6,
                lengths=(lambda task: (2,)) if squared else (lambda task: (1,)),
            )
            for squared, unequal in ((False, False), (True, False), (False, True), (True, True))
        ),
        *(
            TaskCase(
                equilibrium(EquilibriumMoment, unequal=True, vector=vector, about_contacts=True),
                ("goal", "near", "far") if vector else ("near", "far"),
                places=("random",), surfaces=True, step=1e-6,
                lengths=(lambda task: (1, 1, 1)) if vector else (lambda task: (1,)),
            )
            for vector in (False, True)
        ),
    ),
    Manipulability: tuple(
        TaskCase(
            manipulability(squared=squared), ("deep", "just_below"), ("above",),
            lengths=manipulability_lengths,
        )
        for squared in (False, True)
    ),
    PalmDistance: (
        TaskCase(palm_distance, ("deep", "just_inside"), ("outside",), surfaces=True),
    ),
}  # fmt: skip
"""Every task class, with its variants."""
