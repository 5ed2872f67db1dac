"""Both stages as a value machine for a loop of one's own: ticks, states, and where a run begins."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from wbc.control.state import Measurement
from wbc.control.torque_controller import LoopState, LoopTick, TorqueController
from wbc.errors import SetupError
from wbc.scenario import load
from wbc.scenario.build import Assembly, build
from wbc.scenario.build_dynamics import build_torque_control


@pytest.fixture(scope="module")
def planar() -> Assembly:
    return build(load("planar_exchange_dynamic"))


@pytest.fixture(scope="module")
def control(planar: Assembly) -> TorqueController:
    return build_torque_control(planar)


def measured(state: LoopState) -> Measurement:
    """Joints as commanded, fingers a little weaker than planned."""
    q, plan = state.first.q, state.watch.plan
    return Measurement(q.copy(), np.zeros_like(q), 0.9 * plan)


def overwrite(part: Any) -> None:
    """Every array in it, and in what it holds, made 7."""
    if isinstance(part, np.ndarray) and part.flags.writeable:
        part[...] = 7
    elif isinstance(part, tuple):
        for inner in part:
            overwrite(inner)


def test_what_becomes_of_a_tick_does_not_become_of_the_state(
    planar: Assembly, control: TorqueController
) -> None:
    kept = spoiled = control.init(planar.start)
    for _ in range(30):
        given = measured(kept)
        tick, kept = control.step(kept, given)
        again, spoiled = control.step(spoiled, given)
        np.testing.assert_array_equal(again.command.tau, tick.command.tau)
        overwrite(again)
        np.testing.assert_array_equal(spoiled.first.q, kept.first.q)


def test_an_old_state_steps_as_it_did_before(planar: Assembly, control: TorqueController) -> None:
    state = control.init(planar.start)
    seen: list[tuple[LoopState, Measurement, LoopTick]] = []
    for _ in range(20):
        given = measured(state)
        before, (tick, state) = state, control.step(state, given)
        seen.append((before, given, tick))
    for before, given, tick in reversed(seen):
        again, _ = control.step(before, given)
        np.testing.assert_array_equal(again.command.tau, tick.command.tau)


def test_a_robot_that_is_not_where_the_run_starts_is_refused(
    planar: Assembly, control: TorqueController
) -> None:
    q = planar.start.q.copy()
    control.init(planar.start, q + 0.04)
    q[8] += 0.06
    name = planar.model.joint_names[8]
    with pytest.raises(SetupError, match=f"joint '{name}' is 0.06 from where the run starts"):
        control.init(planar.start, q)
    for wrong in (q[:3], np.full_like(q, np.nan)):
        with pytest.raises(SetupError, match="measured must"):
            control.init(planar.start, wrong)
