"""The extended finger (24)-(34) against finite differences of the chain, written anew here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import qr, solve_triangular

from conformance.robots import SETTINGS
from conformance.worlds import (
    FIXED,
    FREE,
    PLACES,
    ROBOT_SURFACES,
    SLIDING,
    World,
    central_difference,
    make_world,
    seeded,
    unpacked,
)
from wbc.contact.extended_finger import ExtendedKinematics, extended_jacobian, finger_jacobians
from wbc.contact.grasp import ContactMode
from wbc.rotations import exp_so3, log_so3, skew

CASES = pytest.mark.parametrize(
    ("robot_name", "surface", "place"),
    [(r, s, p) for r, s in ROBOT_SURFACES for p in PLACES],
)
MODES = pytest.mark.parametrize("mode", [FIXED, SLIDING], ids=["fixed", "sliding"])


def twist(pose: Callable[[float], tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """(6,) linear and angular velocity in the world's axes of a pose given as a function of t."""
    _, r = pose(0.0)

    def coordinates(t: float) -> np.ndarray:
        p, r_t = pose(t)
        return np.concatenate([p, log_so3(r_t @ r.T)])

    return central_difference(coordinates)


def _world(*args: Any, **kwargs: Any) -> World:
    """A world whose fingers found the surface beside where it is believed."""
    world = make_world(*args, **kwargs)
    n, planar = world.grasp.count, world.grasp.planar
    shift = 3e-3 * np.random.default_rng(n).normal(size=(n, 3)) * [1.0, 1.0, not planar]
    return replace(world, state=world.state._replace(shift=shift))


class Chain:
    """One extended finger of a world, step by step: tip, pivot, pad, contact frame, object.

    A motion of it is q̇ (nv,), ξ̇ (2,), the turning rate θ̇ (3,) of C in F in F's axes, and the pad's
    Δl̇ [m/s]; those left out are at rest.
    """

    def __init__(self, world: World, finger: int) -> None:
        self.world, self.finger = world, finger
        self.robot = world.kin.robot.model
        self.model = self.robot.pin_model
        self.frame = self.model.getFrameId(world.grasp.fingers[finger])
        self.face = int(world.state.face[finger])
        self.data = self.model.createData()

    def tip(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        pin.framesForwardKinematics(self.model, self.data, self.robot.full(q))
        placement = self.data.oMf[self.frame]
        return placement.translation.copy(), placement.rotation.copy()

    def contact_in_object(self, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """c with the shift, and the Gauss frame R_OC, from the chart's tangent vectors."""
        c, c_u, c_v = self.world.grasp.surface.charts(xi[None], self.face)[0, :3]
        x = c_u / np.linalg.norm(c_u)
        n = np.cross(c_u, c_v)
        n /= np.linalg.norm(n)
        return c + self.world.state.shift[self.finger], np.column_stack([x, np.cross(n, x), n])

    def contact(self, q, xi, pivot, reach):  # type: ignore[no-untyped-def]
        """o_c of (30) and R_c in the world."""
        p, r = self.tip(q)
        r_c = r @ pivot
        return p - reach * r_c[:, 2], r_c

    def object(self, q, xi, pivot, reach):  # type: ignore[no-untyped-def]
        """o_o and R_o in the world."""
        o_c, r_c = self.contact(q, xi, pivot, reach)
        c, r_oc = self.contact_in_object(xi)
        r_o = r_c @ r_oc.T
        return o_c - r_o @ c, r_o

    def along(self, t, v=0.0, xi=0.0, theta=(0.0, 0.0, 0.0), dl=0.0):  # type: ignore[no-untyped-def]
        """q, ξ, R_FC and l − Δl after the time t of a motion."""
        state, i = self.world.state, self.finger
        turn = exp_so3(t * np.asarray(theta))
        reach = self.world.reference.reach[i] - t * dl
        return self.world.q + t * v, state.xi[i] + t * xi, turn @ state.pivot[i], reach

    def object_twist(self, **motion) -> np.ndarray:  # type: ignore[no-untyped-def]
        return twist(lambda t: self.object(*self.along(t, **motion)))

    def contact_twist(self, **motion) -> np.ndarray:  # type: ignore[no-untyped-def]
        return twist(lambda t: self.contact(*self.along(t, **motion)))


@CASES
def test_the_object_pose_of_every_finger_is_the_chain(
    robot_name: str, surface: str, place: str
) -> None:
    world = _world(robot_name, surface, SLIDING, place)
    kin = world.update()
    for i in range(world.grasp.count):
        chain = Chain(world, i)
        p, r = chain.object(*chain.along(0.0))
        assert_allclose(kin.position[i], p, atol=1e-13)
        assert_allclose(kin.rotation[i], r, atol=1e-13)


def jacobian_by_differences(world: World) -> np.ndarray:
    """J̃ (34): every column is Gᵀ times the object twist when that variable alone moves.

    All fingers of `world` must be in contact, its kinematics brought to it.
    """
    pick = [0, 1, 5] if world.planar else [0, 1, 2, 3, 4, 5]
    angles = [2] if world.planar else [0, 1, 2]
    n_xi = world.grasp.n_xi
    width = n_xi + len(angles)
    n = world.grasp.count
    j = np.zeros((len(pick) * n, world.nv + width * n))
    for i in range(n):
        chain, g_t = Chain(world, i), finger_jacobians(world.kin, i)[4]
        columns = [chain.object_twist(v=e) for e in np.eye(world.nv)]
        sliding = world.state.mode[i] == SLIDING
        own = [chain.object_twist(xi=e) * sliding for e in np.eye(2)[:n_xi]]
        own += [chain.object_twist(theta=e) for e in np.eye(3)[angles]]
        rows, start = slice(i * len(pick), (i + 1) * len(pick)), world.nv + i * width
        j[rows, : world.nv] = (g_t @ np.column_stack(columns))[pick]
        j[rows, start : start + width] = (g_t @ np.column_stack(own))[pick]
    return j


@CASES
@MODES
def test_extended_jacobian_is_the_derivative_of_the_chain(
    robot_name: str, surface: str, place: str, mode: ContactMode
) -> None:
    world = _world(robot_name, surface, mode, place)
    j, _ = extended_jacobian(world.update())
    assert np.abs(j - jacobian_by_differences(world)).max() < 1e-8


def surface_jacobians(kin: ExtendedKinematics, i: int) -> tuple[np.ndarray, np.ndarray]:
    """G_ξᵀ (6, 6) and J_ξ (6, 2) of (28) in the world's axes."""
    g_t = np.eye(6)
    g_t[:3, 3:] = -skew(kin.rotation[i] @ kin.charts[i, 0])
    turning = kin.rotation[i] @ kin.frame[i] @ kin.spin[i]
    return g_t, np.vstack([kin.rotation[i] @ kin.charts[i, 1:3].T, turning])


@CASES
def test_motion_of_the_contact_frame_seen_from_the_object(
    robot_name: str, surface: str, place: str
) -> None:
    """(28): v_c = G_ξᵀ v_o + J_ξ ξ̇."""
    world = _world(robot_name, surface, SLIDING, place)
    kin = world.update()

    def check(i: int) -> None:
        rng, chain = seeded(robot_name, surface, place, i), Chain(world, i)
        p_o, r_o = kin.position[i], kin.rotation[i]
        v_o, xi_rate = rng.normal(size=6), rng.normal(size=2)

        def pose(t: float) -> tuple[np.ndarray, np.ndarray]:
            r = exp_so3(t * v_o[3:]) @ r_o
            c, r_oc = chain.contact_in_object(world.state.xi[i] + t * xi_rate)
            return p_o + t * v_o[:3] + r @ c, r @ r_oc

        g_xi_t, j_xi = surface_jacobians(kin, i)
        assert_allclose(g_xi_t @ v_o + j_xi @ xi_rate, twist(pose), atol=1e-8)

    for i in range(world.grasp.count):
        check(i)


@CASES
def test_motion_of_the_contact_frame_seen_from_the_finger(
    robot_name: str, surface: str, place: str
) -> None:
    """(29), (31), (32), (33) with all variables moving; and G_Δl of (31) as it is printed."""
    world = _world(robot_name, surface, SLIDING, place)
    kin = world.update()
    for i in range(world.grasp.count):
        rng, chain = seeded(robot_name, surface, place, i), Chain(world, i)
        reach = float(world.reference.reach[i])
        v, xi, theta = rng.normal(size=world.nv), rng.normal(size=2), rng.normal(size=3)
        dl = 0.01 * rng.normal()
        if world.planar:
            xi[1], theta[:2] = 0.0, 0.0
        v_c = chain.contact_twist(v=v, xi=xi, theta=theta, dl=dl)
        v_o = chain.object_twist(v=v, xi=xi, theta=theta, dl=dl)
        j_f, j_eta_xi, j_theta, j_dl, g_t = finger_jacobians(kin, i)
        # (29)
        assert_allclose(v_c[3:], kin.robot.angular[i] @ v + j_theta[3:] @ theta, atol=1e-8)
        # (31)
        r_o, normal = kin.rotation[i], kin.rotation[i] @ kin.frame[i, :, 2]
        j_prime = np.vstack([reach * r_o @ kin.normal_xi[i], np.zeros((3, 2))])
        g_dl_t = np.zeros((6, 6))
        g_dl_t[:3, 3:] = -reach * skew(normal)
        finger = j_f @ v + j_theta @ theta + j_dl[:, 0] * dl - j_prime @ xi
        assert_allclose(finger - g_dl_t @ v_o, v_c, atol=1e-8)
        # as printed, with (Δl − l) S(R_o n̂) lower left in G_Δl, the pad's term has the wrong sign
        g_dl_printed = np.zeros((6, 6))
        g_dl_printed[3:, :3] = -reach * skew(normal)
        residual = v_c - (finger - g_dl_printed.T @ v_o)
        assert_allclose(residual[:3], 2 * reach * np.cross(normal, v_o[3:]), atol=1e-8)
        # (32)
        g_xi_t, j_xi = surface_jacobians(kin, i)
        assert_allclose(g_xi_t + g_dl_t, g_t, atol=1e-15)
        assert_allclose(-(j_xi + j_prime), j_eta_xi, atol=1e-15)
        left = j_f @ v + j_eta_xi @ xi + j_theta @ theta
        assert_allclose(left + j_dl[:, 0] * dl, g_t @ v_o, atol=1e-8)
        # (33): the pads hold their length
        assert_allclose(left, g_t @ chain.object_twist(v=v, xi=xi, theta=theta), atol=1e-8)


@pytest.mark.parametrize(("robot_name", "surface"), ROBOT_SURFACES)
def test_printed_pad_term_is_off_by_twice_the_reach(robot_name: str, surface: str) -> None:
    """(32) for an object that turns at 1 rad/s across the normal, per finger.

    The residual is 2 (l − Δl) [m/s]: l for a pad that is pressed half way, as here.
    """
    world = _world(robot_name, surface, FIXED)
    half = world.reference._replace(reach=0.5 * world.grasp.rest_length)
    world = replace(world, reference=half)
    kin = world.update()
    for i in range(world.grasp.count):
        r_o = kin.rotation[i]
        normal = r_o @ kin.frame[i, :, 2]
        across = np.array([0, 0, 1.0]) if world.planar else r_o @ kin.frame[i, :, 0]
        theta = kin.robot.rotation[i].T @ across
        v_o = Chain(world, i).object_twist(theta=theta)
        assert_allclose(v_o[3:], across, atol=1e-9)
        _, _, j_theta, _, g_t = finger_jacobians(kin, i)
        assert np.linalg.norm(j_theta @ theta - g_t @ v_o) < 1e-8
        printed, _ = surface_jacobians(kin, i)
        printed[:3, 3:] += world.reference.reach[i] * skew(normal)
        residual = np.linalg.norm(j_theta @ theta - printed @ v_o)
        assert residual == pytest.approx(world.grasp.rest_length[i], abs=1e-8)


def weighted_solution(world: World, kin: ExtendedKinematics, weight: float) -> np.ndarray:
    """argmin |q̇|² + weight (|ξ̇|² + |θ̇|²) on J̃ [q̇, η̇] = b.

    By pivoted QR: with columns of such different lengths the SVD of lstsq loses half the digits.
    """
    j, b = extended_jacobian(kin)
    scale = np.ones(j.shape[1])
    scale[world.nv :] = 1.0 / np.sqrt(weight)
    q, r, order = qr((j * scale).T, mode="economic", pivoting=True)
    return scale * (q @ solve_triangular(r, b[order], trans="T"))


def split(world: World, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q̇, ξ̇ (N, 2), θ̇ (N, 3) from a vector in the order of J̃'s columns."""
    n, n_xi = world.grasp.count, world.grasp.n_xi
    eta = x[world.nv :].reshape(n, -1)
    xi, theta = np.zeros((n, 2)), np.zeros((n, 3))
    xi[:, :n_xi] = eta[:, :n_xi]
    theta[:, 3 - (eta.shape[1] - n_xi) :] = eta[:, n_xi:]
    return x[: world.nv], xi, theta


MIXED = {
    "planar": [(FIXED, FIXED, SLIDING, SLIDING), (SLIDING,) * 4, (FIXED, FIXED, FREE, FREE),
               (FREE, FREE, FIXED, SLIDING), (FIXED,) * 4],
    "hand": [(FIXED, FIXED), (SLIDING, SLIDING), (FIXED, SLIDING), (FREE, FIXED), (SLIDING, FREE)],
    "coupled": [(FIXED, FIXED), (FIXED, SLIDING)],
}  # fmt: skip


@pytest.mark.parametrize("place", ["random", "limits"])
@pytest.mark.parametrize(
    ("robot_name", "surface", "modes"), [(r, s, m) for r, s in ROBOT_SURFACES for m in MIXED[r]]
)
def test_eliminated_rows_are_the_extended_jacobian_with_free_passive_joints(
    robot_name: str, surface: str, modes: tuple[ContactMode, ...], place: str
) -> None:
    world = _world(robot_name, surface, modes, place)
    kin = world.update()
    r, n = kin.row_count, world.grasp.count
    per = {FREE: 0, FIXED: 2 if world.planar else 3, SLIDING: 1}
    assert r == sum(per[m] for m in modes)
    v = np.linalg.lstsq(kin.rows[:r], kin.rhs[:r], rcond=None)[0]
    solved = unpacked(kin.extend(v, 0.0 * v)[0], n)
    gaps = []
    for weight in (1e-8, 1e-10):
        expected = split(world, weighted_solution(world, kin, weight))
        size = max(1.0, *(np.abs(e).max() for e in expected))
        gaps.append(max(np.abs(a - b).max() for a, b in zip(solved, expected, strict=True)) / size)
    # what remains is the passive joints' price: it goes with their weight
    assert gaps[0] < 1e-4 and gaps[1] < 1e-6
    assert gaps[1] < max(0.02 * gaps[0], 1e-8)
    # and the equations themselves hold to rounding
    j, b = extended_jacobian(kin)
    assert np.abs(j @ joined(world, *solved) - b).max() < 1e-9 * size


def joined(world: World, v: np.ndarray, xi: np.ndarray, theta: np.ndarray) -> np.ndarray:
    angles = theta[:, 2:] if world.planar else theta
    eta = np.hstack([xi[:, : world.grasp.n_xi], angles])
    return np.concatenate([v, eta.ravel()])


@pytest.mark.parametrize(("robot_name", "surface"), ROBOT_SURFACES)
def test_null_motions_leave_the_object_at_rest(robot_name: str, surface: str) -> None:
    for modes in MIXED[robot_name]:
        world = _world(robot_name, surface, modes)
        kin = world.update()
        rows, n = kin.rows[: kin.row_count], world.grasp.count
        v = seeded(robot_name, surface, modes).normal(size=world.nv)
        v -= np.linalg.pinv(rows) @ (rows @ v)
        _, xi_rate, pivot_rate = unpacked(np.subtract(*kin.extend(0.0 * v, v)[::-1]), n)
        j, _ = extended_jacobian(kin)
        assert np.abs(j @ joined(world, v, xi_rate, pivot_rate)).max() < 1e-10
        for i in range(n):
            if modes[i] == FREE:
                assert not xi_rate[i].any() and not pivot_rate[i].any()
                continue
            if modes[i] == FIXED:
                assert not xi_rate[i].any()
            motion = {"v": v, "xi": xi_rate[i], "theta": pivot_rate[i]}
            assert np.abs(Chain(world, i).object_twist(**motion)).max() < 1e-8


@pytest.mark.parametrize(("robot_name", "surface"), ROBOT_SURFACES)
def test_a_finger_that_touches_sees_the_object_where_it_is(robot_name: str, surface: str) -> None:
    modes = (FIXED,) + (FREE,) * (len(_world(robot_name).grasp.fingers) - 1)
    world = _world(robot_name, surface, modes)
    kin = world.update()
    assert kin.holding == 1
    pivots = world.state.pivot.copy()
    pivots[1] = kin.touch(1)
    mode = world.state.mode.copy()
    mode[1] = FIXED
    rotation = kin.object_rotation.copy()
    kin = replace(world, state=world.state._replace(pivot=pivots, mode=mode)).update()
    assert_allclose(kin.rotation[1], rotation, atol=1e-14)


@pytest.mark.parametrize("robot_name", SETTINGS)
def test_the_object_estimate_is_the_mean_of_the_fingers_in_contact(robot_name: str) -> None:
    world = _world(robot_name, modes=FREE)
    kin = world.update()
    assert kin.holding == 0 and kin.row_count == 0
    assert np.array_equal(kin.object_position, world.reference.position)
    assert np.array_equal(kin.object_rotation, world.reference.rotation)
    world = _world(robot_name, modes=MIXED[robot_name][0])
    kin = world.update()
    assert kin.holding == world.grasp.count
    assert_allclose(kin.object_position, kin.position.mean(axis=0), atol=1e-14)


def test_the_object_estimate_when_fingers_nearly_agree() -> None:
    """Fingers that differ by ε average to their mean rotation up to ε²."""
    world = _world("hand", modes=FIXED)
    kin = world.update()
    truth = kin.rotation[0].copy()
    pivots = world.state.pivot.copy()
    pivots[0] = kin.robot.rotation[0].T @ exp_so3(np.array([1e-4, 0, 0])) @ truth @ kin.frame[0]
    pivots[1] = kin.robot.rotation[1].T @ exp_so3(np.array([0, -3e-4, 0])) @ truth @ kin.frame[1]
    kin = replace(world, state=world.state._replace(pivot=pivots)).update()
    assert_allclose(log_so3(kin.object_rotation @ truth.T), [0.5e-4, -1.5e-4, 0.0], atol=3e-8)
