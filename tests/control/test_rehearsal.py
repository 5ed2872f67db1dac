"""A rehearsal tells what the run will do, and does nothing to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wbc.contact.surfaces import SURFACES
from wbc.control.phases import ExitCondition, PhaseSequence
from wbc.control.plan import through
from wbc.control.rehearsal import LONGEST, rehearse
from wbc.control.state import TickRecord
from wbc.errors import SetupError
from wbc.scenario import load
from wbc.scenario.build import Assembly, build


@pytest.fixture(scope="module")
def planar() -> Assembly:
    return build(load("planar_exchange"))


def with_phase(assembly: Assembly, index: int, **changes: object):
    """The controller with one phase changed."""
    phases = list(assembly.controller.phases.phases)
    phases[index] = replace(phases[index], **changes)
    return assembly.controller.like(PhaseSequence(tuple(phases)), assembly.controller.settings)


def ticks(assembly: Assembly, count: int) -> list[TickRecord]:
    state, records = assembly.start, []
    for _ in range(count):
        record, state = assembly.controller.step(state)
        records.append(record)
    return records


def test_a_run_after_a_rehearsal_is_the_same_bit_for_bit():
    with_one, without = build(load("planar_exchange")), build(load("planar_exchange"))
    rehearse(with_one.controller, with_one.start)
    again = with_one.controller.init(with_one.start.q)
    np.testing.assert_array_equal(again.phase.motion.position, without.start.phase.motion.position)
    for a, b in zip(ticks(with_one, 600), ticks(without, 600), strict=True):
        # the distance library starts from where it last ended, which shows in the last digit
        assert a.min_distance == pytest.approx(b.min_distance, rel=1e-12)
        for x, y in zip(a._replace(min_distance=0.0), b._replace(min_distance=0.0), strict=True):
            if isinstance(x, np.ndarray):
                np.testing.assert_array_equal(x, y)
            else:
                assert repr(x) == repr(y)


def test_it_is_deterministic(planar):
    first, second = (rehearse(planar.controller, planar.start) for _ in range(2))
    assert first.faults == second.faults == ()
    for a, b in zip(first.stages, second.stages, strict=True):
        np.testing.assert_array_equal(a.q, b.q)
        assert (a.name, a.time, a.nearest, a.distance) == (b.name, b.time, b.nearest, b.distance)


@pytest.mark.parametrize("name", ["planar_exchange", "dual_arm_exchange"])
def test_its_stages_are_what_the_run_comes_to(name):
    """Up to a phase that ends when forces balance: a coarser end comes earlier there."""
    assembly = build(load(name))
    rehearsal = rehearse(assembly.controller, assembly.start)
    phases = assembly.controller.phases.phases
    assert [stage.name for stage in rehearsal.stages] == [phase.name for phase in phases]
    state, ends, tips = assembly.start, {}, {}
    kin = assembly.controller.law.kin
    compared = min(4, next(k for k, phase in enumerate(phases) if phase.until.residuals))
    while len(ends) < compared:
        record, after = assembly.controller.step(state)
        assert not after.phase.stopped
        if record.phase != state.phase.current:
            name_ = phases[state.phase.current].name
            ends[name_], tips[name_] = state.q, kin.robot.position.copy()
        state = after
    for stage in rehearsal.stages[:compared]:
        assert np.abs(stage.q - ends[stage.name]).max() < 4e-3, stage.name
        kin.robot.update(stage.q)
        far = np.linalg.norm(kin.robot.position - tips[stage.name], axis=1).max()
        assert far < 5e-4, stage.name


def test_a_phase_that_never_ends_is_named(planar):
    controller = with_phase(planar, 0, until=ExitCondition(distance=9.0), timeout=np.inf)
    rehearsal = rehearse(controller, planar.start)
    (fault,) = rehearsal.faults
    assert fault.phase == 0 and "a tip stays nearer than 9000.0 mm" in fault.text
    assert len(rehearsal.stages) == 1


def test_a_phase_that_lasts_too_long_for_a_rehearsal_is_no_fault(planar):
    controller = with_phase(planar, 0, until=ExitCondition(time=1e6), timeout=np.inf)
    rehearsal = rehearse(controller, planar.start, tick=0.1)
    assert rehearsal.faults == () and rehearsal.stages == ()
    assert LONGEST > 60.0


def test_a_start_in_collision_and_one_that_is_no_number(planar):
    model = planar.model
    folded = {"right_trunk_1": 0, "right_trunk_2": -100, "right_trunk_3": 100, "right_a_1": -60}
    q = planar.start.q.copy()
    for joint, angle in folded.items():
        q[model.joint(joint)] = np.deg2rad(angle)
    rehearsal = rehearse(planar.controller, planar.start._replace(q=q))
    assert rehearsal.stages == () and rehearsal.faults
    assert all(f.phase is None and "mm deep" in f.text for f in rehearsal.faults)
    q[0] = np.nan
    (fault,) = rehearse(planar.controller, planar.start._replace(q=q)).faults
    assert "no numbers" in fault.text


@pytest.mark.parametrize("tick", [0.0, -1.0, np.nan, np.inf])
def test_a_silly_tick_is_refused(planar, tick):
    with pytest.raises(SetupError):
        rehearse(planar.controller, planar.start, tick)


@pytest.mark.parametrize(
    "changes",
    [
        {"over": 0.0},
        {"over": np.nan},
        {"timeout": 0.0},
        {"timeout": -1.0},
        {"until": ExitCondition(time=np.inf)},
        {"until": ExitCondition(tip_error=0.0)},
        {"until": ExitCondition(object_error=np.nan)},
        {"until": ExitCondition(force_closure=-1.0)},
    ],
)
def test_silly_phases_raise_nothing(planar, changes):
    rehearsal = rehearse(with_phase(planar, 0, **changes), planar.start)
    assert all(np.isfinite(stage.q).all() for stage in rehearsal.stages)
    assert all("nan" not in fault.text for fault in rehearsal.faults)


def test_a_way_through_a_sphere():
    ball = SURFACES["sphere"](0.03)
    across = through(ball, np.array([0.0, 0.0, -0.1]), np.array([0.0, 0.0, 0.05]))
    assert across is not None
    assert across.depth == pytest.approx(0.03, abs=1e-3)
    assert across.left == pytest.approx(0.08, abs=1.1e-3)
    beside, along = np.array([0.031, 0.0, 0.0]), np.array([0.0, 0.0, 0.1])
    assert through(ball, beside - along, beside + along) is None
    assert through(ball, beside, np.full(3, np.nan)) is None
    assert through(ball, beside, beside) is None


def test_a_finger_that_closes_before_it_is_there_is_named():
    far = build(load("planar_exchange", {"contacts.f3.at": "[25 deg]"}))  # the start is at 15 deg
    hurried = with_phase(far, 0, over=0.01, until=ExitCondition(time=0.01), timeout=1.0)
    faults = rehearse(hurried, hurried.init(far.start.q)).faults
    assert [f.finger for f in faults] == ["f3", "f4"], faults
    assert "begins to touch" in faults[0].text and "mm beside" in faults[0].text
