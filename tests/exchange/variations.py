"""Variations of the exchanges in space: where the object may lie, and what must come of each.

The object starts up to 5 cm from where its scenario puts it, along every axis, and turned up to
20 deg about an axis drawn at random. The hands start where they always do. A variation is numbered:
its number seeds it. Each is rehearsed, as `wbc run` does, and run where nothing speaks against it:
it must then complete inside every limit.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wbc.control.rehearsal import rehearse
from wbc.control.state import Status
from wbc.errors import WbcError
from wbc.rotations import exp_so3, quaternion, rotation_from_quaternion
from wbc.scenario import load
from wbc.scenario.build import Assembly, build

from .runs import Run, simulate

SCENARIOS = ("dual_arm_exchange", "dual_arm_box", "dual_arm_ball")
COUNT = 20
PLACE = 0.05  # [m]
TURN = 20.0  # [deg]
COARSE = {"simulation.step": "4 ms"}
ROUNDING = 1e-9
ROOMS = {"joint_room": 0.0, "speed_room": -ROUNDING, "apart": 0.5}
"""Figures of which the smallest is the worst, and how small they may be."""


@dataclass(frozen=True)
class Result:
    """What became of a variation.

    Attributes:
        verdict: 'completed', 'refused' (before the robot moved) or 'FAILED'.
        reasons: why it was refused, or what it broke.
        figures: the worst of the run; empty where there was none.
    """

    verdict: str
    reasons: tuple[str, ...] = ()
    figures: dict[str, float] = field(default_factory=dict)


def displacement(number: int) -> tuple[np.ndarray, np.ndarray]:
    """(3,) shift [m] and (3,) rotation vector [rad] of variation `number`, in the world."""
    random = np.random.default_rng(number)
    shift = random.uniform(-PLACE, PLACE, 3)
    axis = random.normal(size=3)
    return shift, np.deg2rad(random.uniform(-TURN, TURN)) * axis / np.linalg.norm(axis)


def variation(scenario: str, number: int) -> dict[str, Any]:
    """Overrides that make variation `number` of a scenario."""
    thing = load(scenario).scenario.object
    assert thing is not None
    shift, turn = displacement(number)
    rotation = exp_so3(turn) @ rotation_from_quaternion(np.array(thing.pose.xyzw))
    pose = {"position": np.array(thing.pose.xyz) + shift, "quaternion": quaternion(rotation)}
    return {"object.pose": pose}


def judge(scenario: str, number: int, **settings: Any) -> Result:
    """Rehearse variation `number`, and run it if the rehearsal finds nothing against it."""
    try:
        assembly = build(load(scenario, overrides={**variation(scenario, number), **settings}))
    except WbcError as error:
        return Result("refused", (str(error),))
    rehearsal = rehearse(assembly.controller, assembly.start)
    faults = tuple(fault.text for fault in rehearsal.faults)
    return Result("refused", faults) if faults else simulated(assembly)


def judge_coarse(scenario: str, number: int) -> Result:
    """The same with twice the tick."""
    return judge(scenario, number, **COARSE)


def simulated(assembly: Assembly) -> Result:
    """Run to the end of the phases; a phase that stops, or a limit broken, is a failure."""
    run = simulate(assembly=assembly, to_the_end=True)
    state, worst = run.state, figures(run)
    broken = []
    if not state.phase.done or state.phase.timeouts:
        name = assembly.controller.phases.phases[state.phase.current].name
        broken.append(f"ended in phase '{name}'")
    for name, least in ROOMS.items():
        if not worst[name] >= least:
            broken.append(f"{name} {worst[name]:.3g}")
    for name, most in (("step", 0.03), ("object", 1e-5), ("turn", 1e-4)):
        if not worst[name] <= most:
            broken.append(f"{name} {worst[name]:.3g}, at most {most:.3g} wanted")
    if worst["gave_way"]:
        broken.append(f"status {Status(int(worst['gave_way']))!r}")
    return Result("FAILED" if broken else "completed", tuple(broken), worst)


def figures(run: Run) -> dict[str, float]:
    """The worst of a run.

    Room is what is left to a limit: of the joints' positions in the robot's file [deg], of their
    speeds [rad/s]. `apart` is the smallest watched distance in units of the safety distance: a
    rehearsal refuses what comes below half of it. A velocity step is per tick, [rad/s]; object and
    turn are what the holding fingers err by, [m] and [rad].
    """
    model, settings = run.assembly.model, run.assembly.controller.settings
    room = np.minimum(run.q - model.lower, model.upper - run.q)
    errors = run.series("object_error")
    specs = run.assembly.loaded.scenario.costs.values()
    safety = max(spec.safety_distance for spec in specs if spec.type == "collision")
    return {
        "joint_room": float(np.rad2deg(room.min())),
        "speed_room": float((settings.velocity - np.abs(run.v)).min()),
        "apart": float(run.series("min_distance").min()) / safety,
        "step": float(run.velocity_steps.max()),
        "object": float(np.nanmax(errors[:, :, 0], initial=0.0)),
        "turn": float(np.nanmax(errors[:, :, 1], initial=0.0)),
        "eps": max(run.records[-1].residuals),
        "gave_way": float(run.status & ~(Status.DONE | Status.AT_EDGE)),
        "time": float(run.t[-1]),
    }
