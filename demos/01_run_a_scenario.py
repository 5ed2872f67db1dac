"""Load a scenario and step its controller: the whole library in one loop.

    python demos/01_run_a_scenario.py [--ticks N] [NAME_OR_FILE]

`wbc run` does the same and keeps a log. Here every tick's record is in your hands.
"""

import argparse

import numpy as np

from wbc.scenario import load
from wbc.scenario.build import build


def main() -> None:
    """Run, and print what happens."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="planar_exchange")
    parser.add_argument("--ticks", type=int, help="default: the scenario's duration")
    arguments = parser.parse_args()

    assembly = build(load(arguments.scenario))  # every name resolved, every error found
    controller, state = assembly.controller, assembly.start
    phases = [phase.name for phase in controller.phases.phases]

    phase = -1
    for _ in range(arguments.ticks or assembly.ticks):
        record, state = controller.step(state)  # the state is a value: keep it, go back to it
        if record.phase != phase:
            phase = record.phase
            print(f"{record.t:6.3f} s  phase '{phases[phase]}'")
        if record.event is not None:
            task = controller.task_names[record.event.task]
            print(f"{record.t:6.3f} s  '{task}' {'in' if record.event.inserted else 'out'}")

    held = record.object_error[~np.isnan(record.object_error[:, 0]), 0]
    print(
        f"{record.t:6.3f} s  object error {held.max(initial=0.0):.1e} m, status {record.status!r}"
    )


if __name__ == "__main__":
    main()
