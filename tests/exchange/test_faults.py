"""Faults injected into a running exchange: laws kept, what gave way said, then back to work."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from wbc.control.state import ControllerState, Measurement, Status
from wbc.robot.distances import Distances

from .runs import Run, assemble, check_laws, simulate

DT = 2e-3
BAD: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "nan": lambda q: np.full_like(q, np.nan),
    "one nan": lambda q: np.r_[q[:-1], np.nan],
    "inf": lambda q: np.r_[q[:-1], -np.inf],
    "short": lambda q: q[:-1],
    "long": lambda q: np.r_[q, 0.0],
    "empty": lambda q: np.zeros(0),
    "column": lambda q: q[:, None],
}


def flags(run: Run, flag: Status) -> np.ndarray:
    """(T,) whether a flag is raised."""
    return (run.series("status").astype(np.int64) & flag) > 0


@pytest.mark.parametrize("seed", [0, 1])
def test_measurements_that_cannot_be_used(seed: int) -> None:
    """Bursts of all kinds at random ticks: said there and nowhere else, and the run succeeds."""
    random = np.random.default_rng(seed)
    starts = random.integers(410, 1700, 8)
    bad = {int(k): str(random.choice(list(BAD))) for s in starts
           for k in range(s, s + random.integers(1, 20))}  # fmt: skip

    def sense(state: ControllerState) -> Measurement:
        kind = bad.get(state.tick)
        return Measurement(state.q if kind is None else BAD[kind](state.q))

    run = simulate(sense=sense)
    check_laws(run)
    np.testing.assert_array_equal(np.flatnonzero(flags(run, Status.BAD_MEASUREMENT)), sorted(bad))
    assert Status.CLIPPED not in run.status
    assert run.state.phase.done and not run.state.phase.timeouts
    assert run.object_error[-1] < 1e-9 and max(run.records[-1].residuals) < 1e-6


def test_a_robot_that_goes_blind_stops(reference: Run) -> None:
    """No usable measurement any more: it brakes to a stand, within its limits, and stays."""
    start = simulate(assembly=reference.assembly, ticks=250).state
    moving = np.abs(start.v).max()
    run = simulate(
        assembly=reference.assembly, start=start, ticks=200,
        sense=lambda state: Measurement(np.full_like(state.q, np.nan)),
    )  # fmt: skip
    check_laws(run)
    speed = np.abs(run.v).max(axis=1)
    stood = np.flatnonzero(speed == 0.0)[0]
    print(f"from {moving:.2f} rad/s to rest in {stood} ticks")
    assert moving > 0.3 and stood <= np.ceil(moving / (60.0 * DT))
    assert (speed[stood:] == 0.0).all() and (np.diff(speed[: stood + 1]) < 0.0).all()
    back = simulate(assembly=reference.assembly, start=run.state, ticks=400)
    check_laws(back)
    assert Status.BAD_MEASUREMENT not in back.status
    assert back.object_error[-1] < 1e-9


@pytest.mark.parametrize("limit", [0.1, 1.0, 5.0])
def test_tight_accelerations(limit: float) -> None:
    """Kept to rounding, never joint by joint; what gives way is the change of the motion."""
    run = simulate(overrides={"limits.acceleration": f"{limit} rad/s^2"}, ticks=1300)
    check_laws(run)
    assert run.velocity_steps.max() <= limit * DT + 1e-9
    assert Status.SCALED in run.status and Status.CLIPPED not in run.status
    scaled = flags(run, Status.SCALED)
    shares = np.array([record.limited.change for record in run.records])
    assert (shares[scaled] < 1.0).any() and (shares[~scaled] == 1.0).all()
    error = run.object_error.max()
    print(f"{limit} rad/s^2: object error {error:.2g} m, {scaled.sum()} of 1300 ticks scaled")
    assert error < 1e-6


def test_tight_velocities() -> None:
    run = simulate(overrides={"limits.velocity_scale": 0.05}, ticks=1300)
    check_laws(run)
    assert np.abs(run.v).max() <= 0.05 * 6.0 + 1e-9
    assert run.object_error.max() < 1e-6


def test_tight_velocities_are_reported() -> None:
    run = simulate(overrides={"limits.velocity_scale": 0.05}, ticks=400)
    at_limit = (np.abs(run.v) >= 0.05 * 6.0 - 1e-9).any(axis=1)
    assert at_limit.any() and flags(run, Status.SCALED)[at_limit].all()


def test_slower_than_a_tick_of_braking_is_not_stuck() -> None:
    run = simulate(overrides={"limits.velocity_scale": 0.02}, ticks=600)
    check_laws(run)
    assert np.abs(run.v).max() <= 0.02 * 6.0 + 1e-9
    assert Status.NEAR_SINGULAR not in run.status and Status.SCALED in run.status


@pytest.mark.parametrize(
    "overrides",
    [
        {"tasks.force.gain": "1000 /s", "tasks.moment.gain": "1000 /s"},
        {"tasks.force.gain": "1e6 /s", "tasks.dexterity.gain": "1e6 /s"},
        {"tasks.object.gain": "1e6 /s"},
        {"stack.gradient_gain": 1e4},
        {"costs.collision.weight": 1e6, "costs.joint_limits.weight": 1e6},
        {"simulation.step": "50 ms"},
        {"supervisor.smoothing": "1e5 /s"},
    ],
    ids=lambda overrides: ",".join(overrides) if isinstance(overrides, dict) else "",
)
def test_numbers_beyond_reason(overrides: dict[str, Any]) -> None:
    """Gains that no tick can integrate: the limits hold and the object is not flung away."""
    run = simulate(overrides=overrides, ticks=800 if "simulation.step" not in overrides else 100)
    check_laws(run)
    print(f"{overrides}: object error {run.object_error.max():.2g} m, {run.status!r}")
    assert run.object_error.max() < 0.1


def test_a_start_beyond_hard_limits_comes_back(reference: Run) -> None:
    """Two joints pushed beyond their limits: they may only return; the object is found again."""
    push = np.zeros_like(reference.state.q)
    push[[1, 8]] = np.deg2rad([34.4, -22.9])
    start = reference.assembly.start
    run = simulate(assembly=reference.assembly, start=start._replace(q=start.q + push), ticks=900)
    check_laws(run)
    settings = reference.assembly.controller.settings
    assert run.q[0, 1] > settings.upper[1] and run.q[0, 8] < settings.lower[8]
    outside = np.maximum(run.q - settings.upper, settings.lower - run.q).max(axis=1)
    assert (np.diff(outside[outside > 0.0]) <= 1e-9).all()
    assert outside[-1] < 0.0 and run.object_error[-1] < 1e-6


def test_an_object_pushed_out_of_reach() -> None:
    """The reference runs 2 m away: the robot follows as far as it goes, and says that it failed."""
    away = {"target": {"position": [1.5, 1.5], "angle": "0 deg"}, "relative": True}
    run = simulate(overrides={"phases.slide.object": away, "phases.slide.over": "1 s"}, ticks=2200)
    check_laws(run)
    assert Status.SCALED in run.status and Status.PHASE_TIMEOUT in run.status
    assert run.state.phase.timeouts == ("slide",) and not run.state.phase.done
    assert np.abs(run.v[-1]).max() < 0.5  # come to rest, more or less


@pytest.mark.parametrize("what", ["some", "all", "measured"])
def test_distances_that_are_no_numbers(monkeypatch: pytest.MonkeyPatch, what: str) -> None:
    """They count as a collision, not as far away; the command stays finite and in its limits."""
    random = np.random.default_rng(5)
    update = Distances.update

    def broken(self: Distances, *at: Any) -> Distances:
        update(self, *at)
        if what == "all" or random.random() < 0.02:
            self.value[int(random.integers(len(self.value)))] = -np.inf
        return self

    if what == "measured":
        monkeypatch.setattr(Distances, "_measure", lambda self, pair: np.nan)
    else:
        monkeypatch.setattr(Distances, "update", broken)
    run = simulate(ticks=700)
    check_laws(run)
    assert run.series("min_distance").min() == -np.inf
    assert run.object_error.max() < 1e-2  # costs that jump every tick shake the robot
    if what == "all":
        assert not run.state.stack.allowed.all()  # what moves it has been taken out


def test_limits_of_zero_and_infinity() -> None:
    """A locked joint and joints without a limit, put straight into the controller's settings."""
    assembly = assemble()
    controller = assembly.controller
    velocity = controller.settings.velocity.copy()
    velocity[2], velocity[9] = 0.0, np.inf
    controller.settings = dataclasses.replace(controller.settings, velocity=velocity)
    run = simulate(assembly=assembly, ticks=900)
    check_laws(run)
    assert (run.q[:, 2] == run.q[0, 2]).all()


def test_time_may_be_any_multiple_of_the_tick(reference: Run) -> None:
    """A tick counter far in the future: no drift, no phase that never ends, no NaN."""
    far = reference.state._replace(tick=10**9)
    run = simulate(assembly=reference.assembly, start=far, ticks=20)
    check_laws(run)
    assert run.object_error.max() < 1e-9
