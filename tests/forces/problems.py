"""Grasps to plan forces for: two hands around a cylinder, at random, and pouring."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from wbc.arrays import Array
from wbc.forces import POINT, SOFT_FINGER, GraspForceProblem
from wbc.rotations import exp_so3, skew

GRAVITY = np.array([0.0, 0.0, -9.81])


def contact_frame(normal: Array) -> Array:
    """(3, 3) columns x, y, z: z along the inward normal."""
    z = np.asarray(normal) / np.linalg.norm(normal)
    x = np.cross(z, [0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def grasp_matrix(points: Array, frames: Array, model: str) -> Array:
    """(6, M) about the origin."""
    blocks = []
    for p, r in zip(points, frames, strict=True):
        block = np.vstack([r, skew(p) @ r])
        if model == SOFT_FINGER:
            block = np.hstack([block, np.concatenate([np.zeros(3), r[:, 2]])[:, None]])
        blocks.append(block)
    return np.hstack(blocks)


def finger_jacobians(
    points: Array, frames: Array, model: str, rng: np.random.Generator, *, length: float = 0.03
) -> Array:
    """(M, 3n) three hinges of a bent finger behind each contact point, about 1, 2.6 and 3.8
    times `length` away: no direction of force is free of torques."""
    m = 3 if model == POINT else 4
    n = len(points)
    jacobian = np.zeros((m * n, 3 * n))
    away = np.array([[1.7, -3.4], [2.26, -1.36], [1.14, -0.17]])
    for i, r in enumerate(frames):
        for k in range(3):
            # hinges behind the tip; the last two bend, the first spreads the finger
            sideways = 0.2 * (3 - k) / 1.5 * rng.standard_normal()
            lever = r @ np.array([sideways, *away[k]]) * length
            axis = r @ (np.array([0.0, 1.0, 0.3]) if k == 0 else np.array([1.0, 0.0, 0.0]))
            axis += 0.1 * rng.standard_normal(3)
            axis /= np.linalg.norm(axis)
            jacobian[m * i : m * i + 3, 3 * i + k] = r.T @ np.cross(axis, lever)
            if m == 4:
                jacobian[m * i + 3, 3 * i + k] = r[:, 2] @ axis
    return jacobian


def cylinder_points(hands: int = 2, radius: float = 0.035) -> tuple[Array, Array]:
    """(5 hands, 3) contact points of thumbs and fingers, and their inward normals."""
    points, normals = [], []
    for hand in range(hands):
        height, turn = (0.06, 0.0) if hand == 0 else (-0.06, np.pi)
        thumb = [(turn, height)]
        spread = [(turn + np.pi + 0.35 * k, height + 0.02 * k) for k in (-1.5, -0.5, 0.5, 1.5)]
        for angle, z in thumb + spread:
            out = np.array([np.cos(angle), np.sin(angle), 0.0])
            points.append(radius * out + [0.0, 0.0, z])
            normals.append(-out)
    return np.array(points), np.array(normals)


def two_hands(
    model: str = POINT, *, load: float = 1.0, seed: int = 0, arms: int = 0, **changes: Any
) -> GraspForceProblem:
    """Ten fingertips on a bottle of 0.425 kg load kg that stands upright.

    Args:
        arms: joints that move all fingers of a hand, `arms` for each hand.
    """
    rng = np.random.default_rng(seed)
    points, normals = cylinder_points()
    frames = np.array([contact_frame(z) for z in normals])
    jacobian = finger_jacobians(points, frames, model, rng)
    limit = np.tile(np.repeat([0.5, 0.075, 0.075, 0.075, 0.075], 3), 2)
    if arms:
        m = len(jacobian) // 10
        more = np.zeros((len(jacobian), 2 * arms))
        for hand in range(2):
            for k in range(arms):
                axis, origin = rng.standard_normal(3), 0.4 * rng.standard_normal(3)
                axis /= np.linalg.norm(axis)
                for i in range(5 * hand, 5 * hand + 5):
                    r = frames[i]
                    column = r.T @ np.cross(axis, points[i] - origin)
                    more[m * i : m * i + 3, hand * arms + k] = column
                    if m == 4:
                        more[m * i + 3, hand * arms + k] = r[:, 2] @ axis
        jacobian = np.hstack([jacobian, more])
        limit = np.concatenate([limit, np.full(2 * arms, 60.0)])
    mass = 0.425 * load
    values: dict[str, Any] = {
        "G": grasp_matrix(points, frames, model),
        "J": jacobian,
        "tau_e": 0.01 * rng.uniform(-1.0, 1.0, len(limit)),
        "tau_min": -limit,
        "tau_max": limit,
        "mu": np.full(10, 0.6),
        "mu_t": np.full(10, 0.004),
        "model": model,
        "h_e": np.concatenate([-mass * GRAVITY, [0.0, 0.02, 0.0]]),
    }
    return GraspForceProblem(**{**values, **changes})


def mixed(seed: int = 3) -> GraspForceProblem:
    """Points and soft fingers together, two contacts on one finger, an arm, a joint unlimited."""
    whole = two_hands(SOFT_FINGER, arms=3, seed=seed)
    models = [SOFT_FINGER if i % 3 else POINT for i in range(10)]
    keep = [k for k in range(40) if not (k % 4 == 3 and models[k // 4] == POINT)]
    jacobian = np.array(whole.J[keep])
    jacobian[:4, 3] = 0.01  # the second finger's first joint also moves the first contact
    low, high = np.array(whole.tau_min), np.array(whole.tau_max)
    low[[7, 33]], high[[7, 33]] = -np.inf, np.inf
    return whole.with_(G=whole.G[:, keep], J=jacobian, model=models, tau_min=low, tau_max=high)


def random_grasp(rng: np.random.Generator, *, model: str | None = None) -> GraspForceProblem:
    """Contacts at random on a sphere or a box, normals inward to within 30°; feasible or not."""
    n = int(rng.integers(3, 9))
    model = model or str(rng.choice([POINT, SOFT_FINGER]))
    out = rng.standard_normal((n, 3))
    out /= np.linalg.norm(out, axis=1)[:, None]
    points = 0.04 * out * rng.uniform(0.7, 1.3, (n, 1))
    frames = np.array([contact_frame(exp_so3(0.25 * rng.standard_normal(3)) @ -o) for o in out])
    jacobian = finger_jacobians(points, frames, model, rng)
    limit = rng.uniform(0.03, 0.5, 3 * n)
    force = rng.standard_normal(3) * 10.0 ** rng.uniform(-0.7, 0.7)
    moment = 0.02 * rng.standard_normal(3)
    return GraspForceProblem(
        G=grasp_matrix(points, frames, model), J=jacobian,
        tau_e=0.1 * limit * rng.uniform(-1, 1, 3 * n), tau_min=-limit, tau_max=limit,
        mu=rng.uniform(0.2, 1.0, n), mu_t=rng.uniform(0.002, 0.01, n), model=model,
        h_e=np.concatenate([force, moment]),
    )  # fmt: skip


def many_contacts(n: int, model: str = POINT, *, seed: int = 0) -> GraspForceProblem:
    """n contacts spread over a sphere of 0.2 m, three joints each, none shared."""
    rng = np.random.default_rng(seed)
    out = rng.standard_normal((n, 3))
    out /= np.linalg.norm(out, axis=1)[:, None]
    frames = np.array([contact_frame(-o) for o in out])
    points = 0.2 * out
    limit = np.full(3 * n, 0.1)
    return GraspForceProblem(
        G=grasp_matrix(points, frames, model), J=finger_jacobians(points, frames, model, rng),
        tau_e=np.zeros(3 * n), tau_min=-limit, tau_max=limit, mu=np.full(n, 0.6),
        mu_t=np.full(n, 0.004), model=model,
        h_e=0.2 * n * np.array([0.1, 0.2, 1.0, 0.01, -0.02, 0.01]),
    )  # fmt: skip


def pouring(
    model: str = POINT, *, load: float = 1.0, dt: float = 0.002, seed: int = 0
) -> Iterator[GraspForceProblem]:
    """The pouring case without a robot: 135° in 0.8 s, 0.4 s of pouring, and back, every dt.

    Fingertips roll by ± 0.05 rad and fingers flex by ± 0.08 rad meanwhile; the wrench is in the
    bottle's axes, about its centre.
    """
    first = two_hands(model, load=load, seed=seed)
    points, normals = cylinder_points()
    m = 3 if model == POINT else 4
    blocks = [first.J[m * i : m * i + 3, 3 * i : 3 * i + 3].copy() for i in range(10)]
    frames = np.array([contact_frame(z) for z in normals])
    for k in range(round(2.0 / dt)):
        t = k * dt
        angle, mass, turn_acc = _pouring_motion(t)
        mass *= load
        wave = np.sin(2.0 * np.pi * (t + 0.13 * np.arange(10)))
        turned = np.array(
            [exp_so3(np.array([0.0, 0.0, 0.05 * w])) @ r for w, r in zip(wave, frames, strict=True)]
        )
        moved = np.array(
            [exp_so3(np.array([0.0, 0.0, 0.05 * w])) @ p for w, p in zip(wave, points, strict=True)]
        )
        jacobian = np.array(first.J)
        for i, w in enumerate(wave):
            bend = exp_so3(np.array([0.08 * w, 0.0, 0.0]))
            jacobian[m * i : m * i + 3, 3 * i : 3 * i + 3] = bend @ blocks[i]
        turn = exp_so3(np.array([angle, 0.0, 0.0]))
        # the water gathers at the lower end
        down = turn.T @ GRAVITY / 9.81
        centre = 0.04 * down[2] * np.array([0.0, 0.0, 1.0]) + 0.01 * down * [1.0, 1.0, 0.0]
        weight = mass * turn.T @ GRAVITY
        inertia = np.array([2e-3, 2e-3, 3e-4]) * mass / 0.425
        moment = inertia * np.array([turn_acc, 0.0, 0.0]) - np.cross(centre, weight)
        yield first.with_(
            G=grasp_matrix(moved, turned, model), J=jacobian,
            tau_e=first.tau_e * (1.0 + 0.3 * np.sin(2.0 * np.pi * t)),
            h_e=np.concatenate([-weight, moment]),
        )  # fmt: skip


def _pouring_motion(t: float) -> tuple[float, float, float]:
    """Angle [rad], mass [kg] and angular acceleration [rad/s²] at t."""
    full = np.deg2rad(135.0)
    mass = 0.425 - 0.225 * float(np.clip((t - 0.8) / 0.4, 0.0, 1.0))
    if 0.8 <= t < 1.2:
        return full, mass, 0.0
    sign, s = (1.0, t / 0.8) if t < 0.8 else (-1.0, (t - 1.2) / 0.8)
    s = min(s, 1.0)
    way = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    acceleration = (60.0 * s - 180.0 * s**2 + 120.0 * s**3) / 0.8**2
    return (full * way if sign > 0 else full * (1.0 - way)), mass, sign * full * acceleration
