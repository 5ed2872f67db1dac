"""The exchanges in space: what the reference run of each object must show, as laws."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from wbc.control.state import Status
from wbc.synergies import Synergies

from .runs import Run, check_laws, simulate

OTHERS = ("dual_arm_box", "dual_arm_ball")
SHORT = 100  # ticks
STEP = 0.03  # [rad/s] per tick
ROOM = np.deg2rad(0.5)  # to a joint's limit in the robot's file


def exchange(scenario: str, overrides: dict[str, Any] | None = None) -> Run:
    """A whole exchange, as its file says; it ends with its phases."""
    return simulate(scenario, overrides, to_the_end=True)


def phase_names(run: Run) -> list[str]:
    return [phase.name for phase in run.assembly.controller.phases.phases]


def in_phase(run: Run, *names: str) -> np.ndarray:
    """(T,) ticks of these phases."""
    all_names = phase_names(run)
    return np.isin(run.series("phase"), [all_names.index(name) for name in names])


def balance(run: Run, fingers: list[str]) -> np.ndarray:
    """(T, 2) ε_f and ε_m of (44)-(45) over some fingers, each normal weighted with its share."""
    grasp = run.assembly.controller.law.kin.grasp
    pick = [grasp.fingers.index(finger) for finger in fingers]
    normals = run.series("contact_normals")[:, pick] * grasp.share[pick][:, None]
    arms = run.series("contact_points")[:, pick] - run.series("object_position")[:, None]
    force, moment = normals.sum(axis=1), np.cross(arms, normals).sum(axis=1)
    return 0.5 * np.stack([np.sum(force**2, axis=1), np.sum(moment**2, axis=1)], axis=1)


def check_exchange(run: Run) -> None:
    """What every whole exchange keeps."""
    check_laws(run)
    check_ending(run)
    check_object(run)
    check_balance(run)
    check_room(run)


def check_ending(run: Run) -> None:
    """Success: every phase was reached, none timed out, nothing gave way, few events."""
    phase = run.state.phase
    assert phase.done and not phase.stopped and phase.timeouts == ()
    assert (np.unique(run.series("phase")) == np.arange(len(phase_names(run)))).all()
    gave_way = run.status & ~(Status.DONE | Status.AT_EDGE)
    assert not gave_way, gave_way
    assert len(run.events) <= 4


def check_object(run: Run) -> None:
    """Held to rounding, also while it moves 5 cm and 0.3 rad."""
    errors = run.series("object_error")
    held = (run.series("mode") > 0).any(axis=1)
    assert np.nanmax(errors[held, :, 0]) < 1e-9, "[m]"
    assert np.nanmax(errors[held, :, 1]) < 1e-8, "[rad]"
    assert held[in_phase(run, "lift", "present", "carry")].all()
    moving = in_phase(run, "present")
    place, turn = run.series("object_position")[moving], run.series("object_rotation")[moving]
    assert np.linalg.norm(place[-1] - place[0]) == pytest.approx(0.05, abs=1e-4)
    cosine = 0.5 * (np.trace(turn[0].T @ turn[-1]) - 1.0)
    assert np.arccos(cosine) == pytest.approx(0.3, abs=1e-3)


def check_balance(run: Run) -> None:
    """ε_f, ε_m < 1e-6 from the hand-over on, and of the left hand alone."""
    fingers = run.assembly.controller.law.kin.grasp.fingers
    after = in_phase(run, "hand_over")
    assert (run.series("residuals")[after] < 1e-6).all()
    left = [finger for finger in fingers if finger.startswith("l_")]
    afterwards = in_phase(run, "hand_over", "release", "retreat", "carry")
    assert (balance(run, left)[afterwards] < 1e-6).all()
    assert (balance(run, left)[in_phase(run, "slide")][0] > 1e-6).any(), "there was work to do"


def check_room(run: Run) -> None:
    """Bodies above the safety distance, joints off the limits of the file, no velocity step."""
    model = run.assembly.model
    specs = run.assembly.loaded.scenario.costs.values()
    safety = [spec.safety_distance for spec in specs if spec.type == "collision"]
    assert run.series("min_distance").min() >= max(safety)
    assert np.minimum(run.q - model.lower, model.upper - run.q).min() >= ROOM
    assert run.velocity_steps.max() <= STEP


@pytest.fixture(scope="module")
def bottle() -> Run:
    return exchange("dual_arm_exchange")


def test_bottle(bottle: Run) -> None:
    report(bottle)
    check_exchange(bottle)


@pytest.mark.parametrize(
    ("side", "comes", "before"),
    [("right", ("reach", "enter"), ()), ("left", ("approach", "surround"), ("reach", "present"))],
)
def test_three_numbers_shape_a_hand_on_its_way(
    bottle: Run, side: str, comes: tuple[str, ...], before: tuple[str, ...]
) -> None:
    """From the zero offset to the weights, whatever the fingertips are led to meanwhile."""
    hand, model = Synergies.from_table(), bottle.assembly.model
    joints = [model.joint(f"{side}_{joint}") for joint in hand.joints]
    weights = np.rad2deg(hand.project(bottle.q[:-1, joints]))
    assert np.abs(weights[0]).max() < 1e-9
    for name in before:
        assert np.abs(weights[in_phase(bottle, name)]).max() < 2.0
    for name in comes:
        assert np.abs(weights[in_phase(bottle, name)][-1] - (-11.0, -26.0, 9.0)).max() < 0.2


def report(run: Run) -> None:
    """The figures of docs/results.md."""
    model = run.assembly.model
    room = np.minimum(run.q - model.lower, model.upper - run.q).min()
    errors = run.series("object_error")
    print(
        f"{run.assembly.loaded.scenario.name}: {run.t[-1]:.2f} s, "
        f"object {np.nanmax(errors[:, :, 0]):.2g} m, {np.nanmax(errors[:, :, 1]):.2g} rad, "
        f"residuals {run.records[-1].residuals}, "
        f"distance {1e3 * run.series('min_distance').min():.2f} mm, "
        f"room {np.rad2deg(room):.2f} deg, step {run.velocity_steps.max():.4f} rad/s, "
        f"events {run.events}"
    )


@pytest.mark.slow
@pytest.mark.parametrize("scenario", OTHERS)
def test_others(scenario: str) -> None:
    run = exchange(scenario)
    report(run)
    check_exchange(run)


@pytest.mark.parametrize("scenario", OTHERS)
def test_others_begin(scenario: str) -> None:
    run = simulate(scenario, ticks=SHORT)
    check_laws(run)
    check_room(run)


def test_same_run_twice(bottle: Run) -> None:
    """Bit for bit, the controller built anew."""
    again = simulate("dual_arm_exchange", ticks=SHORT)
    np.testing.assert_array_equal(again.q, bottle.q[: SHORT + 1])
    np.testing.assert_array_equal(again.v, bottle.v[:SHORT])


@pytest.mark.parametrize(
    ("integrator", "near"), [("rk4", 1e-4), pytest.param("euler", 1e-2, marks=pytest.mark.slow)]
)
def test_another_tick(bottle: Run, integrator: str, near: float) -> None:
    """At 4 ms the same phases, and the same contacts and joints at the end."""
    other = exchange(
        "dual_arm_exchange",
        {"simulation.step": "4 ms", "simulation.integrator": integrator},
    )
    assert other.state.phase.done and other.state.phase.timeouts == ()
    apart = np.abs(other.state.q - bottle.state.q).max()
    slid = np.abs(other.state.contact.xi - bottle.state.contact.xi).max()
    print(f"{integrator} at 4 ms against rk4 at 2 ms: joints {apart:.2g} rad, contacts {slid:.2g}")
    assert apart < near and slid < near
