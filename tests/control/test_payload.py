"""What the fingers carry: water with a level surface, and the wrench that a motion asks for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from wbc.control.payload import Body, Payload, Water, wrench_to_supply
from wbc.control.references import Motion, References, object_acceleration
from wbc.errors import WbcError
from wbc.rotations import exp_so3

R, L = 0.03, 0.18
ROOM = np.pi * R**2 * L
G = np.array([0.0, 0.0, -9.81])


def water(fill: float = 0.5, **changes: object) -> Water:
    return replace(Water(1000.0 * fill * ROOM, R, L, np.zeros(3), 1000.0), **changes)


def up(tilt: float, turn: float = 0.0) -> np.ndarray:
    return np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])


def centre(fill: float, direction: np.ndarray) -> np.ndarray:
    full = water(fill)
    return full.body(full.mass, direction).com


def below(fill: float, direction: np.ndarray, size: int = 140) -> tuple[np.ndarray, np.ndarray]:
    """Centre and inertia about the origin per mass, of small cubes sorted by height."""
    x = (np.arange(size) + 0.5) / size * 2.0 - 1.0
    cubes = np.stack(np.meshgrid(R * x, R * x, 0.5 * L * x, indexing="ij"), -1).reshape(-1, 3)
    cubes = cubes[np.hypot(cubes[:, 0], cubes[:, 1]) < R]
    height = cubes @ direction
    kept = cubes[np.argsort(height)[: round(fill * len(cubes))]]
    second = kept.T @ kept / len(kept)
    return kept.mean(0), np.trace(second) * np.eye(3) - second


@pytest.mark.parametrize("fill", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("tilt", [0.02, 0.7, 1.4, 2.0, 3.0])
def test_water_is_what_lies_below_a_level_plane(fill: float, tilt: float) -> None:
    body = water(fill).body(water(fill).mass, up(tilt, 0.4))
    com, inertia = below(fill, up(tilt, 0.4))
    np.testing.assert_allclose(body.com, com, atol=3e-4)
    np.testing.assert_allclose(body.inertia / body.mass, inertia, atol=2e-5)


def test_known_places_of_the_centre() -> None:
    np.testing.assert_allclose(centre(0.3, up(0.0)), [0, 0, -0.35 * L], atol=1e-9)
    np.testing.assert_allclose(centre(0.3, up(np.pi)), [0, 0, 0.35 * L], atol=1e-9)
    lying = centre(0.5, up(0.5 * np.pi))  # half a disc
    np.testing.assert_allclose(lying, [-4.0 * R / (3.0 * np.pi), 0, 0], atol=1e-6)
    np.testing.assert_allclose(centre(1.0, up(0.8)), 0.0, atol=1e-6)


@pytest.mark.parametrize(("fill", "tilt"), [(0.5, 0.1), (0.3, 0.8), (0.7, 1.3), (0.4, 2.2)])
def test_the_centre_moves_level_by_the_metacentric_radius(fill: float, tilt: float) -> None:
    """Bouguer: turning the vessel moves the centre parallel to the surface, by I / V per angle,
    I the second moment of the surface about its middle; and never up or down."""
    step = 1e-5
    moved = centre(fill, up(tilt + step)) - centre(fill, up(tilt - step))
    assert abs(moved @ up(tilt)) < 1e-9 * R
    assert np.linalg.norm(moved) > 0.0
    if fill == 0.5 and tilt == 0.1:  # no end is reached: the surface is an ellipse
        radius = 0.25 * np.pi * R**4 / np.cos(tilt) ** 3 / (fill * ROOM)
        assert np.linalg.norm(moved) / (2.0 * step) == pytest.approx(radius, rel=1e-6)


def test_what_is_full_and_what_is_empty_balance() -> None:
    for tilt in (0.0, 0.3, 1.1, 1.5, np.pi / 2, 2.5):
        pull = 0.3 * centre(0.3, up(tilt)) + 0.7 * centre(0.7, -up(tilt))
        np.testing.assert_allclose(pull, 0.0, atol=1e-8)


def test_it_stays_finite_as_the_last_drop_leaves() -> None:
    for mass in (1e-3, 1e-9, 0.0):
        body = water(0.5).body(mass, up(1.2))
        assert np.isfinite(body.com).all() and np.isfinite(body.inertia).all()


def test_more_than_the_room_holds_is_refused() -> None:
    with pytest.raises(WbcError, match=r"fill the room 1\.2 times"):
        water(1.2)


def test_it_leaves_smoothly_in_its_phase() -> None:
    half = water(0.5, pours=2, left=0.1)
    masses = [
        half.mass_at(3.0 + t, phase, 3.0, 0.4)
        for phase, t in ((1, 0.3), (2, 0.0), (2, 0.2), (2, 0.4), (2, 0.9), (3, 0.0))
    ]
    middle = 0.5 * (half.mass + 0.1)
    np.testing.assert_allclose(masses, [half.mass, half.mass, middle, 0.1, 0.1, 0.1])
    assert water(0.5).mass_at(9.0, 7, 0.0, 1.0) == water(0.5).mass


def test_the_wrench_is_that_of_a_free_body_in_pinocchio() -> None:
    rng = np.random.default_rng(1)
    com, principal = rng.uniform(-0.1, 0.1, 3), np.array([2e-3, 3e-3, 4e-3])
    rotation = exp_so3(rng.standard_normal(3))
    twist, acceleration = rng.standard_normal(6), 5.0 * rng.standard_normal(6)
    payload = Payload(0.7, com, principal)
    wrench, arm = wrench_to_supply(payload.body(rotation, G, 0.0), rotation, twist, acceleration, G)

    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "object")
    model.appendBodyToJoint(joint, pin.Inertia(0.7, com, np.diag(principal)), pin.SE3.Identity())
    model.gravity.linear = G
    q = np.concatenate([np.zeros(3), pin.Quaternion(rotation).coeffs()])
    local = np.kron(np.eye(2), rotation.T)
    v = local @ twist
    a = local @ acceleration  # of the point; the spatial one lacks ω × v
    a[:3] -= np.cross(v[3:], v[:3])
    force = pin.rnea(model, model.createData(), q, v, a)
    np.testing.assert_allclose(local @ wrench, force, atol=1e-12)
    np.testing.assert_allclose(arm, rotation @ com)


def test_object_and_water_together() -> None:
    inside = water(0.5, center=np.array([0.0, 0.0, 0.01]))
    payload = Payload(0.2, np.array([0.0, 0.001, -0.02]), np.array([1e-3, 1e-3, 2e-4]), inside)
    rotation = exp_so3(np.array([0.4, -0.9, 0.3]))
    both = payload.body(rotation, G, inside.mass)
    alone = replace(payload, water=None).body(rotation, G, 0.0)
    wet = inside.body(inside.mass, rotation.T @ [0.0, 0.0, 1.0])
    assert both.mass == pytest.approx(0.2 + inside.mass)
    np.testing.assert_allclose(both.mass * both.com, 0.2 * alone.com + wet.mass * wet.com)
    args = rotation, np.arange(6.0), np.arange(6.0, 12.0), G
    total = wrench_to_supply(alone, *args)[0] + wrench_to_supply(wet, *args)[0]
    np.testing.assert_allclose(wrench_to_supply(both, *args)[0], total)
    assert isinstance(both, Body)


def test_the_references_acceleration_is_the_slope_of_their_twist() -> None:
    motion = Motion(
        1.0, 0.8, np.array([[0.0, 0.1, 0.0], [0.2, 0.0, 0.3]]), exp_so3(np.array([0.3, 0.1, 0.0])),
        np.array([0.0, 2.3, -0.4]), np.zeros((2, 1)), np.zeros((2, 1, 3)),
    )  # fmt: skip
    references, step = References(1), 1e-5
    for t in (0.9, 1.1, 1.4, 1.7, 1.9):
        twists = [references.at(t + s, motion).twist.copy() for s in (-step, step)]
        slope = (twists[1] - twists[0]) / (2.0 * step)
        np.testing.assert_allclose(object_acceleration(t, motion), slope, atol=1e-7)
