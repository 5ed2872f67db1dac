"""A hand led by the weights of its synergies: the laws of the task and of phases that lead it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from wbc.control.references import led, minimum_jerk
from wbc.control.rehearsal import rehearse
from wbc.control.state import ControllerState, Status, TickRecord
from wbc.errors import SetupError
from wbc.scenario import load
from wbc.scenario.build import Assembly, build
from wbc.stack.activation import Activation
from wbc.synergies import Synergies, weights_of
from wbc.tasks import Synergy
from wbc.tasks.synergy import complement

HAND = Synergies.from_table()
OPEN, PEN = HAND.project(np.zeros(15)), weights_of("C27")
Overrides = tuple[tuple[str, Any], ...]


@cache
def built(*overrides: tuple[str, Any]) -> Assembly:
    return build(load("synergy_reach", dict(overrides)))


def task_of(assembly: Assembly) -> Synergy:
    task = assembly.controller.law.stack.tasks[assembly.controller.task_names.index("shape")]
    assert isinstance(task, Synergy)
    return task


def in_force(assembly: Assembly) -> ControllerState:
    """The start with every gain at 1 instead of fading in."""
    full = np.ones(len(assembly.controller.task_names))
    return assembly.start._replace(activation=Activation(full, full))


def run(
    assembly: Assembly, seconds: float, state: ControllerState | None = None
) -> tuple[list[TickRecord], list[ControllerState]]:
    """Records of the ticks, and the states before each and after the last."""
    records, states = [], [state or assembly.start]
    for _ in range(round(seconds / assembly.controller.settings.dt)):
        record, after = assembly.controller.step(states[-1])
        records.append(record)
        states.append(after)
    return records, states


def joints(assembly: Assembly, records: list[TickRecord]) -> np.ndarray:
    """(T, 15) the hand's joints in the order of its synergies."""
    return np.array([record.q for record in records])[:, task_of(assembly).joints]


def reference(assembly: Assembly, state: ControllerState) -> np.ndarray:
    """(3,) or (6,) where the task is led at the time of a state that has seen its tick."""
    t = (state.tick - 1) * assembly.controller.settings.dt
    target = led(t, state.phase.motion, state.targets)[0]
    assert target is not None
    return target


def residual(postures: np.ndarray) -> np.ndarray:
    """Largest part of postures (T, 15) outside the synergies, [rad]."""
    outside = (postures - HAND.mean) @ complement(HAND.basis)
    return np.asarray(np.abs(outside).max(axis=1))


# --- the published reach -------------------------------------------------------------------------


@pytest.mark.parametrize("integrator", ["rk4", "euler"])
@pytest.mark.parametrize("path", ["linear", "smooth"])
def test_alone_the_hand_stays_within_the_synergies(integrator: str, path: str) -> None:
    assembly = built(
        ("tasks.shape.measure", "weights"), ("tasks.shape.path", path),
        ("simulation.integrator", integrator),
    )  # fmt: skip
    records, states = run(assembly, 7.0)
    hand, model = joints(assembly, records), assembly.model
    assert states[-1].phase.done
    assert residual(hand).max() < 1e-12
    q = np.array([record.q for record in records])
    assert (q >= model.lower).all() and (q <= model.upper).all()
    assert np.abs(np.diff([record.v for record in records], axis=0)).max() <= 60.0 * 2e-3 + 1e-9
    assert_allclose(HAND.project(hand[-1]), PEN, atol=1e-5)
    if path == "smooth":
        assert not any(record.status & ~Status.DONE for record in records)


def test_the_commanded_posture_is_the_clipped_one() -> None:
    """Within the subspace until a joint comes to the end of its range, which it then keeps."""
    assembly = built()
    records, states = run(assembly, 7.0)
    hand = joints(assembly, records)
    assert states[-1].phase.done
    assert_allclose(hand[-1], HAND.command(PEN), atol=1e-6)
    led_to = np.array([reference(assembly, state)[:3] for state in states[1:]])
    clipped = (HAND.excess(HAND.posture(led_to)) != 0.0).any(axis=1)
    assert clipped.any()
    assert residual(hand[: np.argmax(clipped)]).max() < 1e-12
    # what the acceleration limit takes to stop: v²/2a at 0.57 rad/s
    assert np.abs(HAND.excess(hand)).max() < 3e-3


def test_the_reference_is_the_published_interpolation() -> None:
    """(56) at 0, 3 and 6 s, linear between: at every tick, with its rate."""
    assembly = built()
    _, states = run(assembly, 6.5)
    for state in states[1:]:
        t = 2e-3 * (state.tick - 1)
        want = [np.interp(t, [0, 3, 6], x) for x in zip(np.zeros(3), OPEN, PEN, strict=True)]
        target = reference(assembly, state)
        assert_allclose(target[:3], want, atol=1e-14)
        if len(target) == 6 and t < 6.0:
            assert_allclose(target[3:], (OPEN if t < 3.0 else PEN - OPEN) / 3.0, atol=1e-14)
    assert_array_equal(states[-1].targets[0], PEN)


def test_a_smooth_reference_is_minimum_jerk() -> None:
    assembly = built(("tasks.shape.path", "smooth"), ("tasks.shape.measure", "weights"))
    records, states = run(assembly, 3.0)
    for state in states[1:]:
        s, ds = minimum_jerk(2e-3 * (state.tick - 1) / 3.0)
        assert_allclose(reference(assembly, state), [*(s * OPEN), *(ds / 3.0 * OPEN)], atol=1e-14)
    assert np.abs(np.diff([record.v for record in records], axis=0)).max() < 6e-3


@pytest.mark.parametrize("measure", ["weights", "posture"])
def test_the_motion_does_not_depend_on_the_tick(measure: str) -> None:
    ends, middles = [], []
    for step in ("1 ms", "2 ms", "4 ms"):
        assembly = built(
            ("tasks.shape.measure", measure), ("tasks.shape.path", "smooth"),
            ("simulation.step", step),
        )  # fmt: skip
        records, _ = run(assembly, 5.2)
        at = np.array([record.t for record in records])
        middles.append(joints(assembly, records)[int(np.argmin(np.abs(at - 1.2)))])
        ends.append(joints(assembly, records)[int(np.argmin(np.abs(at - 5.0)))])
    assert np.ptp(middles, axis=0).max() < 1e-6  # no joint has met its range before
    assert np.ptp(ends, axis=0).max() < (1e-6 if measure == "weights" else 1e-3)


def test_the_rehearsal_goes_the_same_way() -> None:
    assembly = built()
    found = rehearse(assembly.controller, assembly.start)
    assert not found.faults and not found.warnings
    assert [stage.name for stage in found.stages] == ["open", "close"]
    order = task_of(assembly).joints
    assert_allclose(found.stages[0].q[order], HAND.command(OPEN), atol=2e-2)
    assert_allclose(found.stages[1].q[order], HAND.command(PEN), atol=2e-3)


# --- phases that lead ----------------------------------------------------------------------------


def test_a_phase_cut_short_hands_on_where_the_reference_is() -> None:
    assembly = built(
        ("phases.open.until", "{residual: {shape: 1e-30}}"),
        ("phases.open.timeout", "{after: 1.5 s, then: next}"),
    )
    _, states = run(assembly, 4.6)
    assert states[-1].phase.timeouts == ("open",)
    for state in states[1:]:
        t = 2e-3 * (state.tick - 1)
        want = [np.interp(t, [0, 1.5, 4.5], x) for x in zip(0 * PEN, OPEN / 2, PEN, strict=True)]
        assert_allclose(reference(assembly, state)[:3], want, atol=1e-14)


def test_a_phase_that_leads_nothing_leaves_the_reference_where_it_is() -> None:
    assembly = built(
        ("phases.open.until", "{residual: {shape: 1e-30}}"),
        ("phases.open.timeout", "{after: 1.5 s, then: next}"),
        ("phases.close.weights", "{}"),
    )
    _, states = run(assembly, 3.0)
    assert states[-1].phase.motion.aims == ()
    assert_allclose(states[-1].targets[0], OPEN / 2, atol=1e-15)


def test_a_new_target_in_mid_motion_is_where_it_ends() -> None:
    assembly = built(("tasks.shape.path", "smooth"))
    controller, goal = assembly.controller, weights_of("G1")
    _, states = run(assembly, 1.0)
    before = reference(assembly, states[-1])
    state = controller.retarget(states[-1], "shape", goal)
    assert_allclose(reference(assembly, state)[:3] - before[:3], goal - OPEN, atol=1e-14)
    assert_array_equal(reference(assembly, state)[3:], before[3:])
    _, later = run(assembly, 2.002, state)
    assert later[-1].phase.current == 1  # from there to the next goal
    assert_array_equal(later[-1].phase.motion.aims[0].way, PEN - goal)


def test_a_rate_set_from_outside_ends_with_the_next_phase() -> None:
    """A goal of a phase stands still: what the target's rate was before is not kept."""
    assembly = built()
    controller, state = assembly.controller, assembly.start
    state = state._replace(targets=(np.ones(6), *state.targets[1:]))
    for begun in (None, state.phase.motion):
        phase, targets = controller.phases.lead(state.phase, state.targets, begun)
        assert_array_equal(targets[0], [*OPEN, 0.0, 0.0, 0.0])
        assert len(phase.motion.aims) == 1


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"basis": HAND.basis[:, 0]}, "must have 15 rows"),
        ({"basis": np.zeros((15, 0))}, "are none or not independent"),
        ({"basis": np.full((15, 3), np.nan)}, "must be finite"),
        ({"mean": np.full(15, np.nan)}, "must be finite"),
        ({"measure": "weight"}, "unknown measure 'weight'"),
        ({"joints": np.arange(15.0)}, "must be a row of places"),
        ({"joints": np.arange(15)[:, None]}, "must be a row of places"),
        ({"joints": np.zeros(15, np.int64)}, "named twice"),
        ({"lower": np.full(15, 9.0)}, "above its upper one"),
        ({"goal": np.zeros(2)}, "its target must be 3 or 6"),
    ],
)
def test_a_definition_that_does_not_fit_is_refused(change: dict[str, Any], says: str) -> None:
    assembly = built()
    with pytest.raises(SetupError, match=says):
        replace(task_of(assembly), **change).check(assembly.controller.law.kin)


@pytest.mark.parametrize("integrator", ["rk4", "euler"])
def test_a_state_is_a_value(integrator: str) -> None:
    assembly = built(("simulation.integrator", integrator))
    _, states = run(assembly, 3.1)
    for k in (1540, 1501, 1500, 1499, 700, 1, 0):
        for _ in range(2):
            record, after = assembly.controller.step(states[k])
            assert_array_equal(after.q, states[k + 1].q)
            assert_array_equal(after.targets[0], states[k + 1].targets[0])
        assert_array_equal(record.q, states[k].q)


def test_targets_that_nothing_leads_are_handed_on_untouched() -> None:
    assembly = build(load("reach"))
    state = assembly.start
    assert led(0.3, state.phase.motion, state.targets) is state.targets
    assembly = built()
    _, states = run(assembly, 6.2)
    assert led(6.2, states[-1].phase.motion, states[-1].targets) is states[-1].targets


# --- among other tasks ---------------------------------------------------------------------------

PULL = {
    "type": "posture", "gain": "3 /s",
    "target": {"index_abd": "-10 deg", "ring_prox": "70 deg", "little_med": "20 deg"},
}  # fmt: skip


def stacked(priority: tuple[str, ...], pull: dict[str, Any] = PULL, **shape: Any) -> Assembly:
    """The reach with a second task, in this order."""
    wanted = {f"tasks.shape.{key}": value for key, value in shape.items()}
    phases = {f"phases.{phase}.tasks": list(priority) for phase in ("open", "close")}
    return build(
        load("synergy_reach", {**wanted, **phases, "tasks.pull": pull,
                               "stack.priority": list(priority), "limits.acceleration": 1e5})
    )  # fmt: skip


def test_a_lower_task_changes_nothing_of_the_weights() -> None:
    alone = built(("tasks.shape.measure", "weights"), ("tasks.shape.path", "smooth"))
    both = stacked(("shape", "pull"), measure="weights", path="smooth")
    one, two = run(alone, 4.0, in_force(alone))[0], run(both, 4.0, in_force(both))[0]
    a, b = joints(alone, one), joints(both, two)
    assert residual(b).max() > 0.1  # it does pull the hand out of the subspace
    assert_allclose(HAND.project(b), HAND.project(a), atol=1e-9)


@pytest.mark.parametrize("measure", ["weights", "posture", "outside"])
def test_below_another_task_it_takes_what_is_left(measure: str) -> None:
    """The main task goes its way alone; the synergies come as near as its freedom allows."""
    shape = {"measure": measure, "path": "smooth"}
    assembly = stacked(("pull", "shape"), **{**shape, "measure": "weights"})
    if measure == "outside":
        assembly = build(
            load("synergy_reach", {
                "tasks.pull": PULL, "tasks.shape.measure": "outside",
                "stack.priority": ["pull", "shape"],
                "phases": [{"name": "run", "tasks": ["pull", "shape"]}],
            })
        )  # fmt: skip
    elif measure == "posture":
        assembly = stacked(("pull", "shape"), **shape)
    records, _ = run(assembly, 6.5)
    hand = joints(assembly, records)
    pulled = [HAND.joints.index(name) for name in PULL["target"]]
    assert_allclose(np.rad2deg(hand[-1, pulled]), [-10.0, 70.0, 20.0], atol=1e-4)
    task = task_of(assembly)
    if measure == "weights":
        assert_allclose(HAND.project(hand[-1]), PEN, atol=1e-5)
    elif measure == "posture":
        want = np.clip(HAND.command(PEN), task.lower, task.upper)
        assert_allclose(np.delete(hand[-1] - want, pulled), 0.0, atol=1e-6)
    else:  # least squares of what is outside over the joints that are left and at no limit
        outside, model = task.matrix @ (hand[-1] - HAND.mean), assembly.model
        room = np.minimum(hand[-1] - model.lower[task.joints], model.upper[task.joints] - hand[-1])
        inside = room > 1e-9
        assert inside.sum() >= 14
        inside[pulled] = False
        slope = (outside @ task.matrix)[inside]
        assert np.abs(outside).max() > 0.1 and np.abs(slope).max() < 1e-6


@pytest.mark.parametrize("measure", ["weights", "posture"])
def test_weights_beyond_the_ranges_end_at_the_limits(measure: str) -> None:
    assembly = built(("tasks.shape.measure", measure), ("tasks.shape.path", "smooth"))
    controller, model = assembly.controller, assembly.model
    _, states = run(assembly, 0.1)
    state = controller.retarget(states[-1], "shape", np.deg2rad([250.0, -200.0, 150.0]))
    records, _ = run(assembly, 2.5, state)
    q = np.array([record.q for record in records])
    v = np.array([record.v for record in records])
    assert (q >= model.lower - 1e-12).all() and (q <= model.upper + 1e-12).all()
    assert (np.abs(v) <= model.velocity + 1e-12).all()
    assert any(record.status & (Status.SCALED | Status.CLIPPED) for record in records)
    if measure == "weights":
        at_end = (q[-1] - model.lower < 1e-3) | (model.upper - q[-1] < 1e-3)
        assert at_end.any() and records[-1].task_error[0] > 0.1  # and it says how far short it is


# --- the basis of what is outside ----------------------------------------------------------------


@pytest.mark.parametrize("count", [1, 2, 3, 14])
def test_the_complement_is_orthonormal_and_the_same_for_every_basis_of_a_subspace(
    count: int,
) -> None:
    rng = np.random.default_rng(count)
    basis = HAND.basis if count == 3 else rng.normal(size=(15, count))
    outside = complement(basis)
    assert_allclose(outside.T @ outside, np.eye(15 - count), atol=1e-14)
    assert_allclose(outside.T @ basis, 0.0, atol=1e-14)
    other = complement(basis @ rng.normal(size=(count, count)))
    assert_allclose(outside, other, atol=1e-10)
    unit = complement(np.eye(15)[:, :count])
    assert_array_equal(unit, np.eye(15)[:, count:])
