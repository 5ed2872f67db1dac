"""What a tick of a scenario costs, in multiples of Pinocchio's own kinematics of the same robot.

    python benchmarks/tick.py [SCENARIO] [--blocks N]

The floor is computeJointJacobians (forward kinematics included) plus updateFramePlacements. The
scenario runs on the ideal robot; at moments spread over the run, blocks of the floor, of the whole
tick and of each of its parts are timed in turn in this process, and the ratios of each block are
taken to that block's floor. What is printed is the median over all blocks, with the quartiles: the
machine's speed cancels out of them, its unrest does not quite.

A tick by Euler's rule evaluates the law once, which is what a robot runs; by the Runge-Kutta rule
four times.
"""

from __future__ import annotations

import argparse
import gc
import platform
import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin

import wbc.compiled
from wbc.control.limiting import guarded, solved
from wbc.control.observe import observe
from wbc.scenario import load
from wbc.scenario.build import Assembly, build

_CALLS = 60  # calls of one thing in a block
_TARGET = 60.0


def timed(function: Callable[[], object]) -> float:
    """CPU seconds per call over one block: what other processes take is not counted."""
    start = time.thread_time()
    for _ in range(_CALLS):
        function()
    return (time.thread_time() - start) / _CALLS


def pieces(euler: Assembly, rk4: Assembly, state) -> dict[str, Callable[[], object]]:  # type: ignore[no-untyped-def]
    """The floor, the ticks, and the parts of a tick at one state."""
    controller = euler.controller
    law, robot, t = controller.law, euler.model.pin_model, state.tick * controller.settings.dt
    data, q = robot.createData(), euler.model.full(state.q)
    kin, contact = law.kin, state.contact
    controller.step(state)  # brings every workspace to this state
    reference = kin.reference
    targets = state.targets[: len(state.targets) - kin.grasp.count] + controller._tip_targets
    active = controller._active(state)
    levels = controller._levels(state.activation)
    here = guarded(state.q, contact, kin.grasp, controller.settings.bounds)
    motion, locks = solved(law, state.level_order, levels, here, controller.settings.dt)

    def floor() -> None:
        pin.computeJointJacobians(robot, data, q)
        pin.updateFramePlacements(robot, data)

    def sight() -> None:
        if law.distances is not None:
            law.distances.update(kin.robot, kin.object_position, kin.object_rotation)
        observe(law)

    def costs() -> None:
        if law.distances is not None:
            law.distances.update(kin.robot, kin.object_position, kin.object_rotation)
        for cost in law.costs:
            cost.add_gradient(kin.robot, law.distances, law.gradient)

    return {
        "floor": floor,
        "tick, Euler": lambda: controller.step(state),
        "tick, Runge-Kutta": lambda: rk4.controller.step(state),
        "  kinematics and contacts": lambda: kin.update(state.q, contact, reference),
        "  tasks": lambda: law.stack.evaluate(kin, targets, active),
        "  costs and distances": costs,
        "  prioritized solve": lambda: law.solve(state.level_order, levels),
        "  supervisor": lambda: controller._supervised(t, state, motion),
        "  limit filter": lambda: controller._limited(state, motion, here, locks, (1.0, 1.0), None),
        "  record (distances anew, and the smallest)": sight,
    }


def main() -> int:
    """Print the table; exit code 1 if the Euler tick is above the target."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario", nargs="?", default="planar_exchange")
    parser.add_argument("--blocks", type=int, default=40)
    args = parser.parse_args()
    euler = build(load(args.scenario, {"simulation.integrator": "euler"}))
    rk4 = build(load(args.scenario))
    state = rk4.start
    ratios: dict[str, list[float]] = {}
    floors = []
    gc.disable()
    for tick in range(rk4.ticks):
        _, state = rk4.controller.step(state)
        if tick % max(1, rk4.ticks // args.blocks):
            continue
        parts = pieces(euler, rk4, state)
        seconds = {name: timed(function) for name, function in parts.items()}
        floors.append(seconds["floor"])
        for name, value in seconds.items():
            ratios.setdefault(name, []).append(value / seconds["floor"])
    print(
        f"# {args.scenario}: {rk4.model.nv} joints, "
        f"{euler.controller.law.kin.grasp.count} fingers, "
        f"{len(rk4.pairs.kept) if rk4.pairs else 0} pairs; pin {pin.__version__}, "
        f"numpy {np.__version__}, python {platform.python_version()}, "
        f"{'compiled' if wbc.compiled.COMPILED else 'NOT compiled'}; "
        f"floor {np.median(floors) * 1e6:.2f} us here"
    )
    print("| part | x floor | quartiles |\n|---|---|---|")
    for name, values in ratios.items():
        low, middle, high = np.percentile(values, (25, 50, 75))
        print(f"| {name.replace('  ', '&nbsp;&nbsp;')} | {middle:.1f} | {low:.1f} - {high:.1f} |")
    evaluation = float(np.median(ratios["tick, Runge-Kutta"])) / 4.0
    print(f"\none evaluation of the Runge-Kutta tick: {evaluation:.1f} x floor")
    whole = float(np.median(ratios["tick, Euler"]))
    print(f"Euler tick: {whole:.1f} x floor, target {_TARGET:.0f}")
    return 0 if whole <= _TARGET else 1


if __name__ == "__main__":
    raise SystemExit(main())
