"""``wbc run``: a scenario, its robot ideal or under torques, recorded, and shown if asked for."""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np

from wbc.arrays import Array
from wbc.cli.interrupt import Interrupts
from wbc.cli.pictures import force_pictures, with_table
from wbc.cli.progress import Progress, SlowNotice
from wbc.cli.report import report_lines
from wbc.cli.session import (
    LOG,
    ROBOT,
    SCENARIO,
    SUMMARY,
    fault_lines,
    load_with_settings,
    results_folder,
    run_meta,
)
from wbc.control.rehearsal import rehearse
from wbc.control.state import ControllerState, TickRecord
from wbc.errors import SetupError, WbcError
from wbc.files import write_whole
from wbc.recording import Log, Outcome, Recorder, summarize, write
from wbc.recording.dynamic_facts import displaced_error
from wbc.rotations import quaternion
from wbc.scenario.build import Assembly, build
from wbc.scenario.build_disturbance import build_disturbance
from wbc.scenario.build_dynamics import build_dynamics
from wbc.scenario.schema import Scenario
from wbc.sim import dynamic, kinematic
from wbc.sim.dynamic import Dynamics
from wbc.view import LiveView
from wbc.view.from_robot import SnapshotMaker, robot_scene

_LATE = 0.1  # behind by more than this, the pace starts anew rather than hurry, [s]


def run_command(arguments: argparse.Namespace) -> int:
    """Run, record, report; 0 only for a run that did what its scenario asks."""
    interrupts: Interrupts = arguments.interrupts
    interrupts.check()
    loaded = load_with_settings(arguments)
    folder = results_folder(arguments.out, loaded.path.stem)
    simulation = loaded.scenario.simulation
    phases = tuple(phase.name for phase in loaded.scenario.phases) or ("run",)
    progress = Progress(phases, simulation.duration)
    with contextlib.ExitStack() as stack:
        notice = stack.enter_context(SlowNotice(progress.say))
        assembly = build(loaded)
        viewer = stack.enter_context(_Viewer(assembly, arguments)) if arguments.view else None
        if simulation.rehearse:
            check_rehearsal(assembly)
            interrupts.check()
        session = Session.of(assembly, progress)
        session.viewer = viewer
        session.paced = arguments.realtime or (arguments.view and not arguments.fast)
        interrupts.check()
        with contextlib.suppress(KeyboardInterrupt):  # the ticks so far are kept
            session.go(interrupts, notice)
        interrupts.saving = True
        stopped = bool(interrupts.received)  # a signal from here on stops nothing any more
        progress.clear()
        if stopped:
            print("interrupted; writing what there is", file=sys.stderr)
        summary, saved = session.save(folder, interrupted=stopped)
        for line in report_lines(summary, session.took, balances=_balances(loaded.scenario)):
            print(line)
        if saved:
            print(f"written to {folder}: {LOG}, {SUMMARY}")
        sys.stdout.flush()
        if stopped:
            return interrupts.exit_code
        if viewer is not None:
            interrupts.ticking = interrupts.saving = False
            viewer.stay(folder)
    return 0 if summary["success"] and saved else 1


def _balances(scenario: Scenario) -> bool:
    """Whether a task or a phase is about force closure."""
    kinds = {spec.type for spec in scenario.tasks.values()}
    closed = any(phase.until and phase.until.force_closure for phase in scenario.phases)
    return closed or not kinds.isdisjoint(("equilibrium_force", "equilibrium_moment"))


def check_rehearsal(assembly: Assembly) -> None:
    """Refuse what a rehearsal shows to be impossible. Raises SetupError, a line per reason."""
    faults = rehearse(assembly.controller, assembly.start).faults
    if faults:
        raise SetupError("\n".join(fault_lines(assembly.loaded, faults)))


@final
class _Viewer:
    """The live view of a run, which never keeps the run waiting."""

    def __init__(self, assembly: Assembly, arguments: argparse.Namespace) -> None:
        controller, model = assembly.controller, assembly.model
        shown = len(controller.task_names) - controller.law.kin.grasp.count
        main = () if assembly.main_task is None else (assembly.main_task,)
        scenario, meta = assembly.loaded.scenario, run_meta(assembly)
        forces = force_pictures(scenario, meta, model, controller.law.kin.grasp)
        scene = robot_scene(
            model,
            controller.law.kin.grasp,
            title=scenario.name,
            tips=[scenario.robot.fingers[name] for name in meta.contact_names],
            task_names=(*main, *controller.task_names[:shown]),
            phase_names=tuple(phase.name for phase in controller.phases.phases),
            shown=[(assembly.start.q, controller.law.kin.object_position)],
            friction=forces.friction,
            measured=forces.measured,
        )
        scene = with_table(scene, scenario, controller.law.kin.grasp)
        self._maker = SnapshotMaker(model, controller.task_names, shown, bool(main), forces.arrows)
        self._first: TickRecord | None = None
        self._live = LiveView(scene, arguments.port, open_browser=not arguments.no_browser)
        if self._live.url:
            asked = arguments.port
            taken = asked is not None and f":{asked}/" not in self._live.url
            print(
                f"live view: {self._live.url}" + (f" (port {asked} is taken)" if taken else ""),
                flush=True,
            )
        kin = controller.law.kin  # what is there before the first tick, which may have to compile
        self._maker.text = "getting ready; the very first run compiles its kernels, about a minute"
        pose = kin.reference.position, kin.reference.rotation
        self._live.publish(self._maker.at_rest(assembly.start.q, *pose, kin.grasp.count))
        self._maker.text = ""

    def __enter__(self) -> _Viewer:
        return self

    def __exit__(self, *_: object) -> None:
        self._live.close()

    def show(self, record: TickRecord, progress: Progress) -> None:
        """Publish a tick if a picture is due."""
        self._first = self._first or record
        if record.event is not None:
            self._maker.note(record.t, record.event)
        if self._live.due():
            self._live.publish(self._maker.of_record(_truly(record, self._first)))
            if line := self._live.warning():
                progress.say(line)

    def stay(self, folder: Path) -> None:
        """Leave the last picture up for whoever sits at the terminal."""
        if not (sys.stdin.isatty() and self._live.alive):
            return
        print(f"the view stays open; Enter ends it (again: wbc view {folder})", flush=True)
        with contextlib.suppress(KeyboardInterrupt, EOFError):
            input()


def _truly(record: TickRecord, first: TickRecord) -> TickRecord:
    """The record with robot and object where they are, not where they are commanded to be.

    The object's error is then the true one, whichever finger is asked.

    Args:
        first: of the run: by what the object was displaced at the start is no error.
    """
    found, begun = record.dynamics, first.dynamics
    if found is None or begun is None:
        return record
    error = np.full(2, np.nan)
    if np.isfinite(found.object_position).all() and np.isfinite(found.object_rotation).all():
        wanted = [_pose(r.reference_position, r.reference_rotation) for r in (first, record)]
        true = [_pose(d.object_position, d.object_rotation) for d in (begun, found)]
        error = np.array(displaced_error(np.array(wanted), np.array(true)))[:, 1]
    record = record._replace(object_error=np.tile(error, (len(record.mode), 1)))
    if not np.isfinite(found.q).all():
        return record
    return record._replace(
        q=found.q, object_position=found.object_position, object_rotation=found.object_rotation
    )


def _pose(position: Array, rotation: Array) -> Array:
    return np.concatenate((position, quaternion(rotation)))


@final
@dataclass
class Session:
    """One run under way.

    Attributes:
        dynamics: engine and second stage; None on the ideal robot.
        state: after the last tick recorded.
        took: computing time of the ticks after the first, [s].
    """

    assembly: Assembly
    recorder: Recorder
    progress: Progress
    dynamics: Dynamics | None = None
    viewer: _Viewer | None = None
    paced: bool = False
    state: ControllerState | None = None
    took: float = 0.0

    @classmethod
    def of(cls, assembly: Assembly, progress: Progress) -> Session:
        """A run before its first tick, on the engine of its scenario."""
        dynamics = build_dynamics(assembly)
        recorder = Recorder(run_meta(assembly, dynamics), assembly.ticks)
        return cls(assembly, recorder, progress, dynamics)

    def go(self, interrupts: Interrupts, notice: SlowNotice) -> None:
        """Tick until the scenario's time is over or a signal comes."""
        assembly = self.assembly
        pace = _Pace(assembly.controller.settings.dt) if self.paced else None
        began = time.perf_counter()
        for record, state in self._ticks():
            if self.state is None:  # the first tick may have compiled: it is not counted
                notice.over()
                interrupts.ticking = True
            else:
                self.took += time.perf_counter() - began
            self.recorder.append(record)
            self.state = state
            self.progress.tick(record)
            if self.viewer is not None:
                self.viewer.show(record, self.progress)
            if interrupts.received:
                break
            if pace is not None:
                pace.wait()
            began = time.perf_counter()

    def _ticks(self) -> Iterator[tuple[TickRecord, ControllerState]]:
        given = self.assembly.controller, self.assembly.start, self.assembly.ticks
        if self.dynamics is None:
            return kinematic.run(*given)
        return dynamic.run(*given, self.dynamics)

    def save(self, folder: Path, *, interrupted: bool) -> tuple[dict[str, Any], bool]:
        """Write log and summary; the summary, and whether everything was written."""
        log, summary = self.finish(interrupted=interrupted)
        return summary, write_run(folder, log, summary, self.assembly)

    def finish(self, *, interrupted: bool) -> tuple[Log, dict[str, Any]]:
        """The log of the ticks so far, and its summary."""
        log = self.recorder.finish(complete=not interrupted)
        state = self.assembly.start if self.state is None else self.state
        phases = self.assembly.controller.phases.phases
        # a last phase without exit condition lasts to the end of the run, and that it has reached
        endless = state.phase.current == len(phases) - 1 and math.isinf(phases[-1].until.time)
        done = state.phase.done or (endless and not interrupted)
        outcome = Outcome(phases, done, state.phase.timeouts, interrupted)
        summary = summarize(log, outcome)
        if interrupted:
            summary["reason"] = f"interrupted; {summary['reason']}".rstrip("; ")
            summary["success"] = False
        disturbance = build_disturbance(self.assembly.loaded.scenario)
        if disturbance is not None:
            summary["disturbance"] = disturbance.as_record()
        return log, summary


@final
class _Pace:
    """The clock on the wall: one tick per `dt`."""

    def __init__(self, dt: float) -> None:
        self._dt = dt
        self._due = time.monotonic()

    def wait(self) -> None:
        """Until the next tick is due; time lost is not made up."""
        self._due += self._dt
        ahead = self._due - time.monotonic()
        if ahead > 0.0:
            time.sleep(ahead)
        elif ahead < -_LATE:
            self._due = time.monotonic()


def _copy(path: Path, text: bytes) -> None:
    write_whole(path, lambda file: file.write(text))


def write_run(folder: Path, log: Log, summary: dict[str, Any], assembly: Assembly) -> bool:
    """Whether every file of the run could be written; each that could not is told."""
    texts = {
        SCENARIO: log.meta.scenario_text.encode("utf-8"),
        ROBOT: assembly.model.text.encode(),
    }
    good = True
    for name in (LOG, SUMMARY, *texts):
        try:
            if name == LOG:
                log.save(folder / name)
            elif name == SUMMARY:
                write(summary, folder / name)
            else:
                _copy(folder / name, texts[name])
        except WbcError as error:
            print(error, file=sys.stderr)
            good = False
    return good
