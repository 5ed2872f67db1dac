"""Same loop as 01, but with a task of your own: the two tips of a gripper keep a distance.

    python demos/03_own_task.py [--ticks N]

A task writes its error, its Jacobian ∂σ/∂q̃ and its feed-forward, nothing else. To make it a type
of scenario files, move the class to wbc/tasks/ and add one block to wbc/scenario/kinds.py and one
row to BUILDERS in wbc/scenario/build_tasks.py.
"""

import argparse
import math
from dataclasses import dataclass
from typing import final

import numpy as np

from wbc import resources
from wbc.arrays import Array
from wbc.contact.extended_finger import ExtendedKinematics
from wbc.contact.grasp import no_grasp
from wbc.control.controller import Controller, Settings
from wbc.control.law import CostForecast, Law
from wbc.control.phases import Phase, PhaseSequence
from wbc.control.task_stack import TaskStack
from wbc.robot.kinematics import Kinematics
from wbc.robot.model import RobotModel, load_robot
from wbc.stack.supervisor import Supervisor
from wbc.tasks import Posture, Task, TaskRows


@final
@dataclass(frozen=True)
class TipDistance(Task):
    """σ = |p_a − p_b| of two tracked frames; one row, [m].

    Attributes:
        a, b: places among the tracked frames.
        distance: σ_d, [m].
    """

    a: int
    b: int
    distance: float

    @property
    def rows(self) -> int:
        return 1

    def evaluate(self, kin: ExtendedKinematics, target: Array | None, out: TaskRows) -> None:
        robot = kin.robot
        between = robot.position[self.a] - robot.position[self.b]
        length = float(np.linalg.norm(between))
        out.error[0] = self.distance - length
        jacobian = (between / length) @ (robot.linear[self.a] - robot.linear[self.b])
        out.jacobian[0, : robot.model.nv] = jacobian


def assemble(model: RobotModel, tasks: list[Task], frames: tuple[str, ...]) -> Controller:
    """A controller without an object: the tasks in order of priority, one phase that never ends."""
    kin = ExtendedKinematics(Kinematics(model, frames), no_grasp(model.planar), 1.0)
    law = Law(kin, TaskStack(tasks, 0, np.ones(model.nv)), (), None, 0.0)
    none = np.zeros(0)
    phase = Phase(
        name="run",
        mode=np.zeros(0, dtype=np.int64),
        reach=none,
        offset=np.zeros((0, 3)),
        wanted=np.ones(len(tasks), dtype=np.bool_),
        pad=none,
    )
    return Controller(
        law,
        CostForecast((), Kinematics(model, ()), None),
        Supervisor(remove_above=0.05, insert_below=0.02, horizon=0.02, dwell=0.0),
        PhaseSequence((phase,)),
        range(len(tasks)),
        Settings(
            dt=2e-3, runge_kutta=True, smoothing=20.0, lower=model.lower, upper=model.upper,
            velocity=model.velocity, acceleration=np.full(model.nv, math.inf),
        ),
    )  # fmt: skip


def main() -> None:
    """Close the gripper to 0.5 m between its tips, with the trunk as it stands."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=1000)
    ticks = parser.parse_args().ticks

    model = load_robot(resources.find("urdf", "planar_gripper"))
    q0 = np.array([0.3, -0.5, 0.2, 0.8, -0.9, -0.8, 0.9])
    tips = ("tip_a", "tip_b")
    controller = assemble(
        model,
        [
            TipDistance("distance", gain=5.0, saturation=math.inf, a=0, b=1, distance=0.5),
            Posture("trunk", gain=2.0, saturation=math.inf, joints=np.arange(3), goal=q0[:3]),
        ],
        tips,
    )
    state = controller.init(q0)
    for tick in range(ticks):
        record, state = controller.step(state)
        if tick % max(ticks // 5, 1) == 0 or tick == ticks - 1:
            errors = dict(zip(controller.task_names, record.task_error, strict=True))
            print(f"{record.t:6.3f} s  " + "  ".join(f"{k}: {e:.2e}" for k, e in errors.items()))


if __name__ == "__main__":
    main()
