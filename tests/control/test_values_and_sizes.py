"""The controller as a value machine: states, records, sizes, and what cannot be a measurement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wbc.control.controller import Controller, Settings
from wbc.control.state import Measurement, Status
from wbc.errors import SetupError
from wbc.rotations import exp_so3
from wbc.scenario import load
from wbc.scenario.build import Assembly, build

WITHOUT_OBJECT = """
name: posture
robot: {urdf: planar_bimanual}
tasks:
  folded: {type: posture, gain: 5 /s, joints: [left_trunk_1], target: {left_trunk_1: 3 rad}}
  raised: {type: posture, gain: 5 /s, joints: [left_b_2], target: {left_b_2: 1 rad}}
stack: {priority: [folded, raised]}
phases: [{name: move, tasks: [folded, raised]}]
simulation: {duration: 3 s, step: 2 ms, integrator: euler}
"""


@pytest.fixture(scope="module")
def exchange() -> Assembly:
    return build(load("planar_exchange"))


@pytest.fixture(scope="module")
def postures(tmp_path_factory) -> Assembly:  # type: ignore[no-untyped-def]
    path = tmp_path_factory.mktemp("scenario") / "posture.yaml"
    path.write_text(WITHOUT_OBJECT)
    return build(load(path))


def test_a_controller_without_fingers_runs(postures: Assembly) -> None:
    record, state = postures.controller.step(postures.start)
    assert record.object_error.shape == (0, 2) and np.isfinite(record.v).all()
    assert state.tick == 1


def test_a_joint_at_its_limit_does_not_stop_the_others(postures: Assembly) -> None:
    """The first task asks for 3 rad, the limit is 120 deg: the second one still gets its way."""
    state = postures.start
    for _ in range(postures.ticks):
        record, state = postures.controller.step(state)
    model = postures.model
    stopped, moved = model.joint("left_trunk_1"), model.joint("left_b_2")
    assert record.q[stopped] == pytest.approx(model.upper[stopped], abs=1e-6)
    assert record.q[stopped] <= model.upper[stopped] + 1e-9
    assert record.q[moved] == pytest.approx(1.0, abs=1e-4)


def test_an_old_state_steps_as_it_did_before(exchange: Assembly) -> None:
    controller, state = exchange.controller, exchange.start
    kept, seen = {}, {}
    for k in range(450):
        if k % 37 == 0 or k in (200, 399, 400, 401):
            kept[k] = state
        record, state = controller.step(state)
        if k in kept:
            seen[k] = (record, state)
    for k in sorted(kept, reverse=True):
        record, after = controller.step(kept[k])
        np.testing.assert_array_equal(record.v, seen[k][0].v)
        np.testing.assert_array_equal(after.q, seen[k][1].q)
        np.testing.assert_array_equal(after.contact.xi, seen[k][1].contact.xi)
        assert record.status == seen[k][0].status


@pytest.mark.parametrize("part", ["mode", "xi", "pivot", "face", "shift"])
def test_a_state_of_another_number_of_fingers_is_refused(exchange: Assembly, part: str) -> None:
    state = exchange.start
    few = state.contact._replace(**{part: getattr(state.contact, part)[:3]})
    with pytest.raises(SetupError, match="must be of 4 fingers"):
        exchange.controller.step(state._replace(contact=few))


def test_a_run_can_begin_again_whatever_the_controller_did_before(exchange: Assembly) -> None:
    controller, state = exchange.controller, exchange.start
    motion = state.phase.motion._replace(rotation=exp_so3(np.array([0.0, 0.0, 0.3])))
    controller.step(state._replace(phase=state.phase._replace(motion=motion)))
    again = controller.init(exchange.start.q)
    np.testing.assert_array_equal(again.contact.pivot, exchange.start.contact.pivot)
    first, second = again.phase.motion, exchange.start.phase.motion
    for now, then in zip(first, second, strict=True):
        np.testing.assert_array_equal(now, then)
    np.testing.assert_array_equal(controller.step(again)[0].v, controller.step(exchange.start)[0].v)


def test_what_becomes_of_a_record_does_not_become_of_the_state(exchange: Assembly) -> None:
    record, state = exchange.controller.step(exchange.start)
    for value in record:
        if isinstance(value, np.ndarray):
            for held in (*state, *exchange.start, *state.contact, *state.activation, *state.stack):
                if isinstance(held, np.ndarray):
                    assert not np.shares_memory(value, held)
    phase = exchange.controller.phases.phases[0]
    assert not np.shares_memory(state.stack.wanted, phase.wanted)


@pytest.mark.parametrize(
    "q",
    [[None] * 14, ["a"] * 14, [[1], [1, 2]], np.zeros(3), np.full(14, np.nan), None, 1.0],
    ids=["none", "text", "ragged", "short", "nan", "nothing", "scalar"],
)
def test_no_measurement_makes_a_tick_raise(exchange: Assembly, q: object) -> None:
    record, _ = exchange.controller.step(exchange.start, Measurement(q))  # type: ignore[arg-type]
    assert record.status & Status.BAD_MEASUREMENT and np.isfinite(record.v).all()


def test_a_bare_array_is_no_measurement(exchange: Assembly) -> None:
    record, _ = exchange.controller.step(exchange.start, np.zeros(14))  # type: ignore[arg-type]
    assert record.status & Status.BAD_MEASUREMENT


@pytest.mark.parametrize("v0", [np.full(14, np.nan), 1.0, np.zeros(3), "fast"])
def test_a_start_that_is_no_velocity_is_refused(exchange: Assembly, v0: object) -> None:
    with pytest.raises(SetupError, match="v0"):
        exchange.controller.init(exchange.start.q, v0=v0)  # type: ignore[arg-type]


@pytest.mark.parametrize("q0", [np.full(14, np.inf), np.zeros(3)])
def test_a_start_that_is_no_position_is_refused(exchange: Assembly, q0: np.ndarray) -> None:
    with pytest.raises(SetupError, match="q0"):
        exchange.controller.init(q0)


def rebuilt(exchange: Assembly, *, settings: Settings | None = None, **parts: object) -> Controller:
    c = exchange.controller
    given = {"phases": c.phases, "priority": (0, 1, 2, 3), **parts}
    return Controller(
        c.law,
        c._forecast._costs,
        c.supervisor,
        given["phases"],  # type: ignore[arg-type]
        given["priority"],  # type: ignore[arg-type]
        settings or c.settings,
    )


@pytest.mark.parametrize(
    "field, value",
    [
        ("acceleration", np.array([60.0])),
        ("velocity", np.zeros(3)),
        ("upper", np.full(14, np.nan)),
        ("lower", np.full(14, 9.0)),
        ("velocity", np.full(14, -1.0)),
        ("dt", 0.0),
        ("dt", np.nan),
    ],
)
def test_limits_of_the_wrong_size_are_refused(
    exchange: Assembly, field: str, value: object
) -> None:
    with pytest.raises(SetupError):
        rebuilt(exchange, settings=replace(exchange.controller.settings, **{field: value}))  # type: ignore[arg-type]


@pytest.mark.parametrize("priority", [(1,), (0, 1, 2), (0, 1, 2, 2), (0, 1, 2, 4)])
def test_a_priority_that_is_no_order_is_refused(exchange: Assembly, priority: tuple) -> None:  # type: ignore[type-arg]
    with pytest.raises(SetupError, match="priority"):
        rebuilt(exchange, priority=priority)


@pytest.mark.parametrize("field", ["mode", "reach", "pad", "wanted"])
def test_phases_of_the_wrong_size_are_refused(exchange: Assembly, field: str) -> None:
    phases = exchange.controller.phases
    long = replace(phases.phases[0], **{field: np.zeros(20)})
    with pytest.raises(SetupError, match=field):
        rebuilt(exchange, phases=replace(phases, phases=(long,)))
