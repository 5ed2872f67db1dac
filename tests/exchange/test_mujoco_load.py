"""An object of another mass than believed, with and without the estimate, in MuJoCo's physics."""

from __future__ import annotations

import numpy as np
import pytest

from wbc.rotations import log_so3
from wbc.scenario import load
from wbc.scenario.build import build
from wbc.scenario.build_dynamics import build_dynamics
from wbc.sim import dynamic

pytestmark = pytest.mark.slow
EULER = {"simulation.integrator": "euler"}


def carried(
    name: str, true: str, com: str = "[0 m, 0 m, 0 m]", **settings: str
) -> tuple[np.ndarray, np.ndarray]:
    """(T, 2) errors of the true object after what follows the lift, [m], [rad], and (T,) the
    mass planned for [kg]."""
    pytest.importorskip("mujoco")
    given = {**EULER, **{key.replace("__", "."): text for key, text in settings.items()}}
    assembly = build(load(name, given))
    dynamics = build_dynamics(build(load(name, {**given, "object.mass": true, "object.com": com})))
    assert dynamics is not None
    phases = assembly.controller.phases.phases
    lift = next(k for k, phase in enumerate(phases) if phase.object_motion is not None)
    errors, masses, done = [], [], False
    for record, state in dynamic.run(assembly.controller, assembly.start, assembly.ticks, dynamics):
        true_pose, plan = record.dynamics, record.forces
        assert true_pose is not None and plan is not None
        done = state.phase.done
        if record.phase > lift + 1:  # the estimate has begun after the lift
            way = true_pose.object_position - record.reference_position
            turn = log_so3(true_pose.object_rotation @ record.reference_rotation.T)
            errors.append((np.linalg.norm(way), np.linalg.norm(turn)))
            masses.append(plan.mass)
    assert done
    return np.array(errors), np.array(masses)


@pytest.mark.parametrize(
    ("name", "believed", "before", "after"),
    [("dual_arm_exchange_mujoco", 0.2, 0.8e-3, 0.5e-3),
     ("ball_exchange_mujoco", 0.1, 0.35e-3, 0.3e-3)],
)  # fmt: skip
def test_an_object_29_percent_too_heavy(
    name: str, believed: float, before: float, after: float
) -> None:
    true = 1.29 * believed
    without, planned = carried(name, f"{true} kg", forces__estimate="null")
    assert set(planned) == {believed}
    found, masses = carried(name, f"{true} kg", forces__estimate="{}")
    for said, errors in (("as believed", without), ("estimated", found)):
        most = errors.max(axis=0)
        print(f"{name}, {said}: {1e3 * most[0]:.2f} mm, {1e3 * most[1]:.1f} mrad from approach on")
    np.testing.assert_allclose(masses, true, rtol=0.01)
    assert without[:, 0].max() > before
    assert found[:, 0].max() < after
    assert found[:, 1].max() < 0.02


def test_a_centre_of_mass_60_mm_beside_the_believed_one() -> None:
    """Three times as far as the estimate may shift it: carried nevertheless."""
    com = "[0 m, 20 mm, 60 mm]"
    found, _ = carried("dual_arm_exchange_mujoco", "0.2 kg", com, forces__estimate="{}")
    assert found[:, 0].max() < 4e-3 and found[:, 1].max() < 0.05
