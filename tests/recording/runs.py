"""Runs made by hand: records whose numbers are known, without any robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wbc.arrays import Array
from wbc.control.phases import ExitCondition, Phase
from wbc.control.state import ForceRecord, Status, TickRecord
from wbc.recording import Log, Recorder, RunMeta
from wbc.rotations import exp_so3
from wbc.stack.limits import NOT_LIMITED
from wbc.stack.supervisor import StackEvent
from wbc.view.scene import ForceArrows

DT = 0.01
META = RunMeta(
    scenario="two fingers",
    dt=DT,
    joint_names=("shoulder", "elbow", "wrist"),
    contact_names=("f1", "f2"),
    task_names=("force", "posture"),
    tip_task_names=("tip_f1", "tip_f2"),
    main_task="object",
    phase_names=("reach", "slide"),
    scenario_text="name: two fingers  # ε, ρ\n",
    source="two_fingers.yaml",
    seed=7,
    versions={"python": "3", "wbc": "0"},
    q_lower=(-2.0, -2.0, -np.inf),
    q_upper=(2.0, 2.0, np.inf),
    v_limit=(3.0, 3.0, np.inf),
    task_units=("m", "", "rad"),
    remove_above=0.05,
    insert_below=0.02,
    safety_distance=0.05,
)


def record(k: int, **changes: object) -> TickRecord:
    """Tick k of a smooth run: finger 2 touches, and the phase changes, at tick 50."""
    t, late = k * DT, k >= 50
    nan = np.nan
    made = TickRecord(
        t=t,
        q=np.array([np.sin(t), 0.5 * t, -0.2]),
        v=np.array([np.cos(t), 0.5, 0.0]),
        object_position=np.array([0.1 * t, 0.0, 0.0]),
        object_rotation=exp_so3(np.array([0.0, 0.0, 8.0 * t])),  # more than one turn
        reference_position=np.array([0.1 * t, 0.0, 0.0]),
        reference_rotation=np.eye(3),
        object_error=np.array(
            [[1e-4 * 0.9**k, 1e-5], [2e-3 if late else nan, 0.0 if late else nan]]
        ),
        mode=np.array([1, 2 if late else 0]),
        contact_points=np.array([[0.1, 0.2, 0.0], [0.1, -0.2, 0.0]]),
        contact_normals=np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]),
        task_error=np.array([0.5 * 0.9**k, 0.3, 0.01, 0.02]),
        within=np.array([True, late, False, not late]),
        activation=np.array([1.0 - 0.8**k, 0.25, 0.0, 1.0]),
        residuals=(0.9**k, 0.1 * 0.9**k),
        cost=0.001 * k,
        min_distance=0.4 - 0.001 * k,
        phase=int(late),
        status=Status.OK,
        limited=NOT_LIMITED,
        independence=0.5,
        freedom=np.array([1.0, 0.8, 0.6]),
        event=None,
    )
    return made._replace(**changes)


def recorded(
    ticks: int = 100,
    changes: dict[int, dict[str, object]] | None = None,
    meta: RunMeta = META,
    *,
    complete: bool = True,
) -> Log:
    """The log of a run; `changes` replaces fields of single ticks."""
    recorder = Recorder(meta, capacity_hint=16)
    for k in range(ticks):
        recorder.append(record(k, **(changes or {}).get(k, {})))
    return recorder.finish(complete=complete)


FORCE_META = replace(
    META,
    tau_min=(-0.5, -0.5, -np.inf),
    tau_max=(0.5, 0.5, np.inf),
    mu=(0.6, 0.5),
    mu_t=(0.004, 0.004),
    contact_models=("soft_finger", "point"),
)


def planned(k: int) -> ForceRecord:
    """Forces of tick k: finger 1 alone until finger 2 touches and takes half of what it presses."""
    late = k >= 50
    press = 4.0 - 0.01 * k
    other = 0.5 * press if late else 0.0
    return ForceRecord(
        force=np.array([[0.1, -press, 0.5], [0.0, other, 0.0]]),
        spin=np.array([0.002, 0.0]),
        torque=np.array([0.1 + 0.003 * k, -0.2, 2.0]),
        cone_margin=np.array([press - 0.9, other if late else np.nan]),
        torque_margin=np.array([0.4 - 0.003 * k, 0.3, np.inf]),
        wrench=np.array([0.1, 0.0, 4.0, 0.0, 0.01 * k, 0.0]),
        mass=0.4 if not late else 0.3,
        com=np.array([0.1 * k * DT, 0.0, 0.02]),
        status=0 if k < 90 else 3,
        iterations=7 if k == 0 else 1,
        phi=2.0 * press,
        sum_normal=press + other,
    )


def arrows(push: Array) -> ForceArrows:
    """Contact 1 pushes with `push`, contact 2 not at all; the object's weight is along -y."""
    weight = np.array([0.0, -0.3, 0.0, 0.0, 0.0, 0.0])
    contact = np.stack((push, np.full(3, np.nan)))
    return ForceArrows(
        contact,
        0.9 * contact,
        np.array([False, True]),
        np.array([0.0, 0.1, 0.0]),
        weight,
        -weight,
        np.zeros(3),
    )


def with_forces(ticks: int = 100, *, complete: bool = True) -> Log:
    """The log of a run that plans contact forces; no cone can hold it from tick 90 on."""
    changes: dict[int, dict[str, object]] = {k: {"forces": planned(k)} for k in range(ticks)}
    return recorded(ticks, changes, FORCE_META, complete=complete)


def removed_and_back() -> dict[int, dict[str, object]]:
    """A stack event at tick 30 and one at tick 60, each with a step of velocity."""
    at_30 = record(30).v + np.array([0.02, 0.0, 0.0])
    return {
        30: {"event": StackEvent(0, False, 0.06), "v": at_30},
        60: {"event": StackEvent(0, True, 0.01)},
    }


def without_limits() -> RunMeta:
    return replace(META, q_lower=(), q_upper=(), v_limit=(), task_units=())


def phase(name: str, until: ExitCondition, timeout: float, reach: tuple[float, float]) -> Phase:
    """A phase of which only what a summary reads is real."""
    return Phase(
        name=name,
        mode=np.array([1, 0]),
        reach=np.array(reach),
        offset=np.zeros((2, 3)),
        wanted=np.ones(4, dtype=bool),
        pad=np.zeros(2),
        until=until,
        timeout=timeout,
    )


PHASES = (
    phase("reach", ExitCondition(tip_error=1e-7), 1.5, (np.nan, 0.0)),
    phase(
        "slide", ExitCondition(residuals=((0, 1e-6),), force_closure=1e-6), 0.2, (np.nan, np.nan)
    ),
)
