"""The feet of the tips: followed, they are what a search of the whole surface finds."""

from __future__ import annotations

import numpy as np
import pytest

from tests.contact.surface_table import CASES, build, contacts
from wbc.arrays import Array
from wbc.contact.surfaces import Surface
from wbc.contact.surfaces.base import POINT
from wbc.sim.feet import Feet

REACH = 5e-3
LENGTHS = np.full(1, REACH)


def way(surface: Surface, seed: int) -> Array:
    """(n, 3) a tip that comes from afar, slides about at its pad's length, and leaves, by 1 mm."""
    rng = np.random.default_rng(seed)
    xi, face = contacts(surface, n=8, seed=seed, inside=0.8)
    point = surface.point(xi[seed % 8], int(face[seed % 8]))
    normal = surface.level_gradient(point)
    path = [point + height * normal for height in np.arange(0.08, 0.8 * REACH, -1e-3)]
    heading = rng.normal(size=3) * (1.0 if not surface.planar else [1.0, 1.0, 0.0])
    tip = path[-1]
    for _ in range(150):
        foot = surface.point(*surface.project(tip))
        normal = surface.level_gradient(foot)
        heading -= normal * (normal @ heading)
        heading /= np.linalg.norm(heading)
        tip = foot + 0.8 * REACH * normal + 1e-3 * heading
        path.append(tip)
    path += [tip + height * normal for height in np.arange(0.0, 0.08, 1e-3)]
    return np.array(path)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_followed_feet_are_those_of_a_search(case: tuple[str, int], seed: int) -> None:
    surface = build(case)
    feet, path = Feet(surface, LENGTHS), way(surface, seed)
    before = path[0]
    for tip in path:
        feet.begin(before[None])
        records = feet.follow(0.5 * (before + tip)[None])  # a stage between
        records = feet.follow(tip[None])
        near = np.linalg.norm(tip - surface.point(*surface.project(tip)))
        if feet.near[0]:
            if surface.margin(feet._xi[0], int(feet._face[0])) >= 0.0:
                gap = np.linalg.norm(tip - records[0, POINT])
                assert gap == pytest.approx(near, abs=1e-7)
        else:
            assert near > REACH  # out of reach is never near enough to touch
        before = tip


@pytest.mark.parametrize("case", CASES)
def test_a_tip_that_jumps_is_found_again(case: tuple[str, int]) -> None:
    surface = build(case)
    xi, face = contacts(surface, n=12, seed=3, inside=0.8)
    feet = Feet(surface, LENGTHS)
    for k in range(12):
        point = surface.point(xi[k], int(face[k]))
        tip = point + 0.5 * REACH * surface.level_gradient(point)
        feet.begin(tip[None])
        gap = np.linalg.norm(tip - feet.records[0, POINT])
        assert feet.near[0]
        assert gap <= np.linalg.norm(tip - surface.point(*surface.project(tip))) + 1e-9


def test_what_is_no_number_is_left_alone() -> None:
    surface = build(("sphere", 0))
    feet = Feet(surface, LENGTHS)
    feet.begin(np.full((1, 3), np.nan))
    assert not feet.near[0]
    feet.begin(np.array([[0.0, 0.0, 0.053]]))
    assert feet.near[0]
