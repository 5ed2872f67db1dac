"""A table that objects lie on without rolling away, and are lifted from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.sim.mujoco_worlds import BOX, FAR, model, stools, table_below
from wbc.arrays import Array
from wbc.contact.surfaces import SURFACES, Surface
from wbc.contact.surfaces.cylinder import Cylinder
from wbc.contact.surfaces.sphere import Sphere
from wbc.errors import WbcError
from wbc.rotations import exp_so3, log_so3
from wbc.sim.mujoco_plant import MujocoPlant
from wbc.sim.mujoco_table import underside
from wbc.sim.plant import Sensed

pytest.importorskip("mujoco")

TIPS = ["tip_0", "tip_1", "tip_2"]
NONE = np.zeros(3, dtype=np.bool_)
WEIGHTS = 9.81 * np.array([0.1, 0.2, 0.3])
BAR = Cylinder(0.026, 0.34)
CRADLE = [(-0.018, -0.15), (-0.018, 0.15), (0.018, 0.15), (0.018, -0.008)]
BALL = Sphere(0.028)
RING = [(0.017, 0.0), (-0.0028, 0.0158), (-0.0168, -0.0029), (0.0029, -0.0168)]
LYING = exp_so3(np.array([-0.5 * np.pi, 0.0, 0.0]))


def _moved(plant: MujocoPlant, push: Array, ticks: int) -> Sensed:
    plant.disturb(push, NONE)
    for _ in range(ticks):
        seen = plant.step(WEIGHTS, 2e-3)
    return seen


def _off(seen: Sensed, position: Array, rotation: Array) -> tuple[float, float]:
    turned = log_so3(seen.object_rotation @ rotation.T)
    return float(np.linalg.norm(seen.object_position - position)), float(np.linalg.norm(turned))


@pytest.mark.parametrize(
    ("surface", "mass", "posts", "rotation"),
    [
        (BAR, 0.2, CRADLE, LYING),
        (BALL, 0.1, RING, exp_so3(np.array([0.4, -0.3, 0.2]))),
        (BOX, 0.2, [(0.03, 0.03), (-0.03, 0.03), (0.0, -0.03)], np.eye(3)),
    ],
    ids=["bar", "ball", "box"],
)
def test_it_lies_on_posts_and_pushes_do_not_take_it_away(
    surface: Surface, mass: float, posts: list[tuple[float, float]], rotation: Array,
    tmp_path: Path,
) -> None:  # fmt: skip
    """Also where it was put down elsewhere than believed, turned by 2°: the table came along."""
    table = table_below(FAR, posts=posts, rotation=rotation)
    inertia = (1e-3, 1e-3, 1e-3) if surface is BOX else (0.0, 0.0, 0.0)
    plant = MujocoPlant(model(stools(tmp_path), TIPS, surface, mass, inertia=inertia, table=table))
    for shift, turn in ((np.zeros(3), np.zeros(3)), (np.array([0.01, -0.004, 0.006]),
                                                    np.array([0.02, 0.02, -0.02]))):  # fmt: skip
        position, there = FAR + shift, exp_so3(turn) @ rotation
        seen = plant.reset(np.zeros(3), np.zeros(3), position, there)
        assert _off(_moved(plant, np.zeros(3), 500), position, there) < (1e-4, 1e-3)
        for angle in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False):
            push = 0.4 * np.array([np.cos(angle), np.sin(angle), 0.0])
            seen = _moved(plant, push, 100)
            assert _off(seen, position, there) < (1e-4, 1e-3), angle
        seen = _moved(plant, np.array([0.0, 0.0, 1.5 * mass * 9.81]), 60)
        assert seen.object_position[2] > position[2] + 0.02  # lifted off
        assert not seen.force.any()


def test_the_underside_of_a_body_that_is_turned() -> None:
    """On the surface, looking down, where it was asked for; of a hollow chart as of a round one."""
    turned = exp_so3(np.array([0.3, 0.7, -0.2]))
    for surface in (BAR, BALL, BOX, SURFACES["superellipsoid"](0.05, 0.04, 0.03, 5.0)):
        for across in (np.zeros(2), np.array([0.01, -0.012])):
            point, normal = underside(surface, turned, across)
            assert abs(surface.level(point)) < 1e-12
            assert (turned @ point)[:2] == pytest.approx(across, abs=1e-12)
            assert (turned @ normal)[2] < 0.0
    with pytest.raises(WbcError, match=r"nothing of the object is above \[30 mm, 0 mm\]"):
        underside(BALL, turned, np.array([0.03, 0.0]))


def test_hands_meet_a_top_and_the_posts_on_it_but_not_posts_alone(tmp_path: Path) -> None:
    for top in (None, 0.9):
        table = table_below(FAR, top, CRADLE, LYING)
        made = model(stools(tmp_path), TIPS, BAR, table=table)
        names = [made.model.geom(k).name for k in range(made.model.ngeom)]
        own = [k for k, name in enumerate(names) if name.startswith("table")]
        assert len(own) == (4 if top is None else 9)
        hand = made.model.geom_conaffinity[made.pad_geom[0]]
        assert all((made.model.geom_contype[k] & hand != 0) == (top is not None) for k in own)
        if top is not None:  # they stand on it
            data = MujocoPlant(made)
            data.reset(np.zeros(3), np.zeros(3), FAR, LYING)
            for k in own:
                if "post" in names[k]:
                    up = data.data.geom_xmat[k].reshape(3, 3)[2]
                    foot = data.data.geom_xpos[k][2] - abs(up[2]) * made.model.geom_size[k][1]
                    assert abs(up[2]) == pytest.approx(1.0) and foot == pytest.approx(top)
