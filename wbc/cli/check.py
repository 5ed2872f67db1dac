"""``wbc check``: everything about a scenario that can be known without running it."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterable, Iterator
from importlib.util import find_spec
from textwrap import wrap

import numpy as np

from wbc.arrays import Array
from wbc.cli.progress import SlowNotice
from wbc.cli.session import fault_lines, load_with_settings
from wbc.contact.grasp import ContactMode, GraspClass
from wbc.control.phases import Phase
from wbc.control.rehearsal import LONGEST, Rehearsal, Stage, rehearse
from wbc.robot.model import RobotModel
from wbc.robot.pruning import PairReport
from wbc.scenario.build import Assembly, build
from wbc.scenario.build_costs import safety_distance
from wbc.sim.mujoco_shapes import MISSING
from wbc.tasks import Synergy

_NEAREST = 5  # pairs listed with their distance
_WIDTH = 96
_NOTICED = 0.05  # a joint out of its range by less is not told, [deg]


def check_command(arguments: argparse.Namespace) -> int:
    """Print what the scenario amounts to; 2 if it cannot be run as it is."""
    loaded = load_with_settings(arguments)
    with SlowNotice(lambda text: print(text, file=sys.stderr)):
        assembly = build(loaded)
    scenario = loaded.scenario
    print(f"{scenario.name}: {scenario.description}".rstrip(": "))
    simulation = scenario.simulation
    print(
        f"  {assembly.ticks} ticks of {1e3 * simulation.step:g} ms, {simulation.integrator}, "
        f"seed {simulation.seed}, sha256 {loaded.hash[:12]}"
    )
    rehearsal = rehearse(assembly.controller, assembly.start)
    for title, lines in (
        ("robot", robot_lines(assembly.model)),
        ("tasks, highest priority first", _tasks(assembly)),
        ("collision pairs", _pairs(assembly.pairs)),
        ("start", _start(assembly)),
        ("phases", _phases(assembly, rehearsal)),
    ):
        print(title)
        for line in lines:
            print(f"  {line}")
    for line in fault_lines(loaded, rehearsal.warnings):
        print(f"warning: {line}")
    if simulation.engine == "mujoco" and find_spec("mujoco") is None:
        print(f"warning: {loaded.locate(('simulation', 'engine'))}: {MISSING}")
    sys.stdout.flush()  # the faults come last, also where both go to one place
    for line in fault_lines(loaded, rehearsal.faults):
        print(line, file=sys.stderr)
    print("faults found, see above" if rehearsal.faults else "ready to run")
    return 2 if rehearsal.faults else 0


def robot_lines(model: RobotModel) -> Iterable[str]:
    """The joints with their limits, one line each."""
    where = "in its plane" if model.planar else "in space"
    coupled = f" and {model.n_full - model.nv} that follow them" if model.followers else ""
    yield f"{model.path.name}: {model.nv} joints{coupled}, moves {where}"
    width = max(len(name) for name in model.full_names)
    for j, name in enumerate(model.joint_names):
        scale, unit, rate, effort = _units(model, int(model.own[j]))
        low, high = scale * model.lower[j], scale * model.upper[j]
        yield (
            f"{name:<{width}}  {low:8.1f} to {high:7.1f} {unit}"
            f"   {model.velocity[j]:g} {rate}   {model.effort[j]:g} {effort}"
        )
    for k, name in enumerate(model.full_names):
        if name in model.followers:
            yield f"{name:<{width}}  = {_coupling(model, k)}"


def _coupling(model: RobotModel, joint: int) -> str:
    """How a joint of all follows its master, in the units of `_units`."""
    master = int(model.master[joint])
    scale, unit, *_ = _units(model, joint)
    ratio = model.ratio[joint] * scale / _units(model, int(model.own[master]))[0]
    offset = scale * model.offset[joint]
    return f"{ratio:g} {model.joint_names[master]}" + (f" {offset:+g} {unit}" if offset else "")


def _units(model: RobotModel, joint: int) -> tuple[float, str, str, str]:
    """Factor and unit of positions, units of velocity and effort, of a joint of all."""
    if model.is_prismatic(joint):
        return 1e3, "mm", "m/s", "N"
    return 180.0 / math.pi, "deg", "rad/s", "Nm"


def _tasks(assembly: Assembly) -> Iterable[str]:
    controller = assembly.controller
    tasks = controller.law.stack.tasks[: len(controller.task_names) - _count(assembly)]
    if assembly.main_task is not None:
        spec = assembly.loaded.scenario.tasks[assembly.main_task]
        yield f"{assembly.main_task}: {spec.type}, main task"
    for task in tasks:
        spec = assembly.loaded.scenario.tasks[task.name]
        rows = f"{task.rows} row{'s' if task.rows > 1 else ''}"
        yield f"{task.name}: {spec.type}, {rows}, {task.gain:g} /s"


def _count(assembly: Assembly) -> int:
    return assembly.controller.law.kin.grasp.count


def _pairs(report: PairReport | None) -> Iterable[str]:
    if report is None:
        yield "no collision cost: nothing is watched"
        return
    yield f"{len(report.kept)} watched"
    for what, pairs in (
        ("share a joint", report.adjacent),
        ("always in collision, left out", report.always),
        ("never near each other, left out", report.never),
        ("switched off", report.disabled),
    ):
        yield f"{len(pairs)} {what}" + (":" if pairs else "")
        if pairs:
            for first in dict.fromkeys(a for a, _ in pairs):
                others = ", ".join(b for a, b in pairs if a == first)
                yield from wrap(
                    f"{first} - {others}", _WIDTH, initial_indent="  ", subsequent_indent="    "
                )


def _start(assembly: Assembly) -> Iterable[str]:
    """Distances and limits at the closed start."""
    law, state, model = assembly.controller.law, assembly.start, assembly.model
    kin = law.kin.update(state.q, state.contact, law.kin.reference)
    if kin.holding:
        errors = np.linalg.norm(kin.error[state.contact.mode != ContactMode.FREE, :3], axis=1)
        yield f"{kin.holding} fingers closed on the object to {errors.max():.1e} m"
    room = np.minimum(state.q - model.lower, model.upper - state.q)
    j = int(np.argmin(room))
    scale, unit, *_ = _units(model, int(model.own[j]))
    yield f"nearest joint limit: {model.joint_names[j]}, {scale * room[j]:.1f} {unit} away"
    if law.distances is None or not len(law.distances.scene.pair_names):
        return
    distances = law.distances.update(kin.robot, kin.object_position, kin.object_rotation)
    names = distances.scene.pair_names
    order = np.argsort(distances.value)
    yield "nearest watched pairs:"
    for k in order[:_NEAREST]:
        yield f"  {names[k][0]}-{names[k][1]}: {distances.value[k]:.3f} m"


def _phases(assembly: Assembly, rehearsal: Rehearsal) -> Iterable[str]:
    """Each phase as it went in a rehearsal."""
    stages = {stage.name: stage for stage in rehearsal.stages}
    failed = {fault.phase for fault in rehearsal.faults}
    safe = safety_distance(assembly.loaded.scenario)
    for number, phase in enumerate(assembly.controller.phases.phases, start=1):
        touching = [
            f"{finger} {ContactMode(int(mode)).name.lower()}"
            for finger, mode in zip(_grasp_fingers(assembly), phase.mode, strict=True)
            if mode != ContactMode.FREE
        ]
        yield f"{number}. {phase.name}: {', '.join(touching) or 'no contact'}{_ends(phase)}"
        for task, goal, _ in phase.task_motions:
            weights = ", ".join(f"{x:.4g}" for x in np.rad2deg(goal))
            yield f"   leads {assembly.controller.task_names[task]} to {weights} deg"
            yield from _beyond(assembly, task, goal)
        stage = stages.get(phase.name)
        if stage is None:
            yield f"   not rehearsed: it stops {'at a fault' if failed else f'after {LONGEST:g} s'}"
            continue
        near = ""
        if stage.nearest is not None:
            near = f"; nearest {'-'.join(stage.nearest)}, {stage.distance:.3f} m"
        ended = "failed" if number - 1 in failed and stage is rehearsal.stages[-1] else "over"
        yield f"   rehearsed: {ended} at {stage.time:.2f} s{near}"
        if safe is not None and stage.nearest is not None and 0.0 < stage.distance < safe:
            yield (
                f"   warning: comes within {1e3 * stage.distance:.1f} mm, less than the safety "
                f"distance of {1e3 * safe:g} mm"
            )
        if stage.grasp is not None:
            yield from (f"   {line}" for line in _grasp_lines(stage.grasp))
            yield f"   manipulability: {_manipulability(assembly, phase, stage)}"
            if stage.load is not None and stage.load[1] > 0.0:
                factor = stage.load[1]
                most = "any weight" if factor == np.inf else f"{factor:.3g} times the weight"
                yield f"   forces: hold {most} at rest"


def _grasp_fingers(assembly: Assembly) -> tuple[str, ...]:
    return assembly.controller.law.kin.grasp.fingers


def _beyond(assembly: Assembly, index: int, weights: Array) -> Iterator[str]:
    """Which joints the posture of a synergy task's weights takes out of the hand's own ranges."""
    task = assembly.controller.law.stack.tasks[index]
    assert isinstance(task, Synergy)  # phases lead no other
    posture = task.mean + task.basis @ weights
    excess = np.rad2deg(posture - np.clip(posture, task.lower, task.upper))
    names = [assembly.model.joint_names[k] for k in task.joints]
    far = [f"{names[j]} {excess[j]:+.1f} deg" for j in np.flatnonzero(np.abs(excess) > _NOTICED)]
    if far and task.measure == "posture":
        yield f"   clipped to the hand's ranges: {', '.join(far)}"
    elif far:
        yield (
            f"   warning: leaves the hand's ranges: {', '.join(far)} "
            "(measure: posture commands the clipped posture)"
        )


def _ends(phase: Phase) -> str:
    if math.isinf(phase.until.time):
        return "; to the end"
    late = "" if math.isinf(phase.timeout) else f", by {phase.timeout:g} s or {phase.on_timeout}"
    return f"; {phase.until.time:g} s or more{late}"


def _grasp_lines(grasp: GraspClass) -> Iterable[str]:
    yield (
        f"J~ {grasp.rows} x {grasp.columns}, rank {grasp.rank}, smallest singular value "
        f"{grasp.smallest_singular_value:.3g}, condition {grasp.condition:.3g}"
    )
    redundant = (
        f"redundant ({', '.join(grasp.redundant_fingers)})" if grasp.redundant else "not redundant"
    )
    loose = (
        f"indeterminate ({grasp.free_motions} free motions)"
        if grasp.indeterminate
        else "determinate"
    )
    yield f"{redundant}, {loose}"
    eps_f, eps_m = grasp.residuals
    closure = _closure(grasp)
    yield f"force closure: {closure}; eps_f {eps_f:.2g}, eps_m {eps_m:.2g} m²"


def _closure(grasp: GraspClass) -> str:
    needed = grasp.friction_needed
    if needed == 0.0:
        return "with any friction"
    return "none with point contacts" if math.isinf(needed) else f"with friction above {needed:.3g}"


def _manipulability(assembly: Assembly, phase: Phase, stage: Stage) -> str:
    """w of (46) of each finger in contact."""
    grasp = assembly.controller.law.kin.grasp
    parts = [
        f"{grasp.fingers[i]} {stage.manipulability[i]:.3g}"
        for i in np.flatnonzero(phase.mode != ContactMode.FREE)
    ]
    return ", ".join(parts) + (" m²" if grasp.planar else " m³")
