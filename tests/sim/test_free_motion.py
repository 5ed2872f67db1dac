"""Motion without contact against MuJoCo, whose physics no one here wrote."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.sim.worlds import grippers, probe
from wbc.contact.surfaces.sphere import Sphere
from wbc.rotations import exp_so3, log_so3, rotation_from_quaternion
from wbc.sim.compliant import FreeBody

mujoco: Any = pytest.importorskip("mujoco")


def test_the_robot_swings_as_in_mujoco() -> None:
    assembly, plant = grippers(1e-3)
    spec = mujoco.MjSpec.from_string(assembly.model.text)
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    for joint in spec.joints:
        joint.limited = 0
    model = spec.compile()
    data = mujoco.MjData(model)
    model.opt.timestep = 1e-3
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    at = [model.joint(name).qposadr[0] for name in assembly.model.joint_names]
    rng, q = np.random.default_rng(4), assembly.start.q
    v, tau = rng.normal(size=len(q)), 5.0 * rng.normal(size=len(q))
    data.qpos[at], data.qvel[at], data.qfrc_applied[at] = q, v, tau
    plant.reset(q, v, np.array([50.0, 0.0, 0.0]), np.eye(3))
    for _ in range(500):
        mujoco.mj_step(model, data)
        sensed = plant.step(tau, 1e-3)
    assert np.linalg.norm(sensed.q - q) > 0.5
    assert sensed.q == pytest.approx(data.qpos[at], abs=1e-6)
    assert sensed.v == pytest.approx(data.qvel[at], abs=1e-6)


def test_a_body_tumbles_as_in_mujoco() -> None:
    inertia, com = np.array([1e-3, 2e-3, 2.5e-3]), np.array([0.02, 0.0, 0.01])
    spec = mujoco.MjSpec()
    spec.option.timestep = 1e-4  # its rule for a free body is of lower order
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    body = spec.worldbody.add_body()
    body.add_freejoint()
    body.mass, body.ipos, body.inertia, body.explicitinertial = 1.0, com, inertia, True
    model = spec.compile()
    data = mujoco.MjData(model)
    rotation, spin = exp_so3(np.ones(3)), np.array([3.0, 1.0, -2.0])
    plant = probe(Sphere(0.05), FreeBody(1.0, com, inertia), 1e-3)
    away, velocity = np.array([9.0, 0.0, 0.0]), np.array([0.1, -0.2, 0.3])
    plant.reset(away, np.zeros(3), np.zeros(3), rotation, np.concatenate([velocity, spin]))
    mujoco.mju_mat2Quat(data.qpos[3:7], rotation.ravel())
    data.qvel[:3] = velocity - np.cross(spin, rotation @ com)
    data.qvel[3:] = rotation.T @ spin
    for _ in range(5000):
        mujoco.mj_step(model, data)
    for _ in range(500):
        sensed = plant.step(np.zeros(3), 1e-3)
    theirs = rotation_from_quaternion(data.qpos[[4, 5, 6, 3]])
    assert sensed.object_position == pytest.approx(data.qpos[:3], abs=1e-6)
    assert np.linalg.norm(log_so3(theirs @ sensed.object_rotation.T)) < 1e-6
