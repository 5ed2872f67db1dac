"""The table of all cost classes: how to make one for a world.

A class that is not here fails the suite.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from conformance.robots import robot
from conformance.worlds import PLACES, SURFACE_SAMPLES, World
from wbc.costs import Collision, Cost, JointLimits
from wbc.robot.collision_scene import OBJECT, CollisionScene, collision_scene, with_object
from wbc.robot.distances import Distances
from wbc.robot.pruning import prune

Draw = np.random.Generator
SAFETY, FLOOR = 0.5, 0.02


@dataclass(frozen=True)
class CostExample:
    """A cost in a world, with the distances it looks at (None: it needs none)."""

    world: World
    cost: Cost
    distances: Distances | None

    def at(self, q: np.ndarray) -> float:
        """C at another configuration, the object at rest."""
        self.bring(q)
        return self.cost.value(self.world.kin.robot, self.distances)

    def gradient(self) -> tuple[float, np.ndarray]:
        """C and γ ∂C/∂q at the world's configuration."""
        self.bring(self.world.q)
        out = np.zeros(self.world.nv)
        value = self.cost.add_gradient(self.world.kin.robot, self.distances, out)
        return value, out

    def bring(self, q: np.ndarray) -> None:
        kin = self.world.kin.robot.update(q)
        if self.distances is not None:
            self.distances.update(kin, self.world.reference.position, self.world.reference.rotation)


@dataclass(frozen=True)
class CostCase:
    """One row of the table.

    Attributes:
        make: a CostExample for a world at one of `spots`.
        spots: where its gradient is compared.
        silent: spots where it must be zero.
        robots: robots that it can look at.
        places: configurations that matter to it.
    """

    make: Callable[[World, Draw, str], CostExample]
    spots: tuple[str, ...]
    silent: tuple[str, ...]
    robots: tuple[str, ...] = ("planar", "hand", "coupled")
    places: tuple[str, ...] = PLACES


def joint_limits(*, printed: bool) -> Callable[[World, Draw, str], CostExample]:
    def make(world: World, draw: Draw, spot: str) -> CostExample:
        beyond = draw.uniform(0.05, 0.6, world.nv)
        if spot == "mixed":
            beyond[::2] = 0.0
        if spot == "inside":
            beyond[:] = 0.0
        below = draw.random(world.nv) < 0.5
        lower = np.where(below, world.q + beyond, world.q - 2.0) - 1e-3 * (beyond == 0.0)
        upper = np.where(below, lower + 2.0, world.q - beyond + 1e-3 * (beyond == 0.0))
        lower = np.where(below, lower, upper - 2.0)
        cost = JointLimits("limits", 3.0, lower, upper, stiffness=5.0, delta=2.0, printed=printed)
        return CostExample(world, cost, None)

    return make


@cache
def scene() -> CollisionScene:
    """The planar pair with the default object."""
    model = robot("planar")
    geometry, pieces = with_object(model, SURFACE_SAMPLES["fourier_contour"](1.0).convex_pieces())
    pairs = prune(model, geometry, margin=SAFETY).kept
    return collision_scene(model, geometry, pieces, pairs)


def collision(*, printed: bool) -> Callable[[World, Draw, str], CostExample]:
    """Over pairs of links apart or touching (to half a link's thickness), or links and the object.

    The object is put beside a finger. Joints on their limits of 120° make links parallel, and there
    the distance has a kink: spots other than `parallel` are a little beside it.
    """

    def make(world: World, draw: Draw, spot: str) -> CostExample:
        if spot != "parallel":
            world = replace(world, q=world.q + 0.02 * draw.normal(size=world.nv))
        if spot == "object":
            tip = world.kin.robot.update(world.q).position[draw.integers(world.grasp.count)]
            beside = tip + 0.3 * draw.normal(size=3) * (1.0, 1.0, 0.0)
            world = replace(world, reference=world.reference._replace(position=beside))
        distances = Distances(scene())
        distances.update(
            world.kin.robot.update(world.q), world.reference.position, world.reference.rotation
        )
        d = distances.value
        held = np.array([OBJECT in names for names in scene().pair_names])
        chosen = {
            "apart": ~held & (d > FLOOR),
            "parallel": ~held & (d > FLOOR),
            "touching": ~held & (d > -0.02) & (d <= FLOOR),
            "object": held & (d < SAFETY),
            "far": d > SAFETY,
        }[spot]
        pairs = np.flatnonzero(chosen)
        cost = Collision(
            "collision", 0.5, pairs, safety_distance=SAFETY, floor=FLOOR, stiffness=1.0,
            printed=printed,
        )  # fmt: skip
        return CostExample(world, cost, distances)

    return make


COSTS: dict[type[Cost], tuple[CostCase, ...]] = {
    JointLimits: (
        CostCase(joint_limits(printed=False), ("beyond", "mixed"), ("inside",)),
        CostCase(joint_limits(printed=True), ("beyond", "mixed"), ("inside",)),
    ),
    Collision: (
        CostCase(collision(printed=False), ("apart", "touching", "object"), ("far",), ("planar",)),
        CostCase(collision(printed=True), ("apart", "touching", "object"), ("far",), ("planar",)),
    ),
}
"""Every cost class, with its variants."""
