"""Situations to test in: a robot, an object and its fingers' contacts at one configuration.

A world holds definitions and values only; `update` brings its workspace to them. The fingers need
not agree where the object is: each extended finger is a chain of its own.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from conformance.robots import SETTINGS, STILL, Motion, robot
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.contact.grasp import ContactMode, ContactState, Grasp, ObjectReference, no_grasp
from wbc.contact.surfaces import Surface
from wbc.contact.surfaces.box import Box
from wbc.contact.surfaces.circle import Circle
from wbc.contact.surfaces.cylinder import Cylinder
from wbc.contact.surfaces.ellipse import Ellipse
from wbc.contact.surfaces.fourier_contour import FourierContour
from wbc.contact.surfaces.sphere import Sphere
from wbc.contact.surfaces.spheroid import Spheroid
from wbc.contact.surfaces.superellipse import Superellipse
from wbc.contact.surfaces.superellipsoid import Superellipsoid
from wbc.robot.kinematics import Kinematics
from wbc.rotations import exp_so3

GAIN = 50.0

SURFACE_SAMPLES: dict[str, Callable[[float], Surface]] = {
    "circle": lambda s: Circle(radius=0.4 * s),
    "ellipse": lambda s: Ellipse(a=0.5 * s, b=0.3 * s),
    "superellipse": lambda s: Superellipse(a=0.5 * s, b=0.3 * s, p=4.0),
    "fourier_contour": lambda s: FourierContour(a=0.5 * s, b=0.36 * s, h=0.06 * s),
    "sphere": lambda s: Sphere(radius=0.06 * s),
    "spheroid": lambda s: Spheroid(a=0.06 * s, b=0.04 * s),
    "cylinder": lambda s: Cylinder(radius=0.05 * s, length=0.15 * s),
    "superellipsoid": lambda s: Superellipsoid(ax=0.07 * s, ay=0.05 * s, az=0.04 * s, p=4.0),
    "box": lambda s: Box(size=(0.1 * s, 0.07 * s, 0.05 * s)),
}
"""One object per row of SURFACES, by its scale."""

CONTOURS = tuple(k for k, make in SURFACE_SAMPLES.items() if make(1.0).planar)
BODIES = tuple(k for k in SURFACE_SAMPLES if k not in CONTOURS)
ROBOT_SURFACES = [
    *(("planar", s) for s in CONTOURS),
    *(("hand", s) for s in BODIES),
    ("coupled", "spheroid"),
]
DEFAULT_SURFACE = {"planar": "fourier_contour", "hand": "spheroid", "coupled": "spheroid"}

PLACES = ("random", "limits", "stretched")
FREE, FIXED, SLIDING = ContactMode.FREE, ContactMode.FIXED, ContactMode.SLIDING


@dataclass(frozen=True)
class World:
    """One situation.

    Attributes:
        robot_name: key of SETTINGS.
        kin: workspace.
        q, state, reference: what it is brought to.
    """

    robot_name: str
    kin: ExtendedKinematics
    q: np.ndarray
    state: ContactState
    reference: ObjectReference

    @property
    def grasp(self) -> Grasp:
        return self.kin.grasp

    @property
    def planar(self) -> bool:
        return self.grasp.planar

    @property
    def nv(self) -> int:
        return self.kin.robot.model.nv

    @property
    def columns(self) -> int:
        return self.nv + 2 * self.grasp.count

    def update(self) -> ExtendedKinematics:
        return self.kin.update(self.q, self.state, self.reference)

    def at(self, q_ext: np.ndarray) -> World:
        """The same world at another [q, ξ]."""
        xi = q_ext[self.nv :].reshape(-1, 2).copy()
        return replace(self, q=q_ext[: self.nv].copy(), state=self.state._replace(xi=xi))

    def with_shares(self, share: np.ndarray) -> World:
        """The same world whose fingers press unequally, (N,)."""
        grasp = replace(self.grasp, share=share)
        return replace(self, kin=type(self.kin)(self.kin.robot, grasp, self.kin.gain))

    @property
    def q_ext(self) -> np.ndarray:
        return np.concatenate([self.q, self.state.xi.ravel()])


def seeded(*key: object) -> np.random.Generator:
    """A generator for the test that is named by `key`, the same on every machine."""
    return np.random.default_rng(zlib.crc32(repr(key).encode()))


def random_rotation(rng: np.random.Generator, planar: bool) -> np.ndarray:
    turn = rng.normal(size=3)
    turn *= rng.uniform(0.1, 3.0) / np.linalg.norm(turn)
    return exp_so3(np.array([0.0, 0.0, turn[2]]) if planar else turn)


def random_twist(rng: np.random.Generator, planar: bool) -> np.ndarray:
    twist = rng.normal(size=6)
    return twist * np.array([1, 1, 0, 0, 0, 1.0]) if planar else twist


def random_contact(surface: Surface, rng: np.random.Generator, rim: bool) -> tuple[np.ndarray, int]:
    """Chart coordinates and face of a point fit for contact; near its chart's bound if `rim`."""
    found = []
    while len(found) < (40 if rim else 1):
        face = int(rng.integers(len(surface.faces)))
        domain = surface.domain(face)
        low, high = np.array(domain.lower), np.array(domain.upper)
        bounded = np.isfinite(low)
        xi = np.where(
            bounded, rng.uniform(np.where(bounded, low, 0), np.where(bounded, high, 1)), 0
        )
        if surface.margin(xi, face) > 0.0:
            found.append((surface.margin(xi, face), xi, face))
    _, xi, face = min(found, key=lambda entry: entry[0])
    return xi, face


def configuration(model, place: str, rng: np.random.Generator) -> np.ndarray:  # type: ignore[no-untyped-def]
    """A q at a place: anywhere, every joint on a limit or almost, or the chains nearly straight."""
    if place == "random":
        return rng.uniform(0.9 * model.lower, 0.9 * model.upper)
    if place == "limits":
        q = np.where(rng.random(model.nv) < 0.5, model.lower, model.upper)
        inside = rng.random(model.nv) < 0.5
        return q - np.where(inside, 1e-3, 0.0) * np.sign(q)
    return 0.03 * rng.uniform(-1.0, 1.0, model.nv)


def unpacked(rates: np.ndarray, fingers: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q̇, ξ̇ (N, 2) and θ̇ (N, 3) of a velocity of q̃."""
    first, last = len(rates) - 5 * fingers, len(rates) - 3 * fingers
    return rates[:first], rates[first:last].reshape(-1, 2), rates[last:].reshape(-1, 3)


def make_world(
    robot_name: str,
    surface: str | None = None,
    modes: tuple[ContactMode, ...] | ContactMode = FREE,
    place: str = "random",
    *,
    seed: object = 0,
    prismatic: bool = True,
) -> World:
    """A world drawn at random for its arguments."""
    surface = surface or DEFAULT_SURFACE[robot_name]
    rng = seeded(robot_name, surface, place, seed)
    setting, model = SETTINGS[robot_name], robot(robot_name, prismatic=prismatic)
    body = SURFACE_SAMPLES[surface](1.0)
    n = len(setting.tips)
    contacts = [random_contact(body, rng, place == "limits") for _ in range(n)]
    grasp = Grasp(
        body, setting.tips, np.array([xi for xi, _ in contacts]),
        np.array([face for _, face in contacts], dtype=np.int64),
        np.full(n, 5e4), rng.uniform(0.005, 0.02, n), np.ones(n), model.planar,
    )  # fmt: skip
    if isinstance(modes, ContactMode):
        modes = (modes,) * n
    state = ContactState(
        np.array(modes, dtype=np.int64), grasp.at.copy(),
        np.stack([random_rotation(rng, False) for _ in range(n)]), grasp.face.copy(),
        np.zeros((n, 3)),
    )  # fmt: skip
    position = rng.normal(size=3) * np.array([0.3, 0.3, 0.0 if model.planar else 0.3])
    reference = ObjectReference(
        position, random_rotation(rng, model.planar), 0.2 * random_twist(rng, model.planar),
        grasp.rest_length * rng.uniform(0.5, 1.0, n), rng.normal(size=n) * 0.01,
    )  # fmt: skip
    kin = _workspace(robot_name, model, grasp)
    q = configuration(model, place, rng)
    world = World(robot_name, kin, q, state, reference)
    return _keep_in_plane(world) if model.planar else world


def without_object(robot_name: str, place: str = "random") -> World:
    """A robot alone."""
    full = make_world(robot_name, place=place)
    grasp = no_grasp(full.planar)
    state = ContactState.planned(grasp, np.zeros(0, dtype=np.int64))
    reference = full.reference._replace(reach=np.zeros(0), reach_rate=np.zeros(0))
    kin = _workspace(robot_name, full.kin.robot.model, grasp)
    return replace(full, kin=kin, state=state, reference=reference)


def _workspace(robot_name, model, grasp) -> ExtendedKinematics:  # type: ignore[no-untyped-def]
    setting = SETTINGS[robot_name]
    kinematics = Kinematics(model, setting.tips + setting.others, track_com=True)
    return ExtendedKinematics(kinematics, grasp, GAIN)


def _keep_in_plane(world: World) -> World:
    """Pivots R_FC with which the planar fingers see the object turned about z alone."""
    kin = world.update()
    turns = [random_rotation(seeded(i, *world.q), True) for i in range(world.grasp.count)]
    pivot = np.stack([turn @ kin.frame[i] for i, turn in enumerate(turns)])
    return replace(world, state=world.state._replace(pivot=pivot))


def moved(world: World, motion: Motion) -> World:
    """The world after a rigid motion of everything in it."""
    r, model = motion.rotation, robot(world.robot_name, motion)
    v = world.reference.twist
    reference = world.reference._replace(
        position=r @ world.reference.position + motion.translation,
        rotation=r @ world.reference.rotation,
        twist=np.concatenate([r @ v[:3], r @ v[3:]]),
    )
    return replace(world, kin=_workspace(world.robot_name, model, world.grasp), reference=reference)


def scaled(world: World, surface: str, scale: float) -> World:
    """The world with all lengths times `scale`; the robot must have no prismatic joint."""
    model = robot(world.robot_name, STILL, scale, prismatic=False)
    body = SURFACE_SAMPLES[surface](scale)
    points = world.grasp.surface.charts(world.state.xi, world.state.face)[:, 0]
    xi = np.array(
        [
            body.project(scale * p, int(face))[0]
            for p, face in zip(points, world.state.face, strict=True)
        ]
    )
    grasp = replace(world.grasp, surface=body, at=xi, rest_length=scale * world.grasp.rest_length)
    lengths = np.array([scale] * 3 + [1.0] * 3)
    reference = world.reference._replace(
        position=scale * world.reference.position,
        twist=lengths * world.reference.twist,
        reach=scale * world.reference.reach,
        reach_rate=scale * world.reference.reach_rate,
    )
    return replace(
        world,
        kin=_workspace(world.robot_name, model, grasp),
        state=world.state._replace(xi=xi),
        reference=reference,
    )


def central_difference(f: Callable[[float], np.ndarray], step: float = 1e-5) -> np.ndarray:
    """df/dt at 0 by the central formula of fourth order."""
    return (f(-2 * step) - 8 * f(-step) + 8 * f(step) - f(2 * step)) / (12 * step)
