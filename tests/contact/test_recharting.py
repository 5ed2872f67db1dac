"""A contact that slides towards a pole goes on in another chart, and nothing else changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conformance.worlds import FIXED, SLIDING, World, make_world, seeded, unpacked
from numpy.testing import assert_allclose

from wbc.contact.recharting import recharted
from wbc.contact.surfaces.polar import REGULAR_LATITUDE
from wbc.control.law import Law
from wbc.control.task_stack import TaskStack
from wbc.tasks.equilibrium import EquilibriumForce, EquilibriumMoment

POLAR = ("sphere", "spheroid", "superellipsoid")
FACES = range(3)


def near_a_pole(surface: str, face: int, seed: int, latitude: float = 75.0) -> World:
    """Both fingers slide just beyond the regular part of a chart, on either side of it."""
    world = make_world("hand", surface, SLIDING, seed=seed)
    rng = seeded(surface, face, seed)
    xi = np.column_stack([rng.uniform(-np.pi, np.pi, 2), np.radians([latitude, -latitude])])
    return replace(world, state=world.state._replace(xi=xi, face=np.full(2, face)))


def motion(world: World) -> np.ndarray:
    """Velocity of q̃ of the law with two tasks on where the contacts are."""
    tasks = (
        EquilibriumForce("force", 5.0, np.inf), EquilibriumMoment("moment", 5.0, np.inf),
    )  # fmt: skip
    stack = TaskStack(tasks, 2, np.ones(world.nv))
    law = Law(world.kin, stack, (), None, 0.0)
    law.evaluate(world.q, world.state, world.reference, (None, None), (True, True))
    return law.solve(stack.level_order((0, 1)), np.ones(2)).total


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("face", FACES)
@pytest.mark.parametrize("surface", POLAR)
def test_it_is_a_change_of_coordinates(surface: str, face: int, seed: int) -> None:
    world = near_a_pole(surface, face, seed)
    rates = motion(world)
    kin = world.update()
    before = [a.copy() for a in (kin.charts[:, 0], kin.frame[:, :, 2], kin.position, kin.rotation)]
    tangents, spin = kin.charts[:, 1:3].copy(), kin.spin.copy()
    rows, rhs = kin.rows[: kin.row_count].copy(), kin.rhs[: kin.row_count].copy()
    found = recharted(world.grasp.surface, world.state, rates)
    assert found is not None
    after, new_rates = found
    assert (after.face != face).all()
    assert (np.abs(after.xi[:, 1]) < np.radians(55.0)).all()
    new = replace(world, state=after)
    kin = new.update()
    for name, old, now in zip(
        ("points", "normals", "position", "rotation"), before,
        (kin.charts[:, 0], kin.frame[:, :, 2], kin.position, kin.rotation), strict=True,
    ):  # fmt: skip
        assert_allclose(now, old, rtol=0.0, atol=1e-13, err_msg=name)
    assert_allclose(kin.rows[: kin.row_count], rows, rtol=0.0, atol=1e-12)
    assert_allclose(kin.rhs[: kin.row_count], rhs, rtol=0.0, atol=1e-12)
    # the rates carried over are those that the law would give in the new chart
    expected = motion(new)
    size = np.abs(expected).max()
    assert_allclose(new_rates[: world.nv], rates[: world.nv], rtol=0.0, atol=0.0)
    assert_allclose(new_rates, expected, rtol=0.0, atol=1e-11 * size)
    # and move the contact points over the object as before, the contact frames in F too
    (_, xi, turn), (_, new_xi, new_turn) = unpacked(rates, 2), unpacked(new_rates, 2)
    for i in range(2):
        was, now = xi[i] @ tangents[i], new_xi[i] @ kin.charts[i, 1:3]
        assert_allclose(now, was, rtol=0.0, atol=1e-12 * size)
        still = turn[i] - world.state.pivot[i] @ spin[i] @ xi[i]
        assert_allclose(new_turn[i] - after.pivot[i] @ kin.spin[i] @ new_xi[i], still, atol=1e-11)


@pytest.mark.parametrize("surface", POLAR)
def test_what_stays_in_its_chart(surface: str) -> None:
    """Fixed contacts, and those below 70 degrees; one that has changed does not change again."""
    world = near_a_pole(surface, 0, 0)
    rates = np.zeros(world.nv + 10)
    body = world.grasp.surface
    assert recharted(body, near_a_pole(surface, 0, 0, 69.9).state, rates) is None
    assert recharted(body, world.state._replace(mode=np.full(2, FIXED)), rates) is None
    found = recharted(body, world.state._replace(mode=np.array([SLIDING, FIXED])), rates)
    assert found is not None and found[0].face[1] == 0
    assert_allclose(found[0].xi[1], world.state.xi[1], atol=0.0)
    assert recharted(body, found[0], found[1]) is None


@pytest.mark.parametrize("surface", POLAR)
def test_no_point_is_near_all_poles(surface: str) -> None:
    """Wherever a chart is left there is one with its least latitude below 55 degrees: it stays."""
    body = near_a_pole(surface, 0, 0).grasp.surface
    rng = seeded(surface)
    for _ in range(300):
        face = int(rng.integers(3))
        latitude = rng.uniform(REGULAR_LATITUDE, 0.5 * np.pi) * rng.choice([-1.0, 1.0])
        xi = np.array([rng.uniform(-np.pi, np.pi), latitude])
        found = body.rechart(xi, face)
        assert found is not None and abs(found[0][1]) < np.radians(55.0)
        assert_allclose(body.point(*found), body.point(xi, face), rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("surface", ["box", "cylinder"])
def test_faces_with_edges_have_no_other_chart(surface: str) -> None:
    world = make_world("hand", surface, SLIDING, "limits")
    assert recharted(world.grasp.surface, world.state, np.zeros(world.nv + 10)) is None
