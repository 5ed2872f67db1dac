"""The planar grippers holding their object, and one fingertip on slides before an object."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wbc.arrays import Array
from wbc.contact.surfaces import Surface
from wbc.robot.model import load_robot
from wbc.scenario import load
from wbc.scenario.build import Assembly, build
from wbc.sim.compliant import CompliantPlant, FreeBody, Physics
from wbc.sim.pads import Pads


def pads(n: int, rest_length: float = 5e-3) -> Pads:
    """The chapter's pads, and the bristles that hold with them."""
    one = np.ones(n)
    return Pads(rest_length * one, 5e4 * one, 5.0 * one, 2e4 * one, 20.0 * one)


def physics(
    assembly: Assembly, step: float, friction: float = 0.8, sliding: float = 0.0
) -> Physics:
    """One friction for all tips; neither armature nor joint friction."""
    n, nv = assembly.controller.law.kin.grasp.count, assembly.model.nv
    return Physics(step, np.full(n, friction), np.full(n, sliding), np.zeros(nv), np.zeros(nv))


def grippers(step: float = 1e-3, friction: float = 0.8) -> tuple[Assembly, CompliantPlant]:
    """The planar exchange at its start: fingers 1 and 2 press with 20 N."""
    assembly = build(load("planar_exchange"))
    grasp = assembly.controller.law.kin.grasp
    fingers = assembly.loaded.scenario.robot.fingers
    plant = CompliantPlant(
        assembly.model, tuple(fingers[name] for name in grasp.fingers), grasp.surface,
        FreeBody(1.0, np.zeros(3), np.array([0.0, 0.0, 0.1])), pads(grasp.count),
        physics(assembly, step, friction),
    )  # fmt: skip
    return assembly, plant


def holding(assembly: Assembly, plant: CompliantPlant) -> Array:
    """Torques that balance the pads at the start, (nv,)."""
    sensed = plant.reset(assembly.start.q, 0.0 * assembly.start.q, np.zeros(3), np.eye(3))
    kin = assembly.controller.law.kin
    kin.robot.update(assembly.start.q)
    n = kin.grasp.count
    tau: Array = np.einsum("irj,ir->j", kin.robot.linear[:n], sensed.force)
    return tau


PROBE = """<robot name="probe"><link name="base"/>
  <joint name="x" type="prismatic"><parent link="base"/><child link="xs"/><axis xyz="1 0 0"/>
    <limit lower="-9" upper="9" velocity="9" effort="99"/></joint>
  <link name="xs"/>
  <joint name="y" type="prismatic"><parent link="xs"/><child link="ys"/><axis xyz="0 1 0"/>
    <limit lower="-9" upper="9" velocity="9" effort="99"/></joint>
  <link name="ys"/>
  <joint name="z" type="prismatic"><parent link="ys"/><child link="tip"/><axis xyz="0 0 1"/>
    <limit lower="-9" upper="9" velocity="9" effort="99"/></joint>
  <link name="tip"><inertial><mass value="0.5"/>
    <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>"""
"""A fingertip of 0.5 kg on three slides."""


def probe(surface: Surface, body: FreeBody, step: float, friction: float = 0.8) -> CompliantPlant:
    """The fingertip and an object, weightless, so that an object can stand for a wall."""
    model = load_robot(Path("probe.urdf"), text=PROBE)
    model.pin_model.gravity.linear = np.zeros(3)
    given = Physics(step, np.array([friction]), np.array([0.0]), np.zeros(3), np.zeros(3))
    return CompliantPlant(model, ("tip",), surface, body, pads(1), given)
