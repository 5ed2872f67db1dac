"""What a tick of a scenario costs, in multiples of what Pinocchio and coal need for the same robot.

    python -m benchmarks.tick [SCENARIO] [--blocks N] [--growth]

Two floors, both in C++: *kinematics*, computeJointJacobians (forward kinematics included) and
updateFramePlacements; *floor*, that plus updateGeometryPlacements and computeDistances of all the
scenario's pairs with the object in its place. The scenario runs on the ideal robot; at moments
spread over the run, blocks of the floors, of the whole tick and of each of its parts are timed in
turn in this process, and the ratios of each block are taken to that block's floors. What is printed
is the median over the blocks: the machine's speed cancels out of it, its unrest does not quite.

A tick by Euler's rule evaluates the law once, which is what a robot runs; by the Runge-Kutta rule
four times. `--growth` also shows the tick with more and fewer contacts and pairs (growth.py).
"""

from __future__ import annotations

import argparse
import gc
import platform
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pinocchio as pin

import wbc.compiled
from wbc.contact.grasp import ContactMode
from wbc.control.limiting import guarded, solved
from wbc.control.observe import observe
from wbc.control.state import ControllerState
from wbc.scenario import load
from wbc.scenario.build import Assembly, build

Parts = dict[str, Callable[[], object]]

_CALLS = 60  # calls of one thing in a block
_SPACE = 20.0  # target in space, in floors
_PLANE = 60.0  # target in the plane, in kinematics
KINEMATICS, FLOOR, EULER = "kinematics", "floor", "tick, Euler"
RUNGE_KUTTA = "tick, Runge-Kutta"


def timed(function: Callable[[], object]) -> float:
    """CPU seconds per call over one block: what other processes take is not counted."""
    start = time.thread_time()
    for _ in range(_CALLS):
        function()
    return (time.thread_time() - start) / _CALLS


def floors(assembly: Assembly, state: ControllerState) -> Parts:
    """Both floors at one state; the object stands where the tick last saw it."""
    robot, q = assembly.model.pin_model, assembly.model.full(state.q)
    data, law = robot.createData(), assembly.controller.law
    geometry: Any = None
    if law.distances is not None:
        scene = law.distances.scene
        geometry = scene.geometry.copy()
        for k in scene.pieces:
            place = pin.SE3(law.kin.object_rotation, law.kin.object_position)
            geometry.geometryObjects[k].placement = place
        shapes = geometry.createData()

    def kinematics() -> None:
        pin.computeJointJacobians(robot, data, q)
        pin.updateFramePlacements(robot, data)

    def floor() -> None:
        kinematics()
        if geometry is not None:
            pin.updateGeometryPlacements(robot, data, geometry, shapes)
            pin.computeDistances(geometry, shapes)

    return {KINEMATICS: kinematics, FLOOR: floor}


def ticks(euler: Assembly, rk4: Assembly, state: ControllerState) -> Parts:
    """The floors, both ticks and the law's evaluation alone at one state."""
    controller = euler.controller
    law, t = controller.law, state.tick * controller.settings.dt
    controller.step(state)  # brings every workspace to this state
    levels, active = controller._levels(state.activation), controller._active(state)

    def law_alone() -> None:
        controller._evaluate(t, state.q, state.contact, state, active)
        law.solve(state.level_order, levels)

    return {
        **floors(euler, state),
        EULER: lambda: controller.step(state),
        RUNGE_KUTTA: lambda: rk4.controller.step(state),
        "the law once (evaluation and solve)": law_alone,
    }


def pieces(euler: Assembly, rk4: Assembly, state: ControllerState) -> Parts:
    """All of `ticks`, and the parts of the Euler tick."""
    whole = ticks(euler, rk4, state)
    controller = euler.controller
    law, t = controller.law, state.tick * controller.settings.dt
    kin, contact = law.kin, state.contact
    reference = kin.reference
    targets = state.targets[: len(state.targets) - kin.grasp.count] + controller._tip_targets
    active = controller._active(state)
    levels = controller._levels(state.activation)
    here = guarded(state.q, contact, kin.grasp, controller.settings.bounds)
    motion, locks = solved(law, state.level_order, levels, here, controller.settings.dt)

    def costs() -> None:
        if law.distances is not None:
            law.distances.update(kin.robot, kin.object_position, kin.object_rotation)
        for cost in law.costs:
            cost.add_gradient(kin.robot, law.distances, law.gradient)

    return {
        **whole,
        "  kinematics and contacts": lambda: kin.update(state.q, contact, reference),
        "  tasks": lambda: law.stack.evaluate(kin, targets, active),
        "  costs and distances": costs,
        "  edges of the contacts' faces": lambda: guarded(
            state.q, contact, kin.grasp, controller.settings.bounds
        ),
        "  prioritized solve": lambda: law.solve(state.level_order, levels),
        "  supervisor": lambda: controller._supervised(t, state, motion),
        "  limit filter": lambda: controller._limited(state, motion, here, locks, (1.0, 1.0), None),
        "  what the record sees": lambda: observe(law),
    }


def moments(assembly: Assembly, count: int) -> Iterator[tuple[str, ControllerState]]:
    """About `count` states spread over the run, each with the name of its phase."""
    controller, state = assembly.controller, assembly.start
    every = max(1, assembly.ticks // count)
    for tick in range(assembly.ticks):
        record, state = controller.step(state)
        if state.phase.done or state.phase.stopped:
            return
        if tick % every == 0:
            yield controller.phases.phases[record.phase].name, state


def touching(state: ControllerState) -> int:
    """Number of fingers in contact."""
    return int((state.contact.mode != ContactMode.FREE).sum())


def ratio(blocks: list[dict[str, float]], name: str, unit: str) -> float:
    """Median over the blocks of what a part takes, in one of the floors."""
    return float(np.median([block[name] / block[unit] for block in blocks]))


def table(blocks: list[dict[str, float]], space: bool) -> None:
    """One row a part."""
    print("| part | x kinematics | quartiles | x floor |\n|---|---|---|---|")
    for name in blocks[0]:
        low, middle, high = np.percentile([b[name] / b[KINEMATICS] for b in blocks], (25, 50, 75))
        title = name.replace("  ", "&nbsp;&nbsp;")
        quartiles = f"{low:.1f} - {high:.1f}"
        print(f"| {title} | {middle:.1f} | {quartiles} | {ratio(blocks, name, FLOOR):.2f} |")
    whole, unit, target = EULER, FLOOR if space else KINEMATICS, _SPACE if space else _PLANE
    print(f"\n{whole}: {ratio(blocks, whole, unit):.1f} x {unit}, target {target:.0f}")


def by_contacts(blocks: list[tuple[int, dict[str, float]]]) -> None:
    """The ticks for every number of contacts that the run has had."""
    print("\n| contacts | moments | Euler x floor | Runge-Kutta x floor | Euler x kinematics |")
    print("|---|---|---|---|---|")
    for count in sorted({n for n, _ in blocks}):
        those = [block for n, block in blocks if n == count]
        euler, rk4 = ratio(those, EULER, FLOOR), ratio(those, RUNGE_KUTTA, FLOOR)
        kinematics = ratio(those, EULER, KINEMATICS)
        print(f"| {count} | {len(those)} | {euler:.2f} | {rk4:.2f} | {kinematics:.1f} |")


def main() -> int:
    """Print the tables; exit code 1 if the Euler tick is above its target."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("scenario", nargs="?", default="planar_exchange")
    parser.add_argument("--blocks", type=int, default=40)
    parser.add_argument("--growth", action="store_true")
    args = parser.parse_args()
    euler = build(load(args.scenario, {"simulation.integrator": "euler"}))
    rk4 = build(load(args.scenario, {"simulation.integrator": "rk4"}))
    space, pairs = not rk4.model.planar, len(rk4.pairs.kept) if rk4.pairs else 0
    blocks = []
    gc.disable()
    for _, state in moments(rk4, args.blocks):
        seconds = {name: timed(part) for name, part in pieces(euler, rk4, state).items()}
        blocks.append((touching(state), seconds))
    measured = [seconds for _, seconds in blocks]
    here = (1e6 * float(np.median([b[name] for b in measured])) for name in (KINEMATICS, FLOOR))
    fingers = euler.controller.law.kin.grasp.count
    print(
        f"# {args.scenario}: {rk4.model.nv} joints, {fingers} fingers, {pairs} pairs; "
        f"pin {pin.__version__}, numpy {np.__version__}, "
        f"python {platform.python_version()}, "
        f"{'compiled' if wbc.compiled.COMPILED else 'NOT compiled'}; "
        "kinematics {:.2f} us and floor {:.2f} us here".format(*here)
    )
    table(measured, space)
    by_contacts(blocks)
    if args.growth:
        from benchmarks import growth

        growth.show(args.scenario)
    unit, target = (FLOOR, _SPACE) if space else (KINEMATICS, _PLANE)
    return 0 if ratio(measured, EULER, unit) <= target else 1


if __name__ == "__main__":
    raise SystemExit(main())
