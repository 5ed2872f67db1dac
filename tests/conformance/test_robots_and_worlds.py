"""The suite's own tools: a moved robot is the same robot moved, a scaled one the same scaled."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from conformance.robots import SETTINGS
from conformance.worlds import SURFACE_SAMPLES, make_world, moved, scaled
from wbc.contact.grasp import ContactMode
from wbc.contact.surfaces import SURFACES


@pytest.mark.parametrize("name", SETTINGS)
def test_a_moved_world_has_its_frames_moved(name: str) -> None:
    motion = SETTINGS[name].motion
    world = make_world(name, modes=ContactMode.SLIDING)
    here = world.update()
    there = moved(world, motion).update()
    r, t = motion.rotation, motion.translation
    assert_allclose(there.robot.position, here.robot.position @ r.T + t, atol=1e-12)
    assert_allclose(there.robot.rotation, r @ here.robot.rotation, atol=1e-12)
    assert_allclose(there.position, here.position @ r.T + t, atol=1e-12)
    assert_allclose(there.rotation, r @ here.rotation, atol=1e-12)


@pytest.mark.parametrize("name", SETTINGS)
def test_a_scaled_world_has_its_lengths_scaled(name: str) -> None:
    world = make_world(name, modes=ContactMode.SLIDING, prismatic=False)
    surface = "fourier_contour" if world.planar else "spheroid"
    here, there = world.update(), scaled(world, surface, 2.5).update()
    assert_allclose(there.robot.position, 2.5 * here.robot.position, atol=1e-12)
    assert_allclose(there.charts[:, 0], 2.5 * here.charts[:, 0], atol=1e-9)
    assert_allclose(there.position, 2.5 * here.position, atol=1e-8)
    assert_allclose(there.rotation, here.rotation, atol=1e-8)


def test_every_surface_has_an_object_here() -> None:
    assert set(SURFACE_SAMPLES) == set(SURFACES)
    for name, make in SURFACE_SAMPLES.items():
        assert type(make(1.0)) is SURFACES[name]


def test_every_contact_type_is_known_here() -> None:
    assert {mode.name for mode in ContactMode} == {"FREE", "FIXED", "SLIDING"}


@pytest.mark.parametrize("name", SETTINGS)
def test_worlds_are_the_same_each_time(name: str) -> None:
    a, b = make_world(name), make_world(name)
    assert np.array_equal(a.q, b.q) and np.array_equal(a.state.xi, b.state.xi)
