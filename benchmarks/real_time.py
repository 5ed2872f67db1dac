"""How fast the exchange under torques goes on one core: both stages, planned forces and physics.

    OMP_NUM_THREADS=1 python -m benchmarks.real_time [SCENARIO ...]

One process on one core. A tick is all that lies between two of the plant's answers: first stage,
forces, second stage, MuJoCo's steps, what is sensed and recorded. Beside it MuJoCo's own steps are
timed alone, on a copy of the same instant. CPU time, so that what other processes take does not
count; the factor is simulated time over the sum of all ticks.
"""

from __future__ import annotations

import argparse
import gc
import importlib
import os
import platform
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

import wbc.compiled
from wbc.arrays import Array
from wbc.scenario import load
from wbc.scenario.build import build
from wbc.scenario.build_dynamics import build_dynamics
from wbc.sim import dynamic
from wbc.sim.mujoco_plant import MujocoPlant

_EVERY = 10  # ticks from one look at the physics alone to the next
_FIRST = 50  # ticks that are not counted: what is made at the first use


@dataclass(frozen=True)
class Times:
    """CPU seconds.

    Attributes:
        dt: what a tick stands for.
        ticks: (T,) of each tick.
        physics: (T / 10,) of MuJoCo's steps alone in a tick.
    """

    dt: float
    ticks: Array
    physics: Array

    @property
    def factor(self) -> float:
        """Simulated time over computing time."""
        return self.dt * len(self.ticks) / float(self.ticks.sum())

    @property
    def ratio(self) -> float:
        """Median tick in median physics."""
        return float(np.median(self.ticks) / np.median(self.physics))


def measured(scenario: str, most: int | None = None) -> Times:
    """Run a scenario of the engine mujoco, or its first `most` ticks."""
    mj: Any = importlib.import_module("mujoco")
    assembly = build(load(scenario))
    given = build_dynamics(assembly)
    if given is None or not isinstance(given.plant, MujocoPlant):
        raise SystemExit(f"{scenario}: the engine is not mujoco")
    plant, dt = given.plant, assembly.controller.settings.dt
    spare = mj.MjData(plant.model)
    count = assembly.ticks if most is None else min(most, assembly.ticks)
    ticks, physics = [], []
    run = dynamic.run(assembly.controller, assembly.start, count, given)
    gc.disable()
    for k in range(count):
        start = time.thread_time()
        next(run)
        ticks.append(time.thread_time() - start)
        if k % _EVERY == 0:
            mj.mj_copyData(spare, plant.model, plant.data)
            start = time.thread_time()
            mj.mj_step(plant.model, spare, nstep=round(dt / plant.model.opt.timestep))
            physics.append(time.thread_time() - start)
    gc.enable()
    return Times(dt, np.array(ticks[_FIRST:]), np.array(physics[_FIRST // _EVERY :]))


def main() -> int:
    """Print the table; exit code 1 where it is slower than real time."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument(
        "scenarios", nargs="*", default=["dual_arm_exchange_mujoco", "ball_exchange_mujoco"]
    )
    args = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    mj: Any = importlib.import_module("mujoco")
    print(
        f"mujoco {mj.__version__}, pin {pin.__version__}, numpy {np.__version__}, python "
        f"{platform.python_version()}, {'compiled' if wbc.compiled.COMPILED else 'NOT compiled'}, "
        f"OMP_NUM_THREADS={os.environ.get('OMP_NUM_THREADS', 'not set')}\n"
    )
    print("| scenario | x real time | tick, median | p99 | physics alone | tick in physics |")
    print("|---|---|---|---|---|---|")
    slow = False
    for scenario in args.scenarios:
        found = measured(scenario)
        median, late = 1e3 * np.percentile(found.ticks, (50, 99))
        alone = 1e3 * np.median(found.physics)
        print(
            f"| {scenario} | {found.factor:.2f} | {median:.2f} of {1e3 * found.dt:g} ms | "
            f"{late:.2f} ms | {alone:.2f} ms | {found.ratio:.1f} |"
        )
        slow = slow or found.factor < 1.0
    return int(slow)


if __name__ == "__main__":
    raise SystemExit(main())
