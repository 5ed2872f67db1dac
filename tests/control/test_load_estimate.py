"""Mass and centre of mass from fingertip forces: exact on exact forces, smoothed and bounded."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wbc.control.load_estimate import LoadEstimate, LoadState
from wbc.control.payload import Body, Payload, wrench_to_supply
from wbc.control.state import ControllerState, Measurement
from wbc.errors import ScenarioError
from wbc.rotations import exp_so3
from wbc.scenario.build import Assembly

from .drivers import Broken
from .holding import LIFT, holding

GRAVITY = np.array([0.0, 0.0, -9.81])
ESTIMATE = LoadEstimate(0, 0.25, 0.3, 3.0, 0.02)
BELIEVED = Payload(0.2, np.array([2e-3, 0.0, -4e-3]), np.array([1e-3, 2e-3, 1.5e-3])).alone
DT = 2e-3


def true_body(mass: float, shift: np.ndarray) -> Body:
    """The believed object with another mass, its centre elsewhere."""
    moments = np.array([1e-3, 2e-3, 1.5e-3]) * mass / 0.2
    return Payload(mass, BELIEVED.com + shift, moments).alone


class Handled:
    """Three fingertips whose forces are what a true body needs in a motion."""

    def __init__(self, body: Body) -> None:
        self.body = body
        self.points = 0.03 * np.array([[1.0, 0, 0], [-0.5, 0.8, 0.1], [-0.5, -0.8, -0.2]])

    def sample(self, t: float) -> dict[str, np.ndarray]:
        """Everything the estimate is given at t, but for its state and the tick."""
        axis = np.array([0.9, 0.7, -0.4])
        rotation = exp_so3(np.sin(2.0 * t) * axis)
        twist = np.concatenate([[0.3 * np.sin(3.0 * t), 0.0, 0.0], 2.0 * np.cos(2.0 * t) * axis])
        push = [0.9 * np.cos(3.0 * t), 0.0, 0.2 * np.cos(t)]
        acceleration = np.concatenate([push, -4.0 * np.sin(2.0 * t) * axis])
        return self.at(rotation, twist, acceleration)

    def at(
        self, rotation: np.ndarray, twist: np.ndarray, acceleration: np.ndarray
    ) -> dict[str, np.ndarray]:
        """The same for any motion; the tips also squeeze."""
        wrench, _ = wrench_to_supply(self.body, rotation, twist, acceleration, GRAVITY)
        arm = self.points @ rotation.T
        squeeze = np.array([[1.0, 2.0, 3.0], [-1.0, -2.0, -3.0], [0.0, 0.0, 0.0]])
        wrench[3:] -= np.cross(arm, squeeze).sum(axis=0)
        return {
            "force": squeeze + _forces(arm, wrench), "arm": arm, "rotation": rotation,
            "twist": twist, "acceleration": acceleration, "gravity": GRAVITY,
        }  # fmt: skip


def _forces(arm: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """(3, 3) the least forces at three points that come to a wrench."""
    rows = np.vstack([np.hstack([np.eye(3)] * 3), np.hstack([cross_matrix(r) for r in arm])])
    found: np.ndarray = np.linalg.lstsq(rows, wrench, rcond=None)[0].reshape(3, 3)
    return found


def cross_matrix(r: np.ndarray) -> np.ndarray:
    out: np.ndarray = np.cross(r, np.eye(3)).T
    return out


def after(
    handled: Handled, seconds: float, estimate: LoadEstimate = ESTIMATE, dt: float = DT,
    still: bool = False, noise: float = 0.0,
) -> LoadState:  # fmt: skip
    state, random = estimate.init(), np.random.default_rng(3)
    for k in range(round(seconds / dt)):
        given = handled.sample(0.3 if still else k * dt)
        given["force"] = given["force"] + noise * random.standard_normal((3, 3))
        state = estimate.updated(state, BELIEVED, **given, dt=dt)
    return state


@pytest.mark.parametrize("mass", [0.08, 0.2, 0.258, 0.55])
def test_exact_forces_give_the_true_body_in_any_motion(mass: float) -> None:
    """Turning shows the centre of mass in every direction; the truth is a fixed point."""
    true = true_body(mass, np.array([6e-3, -8e-3, 5e-3]))
    state = after(Handled(true), 12.0)
    body = ESTIMATE.body(BELIEVED, state)
    assert body.mass == pytest.approx(mass, rel=1e-7)
    np.testing.assert_allclose(body.com, true.com, atol=1e-7)
    np.testing.assert_allclose(body.inertia, true.inertia, rtol=1e-5, atol=1e-8)


def test_at_rest_what_lies_along_gravity_stays_as_believed() -> None:
    handled = Handled(true_body(0.25, np.array([6e-3, -8e-3, 5e-3])))
    rotation = exp_so3(np.array([0.5, 0.4, -0.2]))
    given = handled.at(rotation, np.zeros(6), np.zeros(6))
    state = ESTIMATE.init()
    for _ in range(3000):
        state = ESTIMATE.updated(state, BELIEVED, **given, dt=DT)
    down = rotation.T @ [0.0, 0.0, 1.0]
    assert state.mass == pytest.approx(0.05, rel=1e-9)
    assert state.shift @ down == pytest.approx(0.0, abs=1e-12)
    wanted = np.array([6e-3, -8e-3, 5e-3])
    np.testing.assert_allclose(state.shift, wanted - (wanted @ down) * down, atol=1e-9)


def test_the_true_body_is_a_fixed_point_of_every_sample() -> None:
    shift = np.array([6e-3, -8e-3, 5e-3])
    handled, state = Handled(true_body(0.3, shift)), LoadState(0.1, shift)
    for t in np.linspace(0.0, 3.0, 50):
        new = ESTIMATE.updated(state, BELIEVED, **handled.sample(t), dt=0.1)
        assert new.mass == pytest.approx(0.1, abs=1e-12)
        np.testing.assert_allclose(new.shift, shift, atol=1e-12)


def test_the_answer_comes_with_the_time_constant_whatever_the_tick() -> None:
    handled = Handled(true_body(0.3, np.zeros(3)))
    found = [after(handled, 0.25, dt=dt, still=True).mass for dt in (1e-3, 2e-3, 1e-2, 0.05)]
    np.testing.assert_allclose(found, 0.1 * (1.0 - np.exp(-1.0)), rtol=1e-9)


def test_noise_is_smoothed_without_bias() -> None:
    """0.1 N on every component: a thirtieth of the weight is what the low-pass leaves at most."""
    true = true_body(0.3, np.array([5e-3, 0.0, 5e-3]))
    state = after(Handled(true), 10.0, noise=0.1)
    assert state.mass == pytest.approx(0.1, abs=0.003)
    np.testing.assert_allclose(state.shift, [5e-3, 0.0, 5e-3], atol=1e-3)


@pytest.mark.parametrize(("mass", "kept"), [(0.02, 0.06), (1.5, 0.6)])
def test_bounds_are_kept_and_left_again(mass: float, kept: float) -> None:
    far = np.array([0.0, 0.09, 0.03])
    state = ESTIMATE.init()
    for k in range(2000):
        given = Handled(true_body(mass, far)).sample(k * DT)
        state = ESTIMATE.updated(state, BELIEVED, **given, dt=DT)
        assert 0.06 - 1e-12 <= ESTIMATE.body(BELIEVED, state).mass <= 0.6 + 1e-12
        assert np.linalg.norm(state.shift) <= 0.02 + 1e-15
    assert ESTIMATE.body(BELIEVED, state).mass == pytest.approx(kept, rel=1e-3)
    assert np.linalg.norm(state.shift) == pytest.approx(0.02)
    for k in range(2000):  # nothing has wound up
        given = Handled(true_body(0.2, np.zeros(3))).sample(k * DT)
        state = ESTIMATE.updated(state, BELIEVED, **given, dt=DT)
    assert abs(state.mass) < 1e-3 and np.linalg.norm(state.shift) < 1e-3


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e12])
def test_a_sample_that_is_no_force_changes_nothing(bad: float) -> None:
    given, state = Handled(true_body(0.3, np.zeros(3))).sample(0.2), LoadState(0.01, np.ones(3))
    for other in (None, np.ones(3), [["1 N"] * 3] * 3, [[None] * 3] * 3):
        sample: dict[str, Any] = {**given, "force": other}
        assert ESTIMATE.updated(state, BELIEVED, **sample, dt=DT) is state
    assert ESTIMATE.updated(state, BELIEVED, **given, dt=0.0) is state
    given["force"] = np.array(given["force"])
    given["force"][1, 2] = bad
    assert ESTIMATE.updated(state, BELIEVED, **given, dt=DT) is state


def test_an_object_in_free_fall_says_nothing() -> None:
    given, state = Handled(true_body(0.3, np.zeros(3))).sample(0.2), LoadState(0.01, np.zeros(3))
    given["acceleration"] = np.concatenate([GRAVITY, np.zeros(3)])
    given["twist"] = np.zeros(6)
    assert ESTIMATE.updated(state, BELIEVED, **given, dt=DT) is state


# in the loop

STILL = {**LIFT, "object": {"target": {"position": [0, 0, 0]}, "relative": True}}
HOLD = {**STILL, "name": "hold", "over": "1 s", "until": {"time": "1 s"}}
ON = {"friction": 0.7, "estimate": {"phase": "hold", "smoothing": "50 ms"}}


def run(
    assembly: Assembly, ticks: int, measured: str = "plan", factor: float = 1.0
) -> tuple[list[float], ControllerState]:
    """The masses planned for, where the fingers measure `factor` times the believed weight."""
    state, masses = assembly.start, []
    planner = assembly.controller.planner
    assert planner is not None
    force: np.ndarray | None = None
    for _ in range(ticks):
        given = None if measured == "none" else force
        seen: Any = Measurement(state.q, None, given)
        if measured == "raises":
            seen = Broken("force", q=state.q, v=None)
        record, state = assembly.controller.step(state, seen)
        assert record.forces is not None
        masses.append(record.forces.mass)
        plan = record.forces
        force = plan.force * (factor * 0.03 / plan.mass)
        if measured == "nan":
            force[0, 0] = np.nan
    return masses, state


def test_the_plan_is_for_the_load_that_is_measured() -> None:
    assembly = holding(phases=[STILL, HOLD], forces=ON)
    masses, state = run(assembly, 250, factor=1.3)
    assert set(masses[:50]) == {0.03}  # before its phase
    assert masses[-1] == pytest.approx(0.039, rel=1e-3)
    assert state.forces is not None and state.forces.load is not None
    assert np.linalg.norm(state.forces.load.shift) < 1e-4  # all forces grow: the centre stays


@pytest.mark.parametrize("measured", ["none", "nan", "raises"])
def test_without_forces_the_load_is_the_one_believed(measured: str) -> None:
    masses, state = run(holding(phases=[STILL, HOLD], forces=ON), 100, measured)
    assert set(masses) == {0.03}
    assert np.isfinite(state.q).all()


def test_it_stands_still_while_contacts_pass() -> None:
    """The second phase ends with fewer contacts than it has: its forces pass on to those."""
    two = {"r_thumb": "fixed", "r_middle": "fixed"}
    phases = [STILL, {**HOLD, "name": "pass"}, {**HOLD, "name": "two", "contacts": two}]
    soft = {"model": "soft_finger", "friction": 0.7, "torsion": "6 mm"}  # two of them can hold it
    given = {**soft, "estimate": {"phase": "lift"}}
    assembly = holding(phases=phases, forces=given)
    state, masses = assembly.start, list[list[float]]([[], [], []])
    for _ in range(700):
        force = np.tile([0.0, 0.0, 0.2], (3, 1))
        record, state = assembly.controller.step(state, Measurement(state.q, None, force))
        assert state.forces is not None and state.forces.load is not None
        masses[record.phase].append(state.forces.load.mass)
    assert len(set(masses[0])) == 50 and len(set(masses[2])) > 100
    assert set(masses[1]) == {masses[0][-1]}


def test_without_the_block_measured_forces_change_nothing() -> None:
    assembly = holding(phases=[STILL, HOLD])
    state = other = assembly.start
    for k in range(60):
        record, state = assembly.controller.step(state)
        force = np.full((3, 3), 0.1 * k)
        again, other = assembly.controller.step(other, Measurement(other.q, None, force))
        assert record.forces is not None and again.forces is not None
        np.testing.assert_array_equal(record.forces.force, again.forces.force)
        assert record.forces.mass == again.forces.mass
    assert state.forces is not None and state.forces.load is None


@pytest.mark.parametrize(
    ("estimate", "phase"), [({}, 1), ({"phase": "lift"}, 0), ({"phase": "hold"}, 1)]
)
def test_it_begins_where_fingers_alone_hold(estimate: dict[str, str], phase: int) -> None:
    assembly = holding(phases=[LIFT, HOLD], forces={"friction": 0.7, "estimate": estimate})
    planner = assembly.controller.planner
    assert planner is not None and planner.settings.estimate is not None
    assert planner.settings.estimate == replace(ESTIMATE, phase=phase)


@pytest.mark.parametrize(
    ("estimate", "said"),
    [
        ({"phase": "lfit"}, "did you mean 'lift'"),
        ({"mass": [2, 1]}, "the lower bound must be below"),
        ({"mass": [2, 3]}, "1 must lie between them"),
        ({"mass": [0, 1]}, "above 0"),
        ({"com": "-1 mm"}, "at least 0"),
        ({"smoothing": "0 s"}, "above 0"),
    ],
)
def test_what_is_wrong_in_the_block_is_said(estimate: dict[str, object], said: str) -> None:
    with pytest.raises(ScenarioError, match=said):
        holding(forces={"friction": 0.7, "estimate": estimate})


def test_a_scenario_that_moves_nothing_must_name_the_phase() -> None:
    still = {key: value for key, value in LIFT.items() if key != "object"}
    with pytest.raises(ScenarioError, match="no phase moves the object"):
        holding(phases=[still], forces={"friction": 0.7, "estimate": {}})
