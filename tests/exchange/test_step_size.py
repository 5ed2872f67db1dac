"""Results do not depend on the tick beyond the integrator's truncation error."""

from __future__ import annotations

import numpy as np
import pytest

from .runs import Run, simulate

STEPS = (1, 2, 4)  # [ms]
# Up to here nothing in the law has a kink: no event, no phase, no cost that sets in, no row that
# fades. The first joint passes its soft bound at 0.128 s.
SMOOTH = 0.124
# A supervisor that never acts: its decisions fall on ticks, so that they come at other times with
# another tick, and what follows differs by more than any integrator's error.
NO_EVENTS = {"supervisor.remove_above": 1000.0}


def run(step: int, integrator: str, until: float | None, **overrides: object) -> Run:
    """A run with a tick of `step` ms."""
    settings = {"simulation.step": f"{step} ms", "simulation.integrator": integrator, **overrides}
    ticks = None if until is None else round(until * 1e3) // step
    return simulate(overrides=settings, ticks=ticks)


def gap(a: Run, b: Run) -> float:
    """Largest difference of joints and contact variables at the end, [rad]."""
    sliding = np.abs(a.state.contact.xi - b.state.contact.xi).max()
    return float(max(np.abs(a.state.q - b.state.q).max(), sliding))


@pytest.mark.parametrize(("integrator", "order"), [("rk4", 4.0), ("euler", 1.0)])
def test_order_on_the_smooth_part(integrator: str, order: float) -> None:
    runs = {step: run(step, integrator, SMOOTH) for step in STEPS}
    fine, coarse = gap(runs[1], runs[2]), gap(runs[2], runs[4])
    slope = np.log2(coarse / fine)
    print(f"{integrator}: order {slope:.3f}; 2 ms differ from 1 ms by {fine:.2g} rad")
    assert abs(slope - order) < 0.1


@pytest.fixture(scope="module")
def eventless() -> dict[int, Run]:
    """Whole exchanges in which the supervisor never acts."""
    return {step: run(step, "rk4", None, **NO_EVENTS) for step in STEPS}


def test_whole_exchanges_without_events_agree(eventless: dict[int, Run]) -> None:
    """Costs that set in and rows that fade are kinks: the error there is of second order."""
    for step in (2, 4):
        a, b = eventless[1], eventless[step]
        apart = np.abs(a.q[::step] - b.q).max()
        print(f"{step} ms against 1 ms: {apart:.2g} rad anywhere")
        assert apart < (step * 1e-3) ** 2
        assert a.phase_start("leave") == pytest.approx(b.phase_start("leave"), abs=1e-9)


def test_order_of_the_object_error(eventless: dict[int, Run]) -> None:
    """The error left by integration falls with the fourth power of the tick."""
    errors = [eventless[step].object_error[eventless[step].t > 0.3].max() for step in STEPS]
    slopes = np.diff(np.log2(errors))
    print(f"object error {[f'{e:.2g}' for e in errors]} m: orders {np.round(slopes, 2)}")
    assert (slopes > 3.7).all() and (slopes < 4.3).all()


def test_final_states_agree(reference: Run) -> None:
    """With the supervisor at work too: same phases, contacts, object; the free motion near.

    Where the supervisor's events fall on other ticks, the redundant joints end elsewhere, but no
    task and no constraint does.
    """
    for step in (1, 4):
        other = run(step, "rk4", None)
        assert other.state.phase.done and not other.state.phase.timeouts
        assert len(other.events) == len(reference.events)
        near = np.abs(other.state.q - reference.state.q).max()
        np.testing.assert_allclose(other.state.contact.xi, reference.state.contact.xi, atol=1e-8)
        last, first = other.records[-1], reference.records[-1]
        np.testing.assert_allclose(last.object_position, first.object_position, atol=1e-8)
        np.testing.assert_allclose(last.object_rotation, first.object_rotation, atol=1e-8)
        np.testing.assert_allclose(last.residuals, first.residuals, atol=1e-12)
        for phase in ("slide", "hand_over", "leave"):
            assert abs(other.phase_start(phase) - reference.phase_start(phase)) <= 0.008
        print(f"{step} ms against 2 ms: joints {near:.2g} rad apart at the end")
        assert near < 1e-3
