"""Closing by touch: where the object is found, when a finger is sure, what it does then."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wbc.contact.grasp import ContactMode, ContactState, Grasp
from wbc.contact.surfaces import Box, Cylinder, Sphere, Surface
from wbc.contact.surfaces.foot import outward
from wbc.control.phases import SURE, PhaseSequence
from wbc.control.phases import _sensed as sensed
from wbc.control.state import ControllerState, Measurement, TickRecord
from wbc.control.touch import Felt, displacement, found
from wbc.rotations import exp_so3
from wbc.scenario import load
from wbc.scenario.build import Assembly, build

from .drivers import Broken

PAD = 5e-3
BODIES: list[tuple[Surface, list[list[float]], list[int], tuple[int, ...]]] = [
    # surface, contact coordinates, faces, directions of a displacement that touches tell
    (Sphere(0.03), [[0.0, 0.0], [2.2, 0.3], [-2.0, -0.2], [0.5, 0.9]], [0] * 4, (0, 1, 2)),
    (Cylinder(0.026, 0.3), [[0.0, 0.05], [2.2, 0.0], [-2.0, -0.06]], [0] * 3, (0, 1)),
    (Box((0.06, 0.06, 0.2)), [[0.01, 0.02], [0.0, -0.03], [0.01, 0.0]], [0, 1, 2], (0, 1)),
]


def touching(surface: Surface, at: list[list[float]], face: list[int], moved: np.ndarray):
    """Fingers that come along their nominal normals touch a body that stands beside its place."""
    n = len(at)
    grasp = Grasp(
        surface, tuple(f"f{i}" for i in range(n)), np.array(at), np.array(face), np.full(n, 5e4),
        np.full(n, PAD), np.ones(n), False,
    )  # fmt: skip
    tips = np.empty((n, 3))
    for i in range(n):
        c, c_u, c_v = surface.charts(grasp.at[i : i + 1], face[i])[0, :3]
        normal = np.cross(c_u, c_v) / np.linalg.norm(np.cross(c_u, c_v))
        low, high = -0.02, 0.05  # outwards along the normal, by bisection
        for _ in range(60):
            middle = 0.5 * (low + high)
            inside = surface.level(c + middle * normal - moved) < PAD
            low, high = (middle, high) if inside else (low, middle)
        tips[i] = c + low * normal
    state = ContactState.planned(grasp, np.zeros(n, dtype=np.int64))
    return grasp, state, tips


@pytest.mark.parametrize("body", BODIES, ids=lambda body: type(body[0]).__name__)
def test_the_object_is_found_where_it_is(body: Any) -> None:
    surface, at, face, told = body
    moved = np.zeros(3)
    moved[list(told)] = np.array([3e-3, -2e-3, 2.5e-3])[list(told)]
    _, _, tips = touching(surface, at, face, moved)
    d = displacement(surface, tips, np.full(len(at), PAD))
    np.testing.assert_allclose(d[list(told)], moved[list(told)], atol=3.5e-4)  # the prior's share
    untold = [k for k in range(3) if k not in told]
    np.testing.assert_allclose(d[untold], 0.0, atol=1e-9)


@pytest.mark.parametrize("body", BODIES, ids=lambda body: type(body[0]).__name__)
def test_contact_points_are_the_measured_ones_with_the_normals_of_the_body_that_is_there(
    body: Any,
) -> None:
    surface, at, face, told = body
    moved = np.zeros(3)
    moved[list(told)] = np.array([4e-3, -2e-3, 1e-3])[list(told)]
    grasp, state, tips = touching(surface, at, face, moved)
    contact = found(grasp, state, tips, np.ones(len(at), dtype=np.bool_))
    for i in range(len(at)):
        c, c_u, c_v = surface.charts(contact.xi[i : i + 1], int(contact.face[i]))[0, :3]
        normal = np.cross(c_u, c_v) / np.linalg.norm(np.cross(c_u, c_v))
        # the tip is a pad's length outside the contact point: to rounding, whatever the fit
        np.testing.assert_allclose(c + contact.shift[i] + PAD * normal, tips[i], atol=1e-12)
        true = surface.level_gradient(tips[i] - moved)
        assert np.degrees(np.arccos(min(1.0, normal @ true))) < 0.6


def test_free_fingers_learn_where_the_object_is_and_those_that_hold_keep_their_points() -> None:
    surface, at, face, _ = BODIES[0]
    moved = np.array([2e-3, 1e-3, -3e-3])
    grasp, state, tips = touching(surface, at, face, moved)
    state = state._replace(mode=np.array([0, 0, 0, int(ContactMode.FIXED)]))
    new = np.array([True, True, True, False])
    contact = found(grasp, state, tips, new)
    np.testing.assert_array_equal(contact.shift[3], 0.0)
    np.testing.assert_array_equal(contact.xi[3], state.xi[3])
    state = state._replace(mode=np.zeros(4, dtype=np.int64))
    contact = found(grasp, state, tips, new)
    assert np.linalg.norm(contact.shift[3] - moved) < 0.6 * np.linalg.norm(moved)
    np.testing.assert_array_equal(contact.xi[3], state.xi[3])


def test_found_again_nothing_changes() -> None:
    """Where the object is as believed, and the tips on it, contact points stay."""
    surface, at, face, _ = BODIES[0]
    grasp, state, tips = touching(surface, at, face, np.zeros(3))
    contact = found(grasp, state, tips, np.ones(4, dtype=np.bool_))
    np.testing.assert_allclose(contact.shift, 0.0, atol=1e-12)
    np.testing.assert_allclose(contact.xi, state.xi, atol=1e-9)


GUARDED = {
    "simulation.engine": "kinematic",
    "simulation.integrator": "euler",
    "phases.close.until": {"touch": {"force": "0.15 N", "search": "6 mm"}},
    "phases.close.over": "0.8 s",
    "phases.grip.until": {"press": "0.7"},
}


@pytest.fixture(scope="module")
def ball() -> Assembly:
    given = load("ball_exchange_mujoco", GUARDED)
    return build(given)


def closing(assembly: Assembly) -> ControllerState:
    """The first tick of the phase that closes by touch."""
    state = assembly.start
    names = [phase.name for phase in assembly.controller.phases.phases]
    for _ in range(2000):
        if names[state.phase.current] == "close":
            return state
        _, state = assembly.controller.step(state)
    raise AssertionError("never began to close")


def press(record: TickRecord, size: dict[int, float]) -> np.ndarray:
    """Forces (N, 3) of fingers that press."""
    force = np.zeros((len(record.mode), 3))
    for i, newtons in size.items():
        force[i] = -newtons * record.contact_normals[i]
    return force


def driven(assembly: Assembly, felt: Any, ticks: int = 700) -> list[tuple[TickRecord, Any]]:
    """Close with forces that `felt(tick, record)` makes up."""
    state, out = closing(assembly), []
    record, _ = assembly.controller.step(state)
    for k in range(ticks):
        measured = Measurement(state.q, np.zeros_like(state.q), felt(k, record))
        record, state = assembly.controller.step(state, measured)
        out.append((record, state))
    return out


def test_a_finger_stops_when_it_is_sure_and_the_phase_ends_when_all_are(ball: Assembly) -> None:
    when = {0: 210, 1: 250, 2: 231}

    def felt(k: int, record: TickRecord) -> np.ndarray:
        return press(record, {i: 0.2 for i, t in when.items() if k >= t})

    run = driven(ball, felt, 300)
    kin = ball.controller.law.kin
    for i, t in when.items():
        tips = np.array([state.phase.motion.tips[1, i] for _, state in run])
        moves = np.flatnonzero(np.any(np.diff(tips, axis=0) != 0.0, axis=1)) + 1
        assert moves[0] == t + SURE - 1  # its reference stops there and then
    phases = [state.phase.current for _, state in run]
    grip = phases.index(phases[0] + 1)
    assert grip == max(when.values()) + SURE - 1
    # nothing jumps: the velocity changes by no more than the limits' acceleration allows
    v = np.array([record.v for record, _ in run])
    steps = np.abs(np.diff(v, axis=0)).max(axis=0)
    settings = ball.controller.settings
    assert np.all(steps <= settings.acceleration * settings.dt * (1.0 + 1e-9))
    assert kin.grasp.count == 6


@pytest.mark.parametrize(
    "wrong",
    [
        lambda k, record: press(record, {i: 5.0 for i in range(3)} if k % 3 else {}),
        lambda k, record: np.full((6, 3), np.nan),
        lambda k, record: press(record, {0: 3.0, 1: 3.0}),
        lambda k, record: -press(record, {i: 3.0 for i in range(3)}),
        lambda k, record: np.zeros((2, 3)),
    ],
    ids=["never three in a row", "no numbers", "one does not touch", "pulled", "wrong size"],
)
def test_what_is_no_touch_of_all_never_ends_the_phase(ball: Assembly, wrong: Any) -> None:
    run = driven(ball, wrong, 1100)
    first = run[0][1].phase.current
    assert all(state.phase.current == first for _, state in run)
    assert run[-1][1].phase.stopped and "close" in run[-1][1].phase.timeouts
    assert all(np.isfinite(record.v).all() for record, _ in run)
    assert not any(record.mode.any() for record, _ in run)


def test_a_finger_that_feels_nothing_goes_on_as_far_as_it_is_to_search(ball: Assembly) -> None:
    run = driven(ball, lambda k, record: np.zeros((6, 3)), 800)
    _, state = run[-1]
    kin = ball.controller.law.kin
    for i in range(3):
        tip = state.phase.motion.tips[1, i]
        assert kin.grasp.surface.level(tip) == pytest.approx(PAD - 6e-3, abs=1e-6)


def test_a_touch_before_the_believed_place_becomes_the_contact_point(ball: Assembly) -> None:
    at = {0: 160, 1: 200, 2: 180}

    def felt(k: int, record: TickRecord) -> np.ndarray:
        return press(record, {i: 0.2 for i, t in at.items() if k >= t})

    run = driven(ball, felt, 260)
    first = next(k for k, (_, state) in enumerate(run) if state.contact.mode.any())
    record, state = run[first]
    kin = ball.controller.law.kin
    assert 1e-3 < np.linalg.norm(state.contact.shift[0]) < 12e-3
    kin.update(run[first - 1][1].q, state.contact, kin.reference)
    for i in at:
        reach = np.linalg.norm(kin.robot.position[i] - record.contact_points[i])
        assert reach == pytest.approx(PAD, abs=1e-9)
    assert np.nanmax(record.object_error) < 1e-6  # every finger sees the object where it should be


def test_pressing_is_waited_for(ball: Assembly) -> None:
    def felt(k: int, record: TickRecord) -> np.ndarray:
        planned = record.forces.force if record.forces is not None else np.zeros((6, 3))
        share = 0.2 if k < 300 or record.forces is None else (0.5 if k < 600 else 0.9)
        touch = press(record, {i: 0.3 for i in range(3) if k >= 220})  # about where it is believed
        return touch if not record.mode.any() else share * planned

    run = driven(ball, felt, 700)
    grip = next(k for k, (_, s) in enumerate(run) if s.phase.current == run[0][1].phase.current + 1)
    assert grip < 240
    lift = next(k for k, (_, s) in enumerate(run) if s.phase.current == run[0][1].phase.current + 2)
    assert 600 + SURE - 1 <= lift <= 600 + SURE + 1


def test_what_is_felt_far_from_the_object_is_not_the_object(ball: Assembly) -> None:
    """Noise in the air, or another thing: the finger stops, and nobody grips on it."""
    run = driven(ball, lambda k, record: press(record, {i: 1.0 for i in range(3)}), 1100)
    first, last = run[0][1].phase, run[-1][1].phase
    assert last.current == first.current and last.stopped
    np.testing.assert_array_equal(run[-1][1].contact.shift, 0.0)


def test_a_timeout_that_goes_on_keeps_what_was_touched(ball: Assembly) -> None:
    phases = list(ball.controller.phases.phases)
    k = next(i for i, phase in enumerate(phases) if phase.name == "close")
    phases[k] = replace(phases[k], on_timeout="next", timeout=1.0)
    sequence = PhaseSequence(tuple(phases))
    late = replace(ball, controller=ball.controller.like(sequence, ball.controller.settings))

    def felt(tick: int, record: TickRecord) -> np.ndarray:
        return press(record, {0: 0.3, 1: 0.3} if tick >= 230 else {})

    run = driven(late, felt, 700)
    first = next(j for j, (_, state) in enumerate(run) if state.contact.mode.any())
    record, state = run[first]
    assert "close" in state.phase.timeouts
    assert np.nanmax(record.object_error[:2]) < 1e-6  # who touched sees the object where it was


@pytest.mark.parametrize(
    "strange",
    [["0.1"] * 47, [10**400] * 47, np.full(47, 1j), object(), np.full(3, 0.1), np.full(47, np.nan)],
    ids=["text", "huge", "complex", "object", "size", "nan"],
)
def test_what_is_no_measurement_is_no_exception(ball: Assembly, strange: Any) -> None:
    state = closing(ball)
    for measured in (Measurement(strange), Measurement(state.q, state.q, strange)):
        record, after = ball.controller.step(state, measured)
        assert np.isfinite(record.v).all() and np.isfinite(after.q).all()


def test_a_force_that_raises_is_no_touch_and_no_exception(ball: Assembly) -> None:
    """As forces that are no numbers: a sensor is there, so where the surface is tells nothing."""
    state = closing(ball)
    for _ in range(5):
        measured: Any = Broken("force", q=state.q, v=state.q)
        record, after = ball.controller.step(state, measured)
        none = np.full((6, 3), np.nan)
        same, state = ball.controller.step(state, Measurement(state.q, state.q, none))
        np.testing.assert_array_equal(record.v, same.v)
        np.testing.assert_array_equal(after.q, state.q)


def test_where_no_forces_are_planned_no_press_is_enough(ball: Assembly) -> None:
    """A first tick without a feasible plan has forces of 0: no object is to be lifted on them."""
    phase = ball.controller.phases.phases[3]
    assert phase.name == "grip" and phase.until.press == 0.7
    state = closing(ball).phase._replace(current=3)
    kin = ball.controller.law.kin
    felt = Felt(np.full(6, 5.0), np.zeros((6, 3)), np.zeros(6))
    for planned, steady in ((np.zeros(6), 0), (np.full(6, 2.0), 1), (None, 0)):
        assert sensed(phase, state, kin, felt, planned).steady == steady


def test_the_ideal_robot_touches_where_the_surface_is_believed(ball: Assembly) -> None:
    state = closing(ball)
    first = state.phase.current
    for _ in range(600):
        _, state = ball.controller.step(state, Measurement(state.q))
        if state.phase.current != first:
            break
    assert state.phase.current == first + 1
    assert np.linalg.norm(state.contact.shift, axis=1).max() < 3e-4  # three ticks at 30 mm/s


def test_what_arms_lack_does_not_move_the_contact_points() -> None:
    """Tips held about the palm: a sagging arm takes palm, tip and contact point along."""
    from wbc.control.touch import TouchSense

    assembly = build(load("ball_exchange_mujoco", GUARDED))
    kin, start = assembly.controller.law.kin, assembly.start
    kin.update(start.q, start.contact, kin.reference)
    sense = assembly.controller.touch
    assert isinstance(sense, TouchSense)
    sagging = start.q.copy()
    sagging[assembly.model.joint("right_arm_2")] += 0.01
    still = sense.read(kin, Measurement(start.q)).tips
    np.testing.assert_array_equal(sense.read(kin, Measurement(sagging)).tips, still)
    bent = start.q.copy()
    bent[assembly.model.joint("right_index_med")] += 0.01
    assert np.abs(sense.read(kin, Measurement(bent)).tips - still).max() > 1e-4


def test_how_far_away_tips_are_counts_from_where_they_found_the_surface() -> None:
    """They found it 12 mm further in, and go 18 mm away from there."""
    away = {"r_*": {"clearance": "18 mm"}}
    phases = [
        {"name": "wait", "tasks": [], "over": "0.01 s", "until": {"time": "0.01 s"}},
        {
            "name": "away",
            "reach": away,
            "tasks": [],
            "over": "0.5 s",
            "until": {"distance": "15 mm"},
        },
    ]
    given = {"phases": phases, "forces.estimate": None}
    assembly = build(load("ball_exchange_mujoco", given))
    state, grasp = assembly.start, assembly.controller.law.kin.grasp
    shift = -12e-3 * outward(grasp.surface.charts(grasp.at, grasp.face))
    state = state._replace(contact=state.contact._replace(shift=shift))
    for _ in range(400):
        _, state = assembly.controller.step(state)
    assert state.phase.done


def test_a_shift_turns_with_the_object() -> None:
    """The contact point is c + shift in the object's frame, wherever the object goes."""
    assembly = build(load("ball_exchange_mujoco", GUARDED))
    kin, start = assembly.controller.law.kin, assembly.start
    shift = np.tile([1e-3, 2e-3, -1e-3], (6, 1))
    contact = start.contact._replace(shift=shift)
    turn = exp_so3(np.array([0.1, -0.2, 0.3]))
    reference = replace_rotation(kin.start, turn)
    plain = np.array(kin.update(start.q, start.contact, reference).charts[:, 0])
    moved = kin.update(start.q, contact, reference).charts[:, 0]
    np.testing.assert_allclose(moved - plain, shift, atol=1e-15)


def replace_rotation(reference: Any, turn: np.ndarray) -> Any:
    return reference._replace(rotation=turn @ reference.rotation)


def test_the_scenario_says_what_does_not_fit() -> None:
    from wbc.errors import ScenarioError

    with pytest.raises(ScenarioError, match=r"until.touch.*needs a finger in 'reach'"):
        load("ball_exchange_mujoco", {"phases.grip.until": {"touch": {"force": "0.1 N"}}})
    with pytest.raises(ScenarioError, match="force"):
        load("ball_exchange_mujoco", {"phases.close.until": {"touch": {"force": "0 N"}}})
