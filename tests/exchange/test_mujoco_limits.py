"""What the chapter's hand, ± 0.5 Nm at the thumb and ± 0.075 Nm elsewhere, holds in MuJoCo."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.largest_mass import BALL, BAR, HAND, PADS, Case, computed, held
from wbc.forces import ForceStatus
from wbc.rotations import log_so3
from wbc.scenario import load
from wbc.scenario.build import build
from wbc.scenario.build_dynamics import build_dynamics
from wbc.sim import dynamic

pytestmark = pytest.mark.slow
TENTH = {  # of a kilogram, the bar; the forces planned with three quarters of the pads' friction
    "object.mass": 0.1,
    "object.inertia": [9.8e-4, 9.8e-4, 3.4e-5],
    "forces.torque_limits": HAND,
    "forces.friction": 0.6,
    "forces.w_bF": 0.1,
}


@pytest.mark.parametrize("case", [BAR, BALL])
def test_physics_holds_what_was_computed_and_no_more(case: Case) -> None:
    """The last few percent would leave the second stage no torque to put anything right."""
    pytest.importorskip("mujoco")
    most = computed(case, PADS)
    assert held(case, 0.92 * most, PADS).holds
    beyond = held(case, 1.1 * most, PADS)
    assert not beyond.holds and beyond.torque > 0.999


def test_a_tenth_of_a_kilogram_goes_from_hand_to_hand_within_the_chapters_limits() -> None:
    pytest.importorskip("mujoco")
    assembly = build(load("dual_arm_exchange_mujoco", {**TENTH, "simulation.integrator": "euler"}))
    dynamics = build_dynamics(assembly)
    assert dynamics is not None
    phases = assembly.controller.phases.phases
    lift = next(k for k, phase in enumerate(phases) if phase.object_motion is not None)
    fingers = dynamics.second.fingers
    limit = dynamics.second.gains.tau_max[fingers]
    assert set(limit) == {0.5, 0.075}
    done, errors, slip, status = False, [], 0.0, set()
    for record, state in dynamic.run(assembly.controller, assembly.start, assembly.ticks, dynamics):
        true, plan, done = record.dynamics, record.forces, state.phase.done
        assert true is not None and plan is not None
        assert (np.abs(true.tau[fingers]) <= limit).all()
        if record.phase > lift:
            status.add(tuple(ForceStatus)[plan.status])
            way = np.linalg.norm(true.object_position - record.reference_position)
            turn = np.linalg.norm(log_so3(true.object_rotation @ record.reference_rotation.T))
            errors.append((way, turn))
            slip = float(true.slip.max())
    assert done and status == {ForceStatus.SOLVED}
    most = np.max(errors, axis=0)
    print(f"{1e3 * most[0]:.2f} mm, {1e3 * most[1]:.1f} mrad, slip {1e3 * slip:.2f} mm")
    assert most[0] < 5e-4 and most[1] < 6e-3 and slip < 6e-4


def test_the_hand_holds_what_was_computed_for_the_friction_planned_with() -> None:
    assert computed(BAR, 0.4) == pytest.approx(0.446, abs=2e-3)
    assert computed(BAR, 0.6) == pytest.approx(0.466, abs=2e-3)
