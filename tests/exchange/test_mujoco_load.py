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


def carried(name: str, true: str, **settings: str) -> tuple[np.ndarray, np.ndarray]:
    """(T, 2) errors of the true object from the phase after `lift` on, [m], [rad], and (T,) the
    mass planned for [kg]."""
    pytest.importorskip("mujoco")
    given = {**EULER, **{key.replace("__", "."): text for key, text in settings.items()}}
    assembly = build(load(name, given))
    dynamics = build_dynamics(build(load(name, {**given, "object.mass": true})))
    assert dynamics is not None and dynamics.release is not None
    errors, masses, done = [], [], False
    for record, state in dynamic.run(assembly.controller, assembly.start, assembly.ticks, dynamics):
        true_pose, plan = record.dynamics, record.forces
        assert true_pose is not None and plan is not None
        done = state.phase.done
        if record.phase > dynamics.release:
            way = true_pose.object_position - record.reference_position
            turn = log_so3(true_pose.object_rotation @ record.reference_rotation.T)
            errors.append((np.linalg.norm(way), np.linalg.norm(turn)))
            masses.append(plan.mass)
    assert done
    return np.array(errors), np.array(masses)


@pytest.mark.parametrize(
    ("name", "believed", "before", "after"),
    [("dual_arm_exchange_mujoco", 0.2, 1.0e-3, 0.4e-3),
     ("ball_exchange_mujoco", 0.1, 0.3e-3, 0.25e-3)],
)  # fmt: skip
def test_an_object_29_percent_too_heavy(
    name: str, believed: float, before: float, after: float
) -> None:
    true = 1.29 * believed
    without, planned = carried(name, f"{true} kg")
    assert set(planned) == {believed}
    found, masses = carried(name, f"{true} kg", forces__estimate="{phase: lift}")
    for said, errors in (("as believed", without), ("estimated", found)):
        most = errors.max(axis=0)
        print(f"{name}, {said}: {1e3 * most[0]:.2f} mm, {1e3 * most[1]:.1f} mrad after the lift")
    np.testing.assert_allclose(masses[500:], true, rtol=0.01)
    assert without[:, 0].max() > before
    assert found[:, 0].max() < after
    assert found[:, 1].max() < 0.02
