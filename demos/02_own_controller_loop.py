"""Same as 01, but the loop is yours: tasks come and go while it runs, and a sensor fails.

    python demos/02_own_controller_loop.py [--ticks N]

Removing, inserting and re-ordering give a new state; the gains see to it that nothing jumps. A
measurement that is no number makes the robot brake and is said in the status; nothing is raised.
"""

import argparse

import numpy as np

from wbc.control.controller import Controller
from wbc.control.state import ControllerState, Measurement, Status
from wbc.scenario import load
from wbc.scenario.build import build


def ask(controller: Controller, state: ControllerState, tick: int, ticks: int) -> ControllerState:
    """What this program wants of the stack, and when."""
    if tick == ticks // 10:
        print("take 'palm' out")
        return controller.remove(state, "palm")
    if tick == 2 * ticks // 10:
        print("put 'palm' back")
        return controller.insert(state, "palm")
    if tick == 3 * ticks // 10:
        print("'palm' before 'dexterity', once both have faded out")
        return controller.reorder(state, ["force", "moment", "palm", "dexterity"])
    return state


def measure(state: ControllerState, tick: int, ticks: int) -> Measurement:
    """The joints as measured: ideal, but for a moment in which the sensor says nothing."""
    failed = 8 * ticks // 10 <= tick < 9 * ticks // 10
    return Measurement(np.full_like(state.q, np.nan) if failed else state.q)


def main() -> None:
    """Run, and print what changes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=600)
    ticks = parser.parse_args().ticks

    assembly = build(load("planar_exchange"))
    controller, state = assembly.controller, assembly.start
    status, fastest = Status.OK, 0.0
    for tick in range(ticks):
        state = ask(controller, state, tick, ticks)
        before = state.v
        record, state = controller.step(state, measure(state, tick, ticks))
        fastest = max(fastest, float(np.abs(record.v - before).max()))
        if record.status != status:
            status = record.status
            print(f"{record.t:6.3f} s  {status!r}, joint speed {np.abs(record.v).max():.3f} rad/s")
    order = [controller.task_names[k] for k in state.order]  # tips of free fingers come first
    print(f"order: {', '.join(order)}; largest velocity step {fastest:.3f} rad/s")


if __name__ == "__main__":
    main()
