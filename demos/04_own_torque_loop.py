"""Same as 02, but by torques: measured joints and fingertip forces go in, joint torques come out.

    python demos/04_own_torque_loop.py [--ticks N]

Your robot takes the place of the plant: give it `tick.command.tau` once per tick, and make a
`Measurement` of what its sensors say. Whatever they say, `step` does not raise: what gave way is in
`record.dynamics.status`, a `TorqueStatus`. `record.status` is the first stage's, which sees no
sensor here.
"""

import argparse

import numpy as np

from wbc.control.force_control import TorqueStatus
from wbc.control.state import Measurement
from wbc.scenario import load
from wbc.scenario.build import build
from wbc.scenario.build_dynamics import build_dynamics, build_torque_control
from wbc.sim.plant import Sensed


def measured(sensed: Sensed, tick: int, ticks: int) -> Measurement:
    """What the sensors say: joints, and forces of the fingertips on the object in world axes."""
    force = sensed.force.copy()
    if 5 * ticks // 10 <= tick < 5 * ticks // 10 + 5:
        force[0] = np.nan  # a force sensor says nothing for five ticks: it is bridged
    return Measurement(q=sensed.q, v=sensed.v, force=force)  # and stamp=..., if there is a clock


def main() -> None:
    """Run, and print torques and what gave way."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=600)
    ticks = parser.parse_args().ticks

    assembly = build(load("planar_exchange_dynamic"))
    control = build_torque_control(assembly)  # both stages; no robot is simulated in there
    names, dt = assembly.model.joint_names, assembly.controller.settings.dt

    dynamics = build_dynamics(assembly)
    assert dynamics is not None  # the scenario has an engine
    robot, start = dynamics.plant, assembly.controller.law.kin.start  # here stands your robot
    sensed = robot.reset(assembly.start.q, np.zeros(len(names)), start.position, start.rotation)
    state = control.init(assembly.start, sensed.q)  # refused where it is not at the start
    mode, status = np.full(len(sensed.force), -1), TorqueStatus.OK
    for tick in range(ticks):
        outcome, state = control.step(state, measured(sensed, tick, ticks))
        record, tau = outcome.record, outcome.command.tau
        assert record.dynamics is not None  # under torques always
        if record.dynamics.status != status:
            status = TorqueStatus(record.dynamics.status)
            print(f"{record.t:6.3f} s  {status!r}")
        if tick % max(ticks // 5, 1) == 0:
            k = int(np.abs(tau).argmax())
            off = np.linalg.norm(sensed.object_position - record.reference_position)
            print(
                f"{record.t:6.3f} s  largest torque {tau[k]:+.1f} Nm ({names[k]}), "
                f"object {1e3 * off:.3f} mm off"
            )
        if not np.array_equal(mode, record.mode):
            mode = record.mode
            robot.treat(mode)  # of this engine: whose slip counts
        sensed = robot.step(tau, dt)


if __name__ == "__main__":
    main()
